"""Scenes whose lanes take steps of their own: the interval as text.

Three things make a lane leave the common step: an error above its tolerance, a stop that it meets,
and the integrator dop853, whose steps are always a lane's own.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from redundant_envs.algebra import arguments_of, gives_of
from redundant_envs.effects.hooks import Force, Impact
from redundant_envs.evaluators.assemble import (
    BLOCKS,
    HEAD,
    LANES,
    Assembly,
)
from redundant_envs.evaluators.assemble_pieces import PieceLines
from redundant_envs.evaluators.assemble_stops import LOGGED, MEETINGS, MOST_LOGGED, StopLines
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.evaluators.text import block, words
from redundant_envs.integrators import error_control, stops
from redundant_envs.integrators.tableaus import METHODS

GROUP = 64
"""Blocks that go through a step together: few enough to stay in a small cache, enough that what a step
and what its events need of the instruction cache seldom replace each other."""
MARK = "# ---- copied from here"
NEAR = 3.0
"""Of a row that says why a lane leaves the common step: not known yet, but near a stop. Otherwise it
is 0, 1 for too little accuracy, or 2 for a stop."""


class Plan(NamedTuple):
    """Dialect functions of a plan of steps; all plans give their results the same names."""

    begin: Callable[..., Any]
    """The first step (left_first), and whether the common step is of no use (void)."""
    judge: Callable[..., Any]
    """Whether a piece is accurate enough (good), and the step if not (left_retry)."""
    end: Callable[..., Any]
    """At the end of a step: whether it was the last, and the next one if not (left_again)."""


PLANS = {
    "fixed": Plan(error_control.begin_fixed, error_control.judge_fixed, error_control.end_fixed),
    "doubling": Plan(error_control.begin_doubling, error_control.judge_doubling, error_control.end_doubling),
    "adaptive": Plan(error_control.begin_adaptive, error_control.judge_adaptive, error_control.end_adaptive),
}


@dataclass(frozen=True)
class LaneSteps:
    """Rows and text of an assembly whose lanes take steps of their own.

    Attributes
    ----------
    assembly : Assembly
    plan_of_steps : {"fixed", "doubling", "adaptive"}
    stops : list of (effect key, Impact)
    """

    assembly: Assembly
    plan_of_steps: str
    stops: tuple[tuple[str, Impact], ...]
    used: list[Callable[..., Any]] = field(default_factory=list, compare=False)
    _texts: list[str] = field(default_factory=list, compare=False)

    @classmethod
    def of(cls, assembly: Assembly) -> LaneSteps | None:
        """What a scene needs; None where all lanes take the same step."""
        scene = assembly.scene
        stops = tuple((e.key, h) for e, h in assembly.hooks if isinstance(h, Impact))
        if scene.integrator == "dop853":
            return cls(assembly, "adaptive", stops)
        if scene.tolerance is not None:
            return cls(assembly, "doubling", stops)
        return cls(assembly, "fixed", stops) if stops else None

    @property
    def rules(self) -> Plan:
        """How the plan begins, judges a piece and ends a step."""
        return PLANS[self.plan_of_steps]

    # ---- rows ------------------------------------------------------------------------------------

    @cached_property
    def at_stops(self) -> StopLines:
        """The text about the stops."""
        return StopLines(self, self.stops)

    @cached_property
    def pieces(self) -> PieceLines:
        """The text about the pieces of motion in the scratch block."""
        return PieceLines(self)

    @property
    def gives_up(self) -> bool:
        """Whether a lane may not cross its interval: too many events, or no step that is short enough."""
        return bool(self.stops) or self.plan_of_steps == "adaptive"

    @property
    def modes(self) -> tuple[str, ...]:
        """Rows that say at which stop a slider rests: 1 upper, -1 lower, 0 none."""
        return ("mode_a", "mode_b") if self.stops else ()

    @cached_property
    def results(self) -> tuple[str, ...]:
        """Rows of what an interval leaves behind, beside the state and the error."""
        return ("evaluations", "trouble", *(("events", *self.modes) if self.stops else ()), "next_step")

    @cached_property
    def undo(self) -> dict[str, str]:
        """State and modes -> rows of what they were when the interval began.

        Of several equal steps each keeps its own start, so the interval's stands elsewhere.
        """
        origin = "interval" if self.plan_of_steps == "fixed" else "before"
        return {name: f"{name}_{origin}" for name in (*self.assembly.states, *self.modes)}

    @cached_property
    def plan(self) -> tuple[str, ...]:
        """Rows of what the common step tells the lanes that leave it."""
        equal = self.plan_of_steps == "fixed"
        names = ["marked", "error_before"] if equal else ["marked", "floor"]
        if self.stops:
            # Of the stages of the step: the least and the greatest acceleration of a free slider, and of
            # a resting one how hard its stop would have had to pull it.
            names += ["phase", "least_a", "most_a", "least_b", "most_b"]
            names += [*(["events_before"] if equal else []), *(f"{m}_before" for m in self.modes)]
            names += ["met_a", "turns_a", "met_b", "turns_b"]
            # Accelerations of the sliders at the first and the last stage of the step.
            names += [f"accel_{x}_{stage}" for stage in ("first", "last") for x in "ab"]
        if self.log:
            names += ["logged_before", "span_start"]
        if equal:
            names += self.undo.values()
        return tuple(names)

    @property
    def sums_before(self) -> list[str]:
        """Lines that name the sums before a common step: rows, or 0 where it begins the interval."""
        return [] if self.plan_of_steps == "fixed" else ["error_before, events_before = 0.0, 0.0"]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates that are kept at the end of an interval, to be compared when it is crossed again."""
        return self.assembly.scene.robot.coordinates if self.plan_of_steps == "doubling" else ()

    @property
    def constant(self) -> dict[str, float]:
        """Rows that hold one number for good: the common step is a piece to its end."""
        return {"phase": 2.0} if self.stops else {}

    @cached_property
    def log(self) -> tuple[str, ...]:
        """Rows of the events of an interval, where they are kept."""
        if not (self.stops and self.assembly.track_work):
            return ()
        entries = (f"log_{name}{n}" for n in range(MOST_LOGGED) for name in LOGGED)
        return ("logged", *entries)

    @cached_property
    def scratch(self) -> tuple[str, ...]:
        """Rows of the scratch block alone."""
        names = [*(f"{s}_from" for s in self.assembly.states), "from_error", "elapsed", "left"]
        names += [] if self.stops else ["phase"]
        names += ["home", "newly", "due", "steps_of_lane", "steps_left"]
        names += [f"{q}_seen" for q in self.coordinates]
        if self.stops:
            names += ["touching", "held", "target", "side", "low", "high", "gap_low", "gap_high", "tries"]
            names += ["changes", "searched", "cleared_a", "cleared_b", "slide"]
            names += [f"slope_{s}" for s in self.assembly.states[4:]]
            for x in "ab":
                names += [f"hold_{x}", f"hold_{x}_from", f"let_go_{x}"]
                names += [f"told_{x}", f"told_speed_{x}"]
            names += [f"mobility{i}_{x}" for x in "ab" for i in range(1, 5)]
        return tuple(names)

    # ---- statements ------------------------------------------------------------------------------

    def steady_steps(self) -> list[Call]:
        """Statements for ``steady``: steps per second that springs and dampers need at least."""
        a, order, rates = self.assembly, [], []
        if self.plan_of_steps == "fixed":
            return []
        for i, (effect, hook) in enumerate(a.hooks):
            if not isinstance(hook, Force):
                continue
            rules = (
                (hook.stiffness, error_control.steps_of_spring, f"stiffness{i}", f"spring_steps{i}"),
                (hook.damping, error_control.steps_of_damper, f"damping{i}", f"damper_steps{i}"),
            )
            for function, rule, amount, rate in rules:
                if function is not None:
                    order.append(Call((amount,), function, tuple(a.bound(effect, hook, function))))
                    order.append(Call((rate,), rule, (amount, f"W{hook.joint + 1}")))
                    rates.append(rate)
        if not rates:
            return []
        bounds = calls(["W1"], a.parameters, (a.scene.robot.mobility_bounds,), {})
        order = [*bounds, *order, Call(("steady0",), error_control.more, (rates[0], rates[0]))]
        for n, rate in enumerate(rates):
            order.append(Call((f"steady{n + 1}",), error_control.more, (f"steady{n}", rate)))
        return order

    def use(self, function: Callable[..., Any]) -> str:
        """Name of a dialect function in the text, which it then is part of."""
        self.used.append(function)
        return self.assembly.names.of(function)

    def call(self, function: Callable[..., Any]) -> str:
        """A statement that gives a dialect function the quantities of its arguments' names."""
        return f"{', '.join(gives_of(function))} = {self.use(function)}({', '.join(arguments_of(function))})"

    # ---- text ------------------------------------------------------------------------------------

    def kernels(self) -> tuple[list[str], list[Callable[..., Any]]]:
        """Text of all that :meth:`block_loop` calls, and the dialect functions in it."""
        a = self.assembly
        self.used.clear()
        common = [self._clear(), self._start(), self._judge(), *([self._meet()] if self.stops else [])]
        parts = [*self.at_stops.held(), self.at_stops.touch()] if self.stops else []
        parts += [self.pieces.begin(), self.pieces.look(), self.pieces.decide()]
        self._texts[:] = parts if self.stops else [*parts, a._step_text, a.rhs_text]
        parts = [*common, *parts, self._constants(), self.pieces.another_piece()]
        text = (Path(__file__).parent / "redo.py").read_text(encoding="utf-8")
        parts.append(text.split(MARK, 1)[1].split("\n", 1)[1].strip())
        return parts, self.used

    def _clear(self) -> str:
        writes = {"error_sum": "0.0", "evaluations": "0.0", "trouble": "0.0"}
        if self.stops:
            writes["events"] = "0.0"
        if self.log:
            writes |= {"logged": "0.0", "span_start": "-h" if self.plan_of_steps == "fixed" else "0.0"}
        if self.plan_of_steps == "fixed":
            writes |= {row: name for name, row in self.undo.items()}
        return self.assembly.lane_function("clear", "Before an interval.", [], writes)

    def _start(self) -> str:
        """Before a common step: keep the state, and see which lanes that step may serve."""
        a = self.assembly
        kept, lines = {f"{s}_before": s for s in a.states}, []
        if self.stops:
            kept |= {f"{m}_before": m for m in self.modes}
        if self.plan_of_steps == "fixed":
            kept |= {"error_before": "error_sum"} | ({"events_before": "events"} if self.stops else {})
        else:
            lines.append(self.least_steps())
            kept["floor"] = "where(steps <= 1.0, 0.0, steps)"  # 0 where one step may serve
        if self.log:
            kept["logged_before"] = "logged"
            if self.plan_of_steps == "fixed":
                kept["span_start"] = "span_start + h"
        return a.lane_function("start", "Before a common step.", lines, kept)

    def least_steps(self) -> str:
        """A line that tells how many steps the present rates and all springs and dampers need."""
        a, arm = self.assembly, self.assembly.scene.robot
        turning = [f"abs({v})" for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
        fastest = functools.reduce(lambda x, y: f"maximum({x}, {y})", turning)
        steady = [name for name in a.numbers if name.startswith("steady")]
        rule = self.use(error_control.least_steps)
        return f"steps = {rule}({fastest}, {steady[-1] if steady else '0.0'}, interval)"

    def _judge(self) -> str:
        """After a common step: which of the lanes it does not serve.

        What it did to a lane that it could not serve is never looked at: blocks without any lane
        that it may serve skip it.
        """
        a = self.assembly
        numbers = (*(f"{s}_before" for s in a.states[:8]), *(f"command{k}" for k in range(1, 5)))
        # Steps of their own do not help lanes whose state or effort is not finite.
        lines = [f"defect = {' + '.join(f'({n} - {n})' for n in numbers)}"]
        first = a.states[0]
        writes = {
            "marked": "where(defect == 0.0, mark, 0.0)",
            first: f"where(defect == 0.0, {first}, defect)",  # if no step has shown it, this does
        }
        mark = "0.0"
        if self.stops:
            lines += [*self.at_stops.sliders, *self.at_stops.begun("before")]
            near, pulled = self.use(stops.near), self.use(stops.pulled)
            for x in "ab":
                seen = self.at_stops.seen(x)
                most = max(self.at_stops.unseen, key=float)
                path = f"place_{x}_before, place_{x}, h, least_{x}, most_{x}, {most}"
                lines.append(f"near_{x} = {near}({path}, mode_{x}, lower_{x}, upper_{x})")
                lines.append(f"pulled_{x} = {pulled}(mode_{x}, {seen})")
            mark = "where(pulled_a + pulled_b > 0.0, 2.0, "
            mark += f"where(near_a + near_b > 0.0, {NEAR}, 0.0))"
        if self.plan_of_steps == "fixed":
            writes["evaluations"] = f"evaluations + {self.stages}"
        elif self.plan_of_steps == "doubling":
            # A link that has become fast in the step may have been too fast for it.
            lines.append(self.least_steps())
            mark = f"where(error_sum <= tip_tolerance, where(steps <= 1.1, {mark}, 1.0), 1.0)"
            mark = f"where(floor == 0.0, {mark}, 1.0)"
            writes["evaluations"] = f"where(floor == 0.0, evaluations + {self.stages}, evaluations)"
            writes["error_sum"] = "where(floor == 0.0, error_sum, 0.0)"
        else:
            mark = "1.0"
        lines.append(f"mark = {mark}")
        return a.lane_function(
            "judge", "After a common step: mark the lanes it does not serve.", lines, writes
        )

    def _meet(self) -> str:
        """After :meth:`_judge`, where a slider is near a stop: which lanes meet one."""
        # A slider that was released before the step starts at its stop and may leave it.
        start = self.use(stops.starts_at_stop)
        events = " + ".join(
            f"where(mode_{x} == 0.0, abs(met_{x}_now) + {start}(place_{x}_before, rate_{x}_before, "
            f"mode_{x}_before, lower_{x}, upper_{x}), 0.0)"
            for x in "ab"
        )
        return self.assembly.lane_function(
            "meet",
            "After a common step: mark the lanes that meet a stop.",
            self.at_stops.meetings("before"),
            {**MEETINGS, "marked": f"where(marked == {NEAR}, where({events} > 0.0, 2.0, 0.0), marked)"},
        )

    @property
    def stages(self) -> str:
        """Evaluations of the right-hand side in a step, as text."""
        return f"{METHODS[self.assembly.scene.integrator].stages}.0"

    def _constants(self) -> str:
        a, rows = self.assembly, self.assembly.every_row
        own = {*self.scratch, "phase", *a.memory}  # words of the task may mean something else there
        named = words(self._texts)
        entering = [r for r in a.rows if r in named and r not in own]
        leaving = [*a.states, "error_sum", *self.results]
        if self.log:
            entering.append("span_start")  # named by its place only, where events are told
        asked = [
            "marked",
            "newly",
            *(["floor"] if self.plan_of_steps == "doubling" else []),
            *(("due", "touching", "held", *self.modes) if self.stops else ()),
        ]
        lines = [
            *(f"{n.upper()} = {rows[n] * LANES}" for n in ("marked", "newly", "phase", "home")),
            "COMPLETE = 6.0",
            f"enter = move({[rows[r] for r in [*entering, *self.log]]})",
            f"leave = move({[rows[r] for r in [*leaving, *self.log]]})",
            *(f"any_{n} = any_set({rows[n]})" for n in asked),
        ]
        return "\n".join(lines)

    def block_loop(self, first: list[str], then: list[str]) -> list[str]:
        """Lines of :meth:`Assembly.block_loop` where lanes take steps of their own.

        Blocks go through the common step in groups; those with a lane that it does not serve wait,
        so that such lanes of the whole group fill the scratch block together.
        """
        step = ["step(W, o)"]
        if self.stops:
            step = [
                "if any_mode_a(W, o) | any_mode_b(W, o):",
                "    let_go(W, o)",
                *(["    tell_let_go(W, o)"] if self.log else []),
                "    step_held(W, o)",
                "    press(W, o)",
                "else:",
                "    step(W, o)",
            ]
        if self.plan_of_steps == "doubling":
            step = ["if ~any_floor(W, o) & ((1 << lanes) - 1):", *block(step)]
        elif self.plan_of_steps == "adaptive":
            step = []
        meet = ["if any_marked(W, o):", "    meet(W, o)"] if self.stops and step else []
        common = [*step, "judge(W, o)", *meet]
        several = self.plan_of_steps == "fixed"
        steps = "substeps" if several else "1"
        return [
            "oldest = 0",  # the first block that may wait
            f"for begin_block in range(0, {BLOCKS}, {GROUP}):",
            f"    end_block = min({BLOCKS}, begin_block + {GROUP})",
            f"    finish = {'substeps > 1 or ' if several else ''}end_block == {BLOCKS}",
            f"    for number in range({steps}):",
            "        waiting = oldest < begin_block",
            "        for sweep in range(2):",
            "            from_block = begin_block",
            "            if sweep == 1:",
            "                if not waiting:",
            "                    break",
            f"                redo(W, S, begin_block * {LANES}, min(count, end_block * {LANES}), finish)",
            "                from_block = min(oldest, begin_block)",
            "            for b in range(from_block, end_block):",
            *block(HEAD, 4),
            "                if sweep == 0:",
            "                    if number == 0:",
            *block([*first, "clear(W, o)"], 6),
            *block(["start(W, o)", *common], 5),
            "                    if any_marked(W, o):",
            "                        waiting = True",
            "                        continue",
            "                elif not any_marked(W, o) or absent(S, o):",
            "                    continue",
            "                else:",
            "                    served(W, o)",
            f"                if number == {steps} - 1:",
            *block(then, 5),
            "        oldest = first_absent(S, end_block)",
        ]
