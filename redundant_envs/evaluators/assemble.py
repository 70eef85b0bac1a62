"""Write the simulator of one scene as one module of text, straight from the physics files.

Bodies are copied unchanged, names prefixed by their file; what is generated here is only the order
of calls, the step of the tableau and the loops over blocks. An effect the scene does not name is
not in the text. ``assemble(scene).text`` is the whole simulator on one page.

Memory of a batch: one float64 array of blocks, each ``rows`` rows of 8 lanes. A row is one vector
of the compiled code, and all offsets inside a block are constants of the text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from redundant_envs.algebra import arguments_of, gives_of
from redundant_envs.effects.hooks import Actuation, Effect, Field, Force
from redundant_envs.evaluators.assemble_step import RightHandSide, right_hand_side, step_of
from redundant_envs.evaluators.binding import helpers
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.evaluators.text import FunctionNames, block, copied_text, indent, words
from redundant_envs.integrators.tableaus import METHODS
from redundant_envs.scene import Scene, identifier
from redundant_envs.tasks.limits import spring_limits
from redundant_envs.tasks.reach import ReachTask

if TYPE_CHECKING:
    from redundant_envs.evaluators.assemble_lanes import LaneSteps

LANES = 8
COPIED = ("instructions.py", "order.py", "stages.py", "prelude.py")
"""Files that every module begins with."""
MOST_INLINED = 4
"""Stages of a step up to which each has its own copy of the right-hand side."""
PLACES = ("tip_x", "tip_y", "goal_x", "goal_y")
"""Achieved and desired goal, the last columns of the outputs."""

BLOCKS = f"(count + {LANES - 1}) // {LANES}"
HEAD = ("o = b * STRIDE", f"first_lane = b * {LANES}", f"lanes = min({LANES}, count - first_lane)")
"""Text: the number of blocks of ``count`` lanes, and where block b is."""

SIGNATURES = {
    "advance": (
        "void(float64[::1], float64[::1], float64[:, ::1], float64[::1], boolean[::1], int64[::1], "
        "int64[::1], int8[::1], int64)"
    )
}

NON_FINITE, BAD_ACTION, SPEED_BOUND, TOLERANCE_NOT_REACHED, EVENT_BUDGET = 1.0, 2.0, 4.0, 8.0, 16.0
NO_STEP_FOUND = 32.0 + TOLERANCE_NOT_REACHED
"""From EVENT_BUDGET on: the interval was not crossed, and its lane is back where it began."""


@dataclass(frozen=True)
class Assembly:
    """The text of a scene's simulator, and where its numbers live in memory."""

    scene: Scene
    task: ReachTask | None = None
    track_work: bool = False

    # ---- what the scene reaches ------------------------------------------------------------------

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Integrated states: coordinates, velocities, and the work if it is tracked."""
        arm = self.scene.robot
        return (*arm.coordinates, *arm.rates, *(("work",) if self.track_work else ()))

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Numbers per environment: identifier -> nominal value."""
        values = {identifier(k): v for k, v in self.scene.parameters().items()}
        if self.task is not None:
            values.update(self.task.parameters())
        if self.scene.tolerance is not None:
            values["tip_tolerance"] = self.scene.tolerance
        return values

    @cached_property
    def prepared(self) -> list[Call]:
        """Statements that follow from the parameters alone; run when a parameter is set."""
        functions = self.scene.robot.prepared
        wanted = [name for f in functions for name in gives_of(f)]
        order = calls(wanted, self.parameters, functions, {})
        for effect, hook in self.hooks:
            if isinstance(hook, Field):
                arguments = self.bound(effect, hook, hook.function)
                if set(arguments) <= set(self.parameters):
                    order.append(Call(("ax", "ay"), hook.function, tuple(arguments)))
        return order + self.lanes.steady_steps() if self.lanes else order

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Everything that is constant in a step: parameters and what is prepared from them."""
        return (*self.parameters, *(name for call in self.prepared for name in call.names))

    @cached_property
    def aliases(self) -> dict[str, str]:
        """Quantities the task names otherwise than the scene."""
        if self.task is None:
            return {}
        return {k: identifier(v) for k, v in self.task.aliases(self.scene).items()}

    def bound(self, effect: Effect, hook: Field | Force | Actuation, function: Any) -> list[str]:
        """Arguments of a hook's function as identifiers."""
        names = []
        for a in arguments_of(function):
            source = hook.bind.get(a, a)
            names.append(identifier(f"{effect.key}{source}") if source.startswith(".") else source)
        return names

    @cached_property
    def hooks(self) -> list[tuple[Effect, Any]]:
        """Where the scene's effects attach."""
        return [(e, h) for e in self.scene.effects for h in e.hooks(self.scene.robot)]

    @cached_property
    def lanes(self) -> LaneSteps | None:
        """What makes each lane take steps of its own, in scenes that need it."""
        from redundant_envs.evaluators.assemble_lanes import LaneSteps

        return LaneSteps.of(self)

    @cached_property
    def names(self) -> FunctionNames:
        """Names of dialect functions in the text; those of the effects come first, in their order."""
        hooked = [
            getattr(hook, kind, None)
            for _, hook in self.hooks
            for kind in ("function", "potential", "conservative", "stiffness", "damping")
        ]
        return FunctionNames(self.parameters, helpers(f for f in hooked if f is not None))

    # ---- the right-hand side ---------------------------------------------------------------------

    @cached_property
    def _rhs(self) -> RightHandSide:
        return right_hand_side(self, self.scene.robot.functions)

    # ---- memory ----------------------------------------------------------------------------------

    @cached_property
    def actions(self) -> tuple[str, ...]:
        return ("action1", "action2", "action3", "action4") if self.task else ()

    @cached_property
    def memory(self) -> tuple[str, ...]:
        """What a lane remembers beside its state, in the order of its rows."""
        if self.task is None:
            return ()
        terms = tuple(f"{t}_sum" for t in self.task.reward_terms())
        return (*self.task.memory, *terms, *self.spent, "steps", "saturated", "numerics")

    @cached_property
    def spent(self) -> tuple[str, ...]:
        """Of an episode so far: evaluations, located events, and the largest error of an interval."""
        if self.lanes is None:
            return ()
        counts = ("evaluations_sum", "events_sum") if self.lanes.stops else ("evaluations_sum",)
        return (*counts, "error_most") if self.scene.tolerance is not None else counts

    @cached_property
    def draws(self) -> tuple[str, ...]:
        """Uniform draws of an episode."""
        return tuple(f"u{k + 1}" for k in range(self.task.draws)) if self.task else ()

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Columns of the table that a step of an environment fills."""
        if self.task is None:
            return ()
        terms = tuple(f"{t}_sum" for t in self.task.reward_terms())
        return (
            "reward", "terminated", "truncated", *self.task.measures,
            *(("beyond_limit",) if spring_limits(self.scene) else ()), "numerics", "saturated", "steps",
             *self.spent, *terms, *PLACES,
        )  # fmt: skip

    @cached_property
    def shown(self) -> tuple[str, ...]:
        """Rows of the scratch block with what a block of lanes shows: observations, then outputs."""
        return (*(f"obs_{k}" for k in range(len(self.observed))), *(f"out_{n}" for n in self.outputs))

    @cached_property
    def observed(self) -> tuple[str, ...]:
        """Observed quantities in order."""
        return tuple(self.task.observation(self.scene)) if self.task else ()

    @cached_property
    def rows(self) -> dict[str, int]:
        """Row of every number in a block."""
        before = tuple(f"{s}_before" for s in self.states)
        lanes = self.lanes
        names = [
            *self.states, "error_sum", *(lanes.results if lanes else ()), "h", "interval",
            *(f"command{k}" for k in range(1, 5)), *self.numbers,
            *((*before, *lanes.plan) if lanes else before if self.task else ()),
            *(("limit",) if self.task else ()),
            *self.actions, *self.memory, *(self.task.results if self.task else ()), *self.draws,
            *(lanes.log if lanes else ()),
        ]  # fmt: skip
        return {name: i for i, name in enumerate(names)}

    @cached_property
    def every_row(self) -> dict[str, int]:
        """The rows, and after them those of the scratch block alone."""
        scratch = (*(self.lanes.scratch if self.lanes else ()), *self.shown)
        return {**self.rows, **{name: len(self.rows) + i for i, name in enumerate(scratch)}}

    @property
    def scratch(self) -> int:
        """Numbers in the scratch block: of lanes with steps of their own, and of what is shown."""
        return len(self.every_row) * LANES if len(self.every_row) > len(self.rows) else 0

    @cached_property
    def stride(self) -> int:
        """Numbers in a block."""
        return len(self.rows) * LANES

    def at(self, name: str) -> str:
        """Where a number of lane i lives, as text."""
        return f"W[o + {self.rows[name] * LANES} + i]"

    def lane_function(
        self,
        name: str,
        doc: str,
        lines: list[str],
        writes: Mapping[str, str],
        lanes: int = LANES,
        columns: tuple[str, ...] = (),
        special: tuple[str, Mapping[str, float]] | None = None,
        apart: bool = False,
    ) -> str:
        """A function of every lane of a block, or of one: rows it names are its arguments.

        ``writes`` maps rows to results; ``columns`` are results that go to arrays instead.
        ``special`` names a second form, for blocks whose rows hold known numbers.
        ``apart``: rows of another block.
        """
        results = (*columns, *writes.values())
        named = words([*lines, *results])
        rows = self.every_row
        reads = [r for r in rows if r in named]
        body = [f'"""{doc}"""', *lines, f"return {', '.join(results)}"]
        places = f"reads={tuple(rows[r] for r in reads)}, writes={tuple(rows[w] for w in writes)}"
        text = f"def {name}({', '.join(reads)}):\n{indent(body, 1)}\n\n\n"
        if special:
            form, known = special
            numbers = {rows[r]: value for r, value in known.items()}
            text += f"{form} = straight_line({name}, {places}, known={numbers})\n"
        kind = "report" if columns else "straight_line"
        more = "" if lanes == LANES else f", lanes={lanes}"
        return f"{text}{name} = {kind}({name}, {places}{more}{', apart=True' if apart else ''})"

    # ---- text ------------------------------------------------------------------------------------

    @cached_property
    def text(self) -> str:
        """The whole module."""
        stopped = bool(self.lanes and self.lanes.stops)
        functions = [] if stopped else self._step[2]
        if self.task is not None:
            from redundant_envs.evaluators.assemble_task import task_kernels

            kernels, task_functions = task_kernels(self)
            functions = [*functions, *task_functions]
        else:
            kernels = [self._advance_text()]
        if self.lanes:
            lanes, lane_functions = self.lanes.kernels()
            kernels, functions = [*lanes, *kernels], [*functions, *lane_functions]
        prepared = [call.function for call in self.prepared if call.function]
        effects = ", ".join(e.key for e in self.scene.effects) or "no effects"
        parts = [
            # No number of the scene stands here: changing numbers never compiles anew.
            f'"""{self.scene.robot.kind}, {self.scene.integrator}: {effects}.\n\n'
            'Assembled from the physics files; not to be edited.\n"""',
            *(copied_text(name) for name in COPIED),
            f"assert LANES == {LANES}\nSTRIDE = {self.stride}",
            *(self.names.text(f) for f in helpers([*functions, *prepared])),
            *self._prepare_text(),
            *([] if stopped else [self.rhs_text + self.subroutine(), self._step_text]),
            *kernels,
        ]
        return "\n\n".join(parts) + "\n"

    def _prepare_text(self) -> list[str]:
        """What :attr:`prepared` does, to be read: NumPy does it when a parameter is set."""
        if not self.prepared:
            return []
        lines: list[str] = []
        for call in self.prepared:
            self.names.emit(call, lines, [])
        named = words(lines)
        names = [n for call in self.prepared for n in call.names]
        body = ['"""What follows from the parameters alone."""', *lines, f"return {', '.join(names)}"]
        arguments = ", ".join(n for n in self.parameters if n in named)
        return [f"def prepare({arguments}):\n{indent(body, 1)}"]

    @cached_property
    def _step_text(self) -> str:
        text = ""
        if self.estimates and not self.lanes:
            text = self.lane_function("clear", "Before an interval.", [], {"error_sum": "0.0"})
            text += "\n\n\n"
        writes = {**{s: f"{s}_new" for s in self.states}, **self.error_writes}
        return text + self.lane_function("step", "One step of every lane of a block.", self._step[1], writes)

    @property
    def error_writes(self) -> dict[str, str]:
        """Row of the error of a step, if the method gives one, and what goes there."""
        if not self.estimates:
            return {}
        # The error of an adaptive step decides on that step, all others are summed up.
        return {"error_sum": "error" if self.scene.integrator == "dop853" else "error_sum + error"}

    @cached_property
    def _step(self) -> tuple[list[str], list[str], list[Callable[..., Any]]]:
        """Numbers a step needs, its straight lines, and the dialect functions it calls."""
        lines, functions = step_of(self, self._rhs)
        named = words(lines)
        commands = tuple(f"command{k}" for k in range(1, 5))
        needs = [n for n in (*commands, *self.numbers) if n in named]
        return needs, lines, functions

    @cached_property
    def rhs_text(self) -> str:
        """The right-hand side as one function of a lane."""
        return self.rhs_function(self._rhs)

    def rhs_function(self, rhs: RightHandSide) -> str:
        """A right-hand side as a function of a lane."""
        arguments, lines, _ = rhs
        return f"def rhs({', '.join((*self.states, *arguments))}):\n{indent(lines, 1)}"

    def subroutine(self, more: int = 0) -> str:
        """Text after the right-hand side that makes it one function for all stages, if they are many.

        It has ``more`` results than there are velocities and works.
        """
        if METHODS[self.scene.integrator].stages <= MOST_INLINED:
            return ""
        return f"\n\n\nrhs = Subroutine(rhs, positions=4, results={4 + self.track_work + more})"

    @cached_property
    def scalar_text(self) -> str:
        """Dialect functions, right-hand side and one ``step`` of a lane, for any evaluator."""
        needs, lines, functions = self._step
        arguments = ", ".join((*self.states, "h", "interval", *needs))
        new = ", ".join(f"{s}_new" for s in self.states)
        step = f"def step({arguments}):\n" + indent([*lines, f"return {new}"], 1)
        return "\n\n".join([*(self.names.text(f) for f in helpers(functions)), self.rhs_text, step])

    def block_loop(self, first: list[str], then: list[str]) -> list[str]:
        """Lines that advance all lanes by a control interval.

        ``first`` and ``then`` are lines for the block of number ``b`` at ``o``, with ``first_lane``
        and the number of ``lanes`` that count.
        """
        if self.lanes:
            return self.lanes.block_loop(first, then)
        clear = ["clear(W, o)"] if self.estimates else []
        steps = [*clear, "for _ in range(substeps):", "    step(W, o)"]
        return [f"for b in range({BLOCKS}):", *block([*HEAD, *first, *steps, *then])]

    @property
    def estimates(self) -> bool:
        """Whether the method has an embedded error estimate."""
        return bool(METHODS[self.scene.integrator].error5)

    def _advance_text(self) -> str:
        defect = " + ".join(f"0.0 * {s}" for s in self.states[:8])
        trouble = " + trouble" if self.lanes else ""
        commands = [self.rows[f"command{k}"] for k in range(1, 5)]
        columns = {"finite": "defect", "numerics": f"where(defect == 0.0, 0.0, {NON_FINITE}){trouble}"}
        if self.estimates:
            columns["error"] = "error_sum"
        if self.lanes:
            columns["evaluations"] = "evaluations"
        parts, give_up = [], []
        if self.lanes and self.lanes.gives_up:
            undo = {**self.lanes.undo, **dict.fromkeys(self.lanes.log[:1], "0.0")}
            writes = {name: f"where(trouble >= {EVENT_BUDGET}, {was}, {name})" for name, was in undo.items()}
            doc = "A lane whose interval was given up has not moved."
            parts = [
                self.lane_function("undo", doc, [], writes),
                f"any_trouble = any_set({self.rows['trouble']})",
            ]
            give_up = ["if any_trouble(W, o):", "    undo(W, o)"]
            if self.lanes.stops:
                columns["events"] = f"where(trouble >= {EVENT_BUDGET}, 0.0, events)"
            defect = f"where(trouble >= {EVENT_BUDGET}, 0.0, {defect})"
        first = [
            f"if lanes == {LANES}:",
            "    take_efforts(efforts, first_lane, W, o)",
            "else:",
            "    for i in range(lanes):",
            *(f"        {self.at(f'command{k + 1}')} = efforts[first_lane + i, {k}]" for k in range(4)),
        ]
        body = [
            '"""Advance all lanes by one control interval; what is given back has whole blocks."""',
            "wide_vectors()",
            "count = efforts.shape[0]",
            *self.block_loop(first, [*give_up, f"inspect(W, o, ({', '.join(columns)}), first_lane)"]),
        ]
        parts += [
            self.lane_function(
                "inspect",
                "Whether a state is not finite, all trouble, and what the interval took.",
                [f"defect = {defect}"],
                {},
                columns=tuple(columns.values()),
            ),
            f"take_efforts = take({commands})\nSIGNATURES = {SIGNATURES}",
            "def advance(W, S, efforts, error, finite, evaluations, events, numerics, substeps):\n"
            + indent(body, 1),
        ]
        return "\n\n\n".join(parts)


def assemble(scene: Scene, task: ReachTask | None = None, track_work: bool = False) -> Assembly:
    """The assembly of a scene, with the task of an environment or the book of the work."""
    return Assembly(scene, task, track_work)


def source(scene: Scene) -> str:
    """The assembled module of a scene as text: its whole simulator."""
    return assemble(scene).text
