"""Scenes whose lanes take steps of their own: the interval as text.

Three things make a lane leave the common step: an error above its tolerance, a stop that it meets,
and the integrator dop853, whose steps are always a lane's own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from redundant_envs.algebra import arguments_of, gives_of
from redundant_envs.effects.hooks import Force, Impact
from redundant_envs.evaluators.assemble import (
    BLOCKS,
    EVENT_BUDGET,
    HEAD,
    LANES,
    TOLERANCE_NOT_REACHED,
    Assembly,
    block,
    emit,
    indent,
    prefixed,
    words,
)
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.integrators import error_control, stops
from redundant_envs.integrators.tableaus import METHODS
from redundant_envs.scene import identifier

GROUP = 64
"""Blocks that go through equal steps together: few enough to stay in the cache."""
MARK = "# ---- copied from here"
MOST_LOGGED = 256
"""Events of an interval that a scene with the book of the work keeps."""
LOGGED = ("time", "kind", "speed")


_MEETINGS = {f"{n}_{x}": f"{n}_{x}_now" for x in "ab" for n in ("met", "turns")}


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

    # ---- rows ------------------------------------------------------------------------------------

    @property
    def modes(self) -> tuple[str, ...]:
        """Rows that say at which stop a slider rests: 1 upper, -1 lower, 0 none."""
        return ("mode_a", "mode_b") if self.stops else ()

    @cached_property
    def results(self) -> tuple[str, ...]:
        """Rows of what an interval leaves behind, beside the state and the error."""
        return ("evaluations", "trouble", *(("events", *self.modes) if self.stops else ()), "next_step")

    @cached_property
    def plan(self) -> tuple[str, ...]:
        """Rows of what the common step tells the lanes that leave it."""
        names = ["error_before", "floor", "marked"]
        if self.stops:
            names += ["events_before", *(f"{m}_before" for m in self.modes)]
            names += ["met_a", "turns_a", "met_b", "turns_b"]
        if self.log:
            names += ["logged_before", "span_start"]
        return tuple(names)

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
        names = [*(f"{s}_from" for s in self.assembly.states), "from_error", "elapsed", "left", "phase"]
        names += ["newly", "due", "steps_of_lane", "steps_left"]
        if self.stops:
            names += ["touching", "held", "target", "side", "low", "high", "gap_low", "gap_high", "tries"]
            names += ["changes"]
            for x in "ab":
                names += [f"accel_{x}", f"hold_{x}", f"hold_{x}_from", f"let_go_{x}"]
                names += [f"told_{x}", f"told_speed_{x}"]
            names += [f"mobility{i}_{x}" for x in "ab" for i in range(1, 5)]
        return tuple(names)

    def _number(self, stop: int, field: str) -> str:
        """Identifier of a stop's own number."""
        key, hook = self.stops[stop]
        return identifier(f"{key}{getattr(hook, field)}")

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

    @cached_property
    def _sliders(self) -> list[str]:
        """Lines that give the sliders a and b the names that the equations of the stops use."""
        arm, lines = self.assembly.scene.robot, []
        for n, (x, (_, hook)) in enumerate(zip("ab", self.stops, strict=False)):
            q, v = arm.coordinates[hook.joint], arm.rates[hook.joint]
            lines += [
                f"place_{x} = {q}", f"rate_{x} = {v}",
                f"lower_{x} = {self._number(n, 'lower')}", f"upper_{x} = {self._number(n, 'upper')}",
            ]  # fmt: skip
        return [*lines, f"restitution = {self._number(0, 'restitution')}"]

    def _begun(self, origin: str) -> list[str]:
        """The same for where the sliders were."""
        arm = self.assembly.scene.robot
        return [
            f"{name}_{x}_{origin} = {rows[hook.joint]}_{origin}"
            for x, (_, hook) in zip("ab", self.stops, strict=False)
            for name, rows in (("place", arm.coordinates), ("rate", arm.rates))
        ]

    def _meetings(self, origin: str) -> list[str]:
        """Lines that tell how a step from ``origin`` meets the stops."""
        lines = [*self._sliders, *self._begun(origin)]
        for x, (_, hook) in zip("ab", self.stops, strict=False):
            start = f"place_{x}_{origin}, rate_{x}_{origin}, place_{x}, rate_{x}, h, lower_{x}, upper_{x}"
            lines.append(f"met_{x}_now, turns_{x}_now = {self._use(hook.function)}({start})")
        return lines

    def _use(self, function: Callable[..., Any]) -> str:
        """Name of a dialect function in the text, which it then is part of."""
        self.used.append(function)
        return prefixed(function)

    def _call(self, function: Callable[..., Any]) -> str:
        """A statement that gives a dialect function the quantities of its arguments' names."""
        return f"{', '.join(gives_of(function))} = {self._use(function)}({', '.join(arguments_of(function))})"

    # ---- text ------------------------------------------------------------------------------------

    def kernels(self) -> tuple[list[str], list[Callable[..., Any]]]:
        """Text of all that :meth:`block_loop` calls, and the dialect functions in it."""
        a = self.assembly
        self.used.clear()
        parts = [self._clear(), self._start(), self._judge()]
        if self.stops:
            parts += self._held()
            parts.append(self._touch())
        parts += [self._begin(), self._look(), self._decide()]
        self._texts[:] = [*parts[3:], a._step_text, a.rhs_text]
        parts += [self._constants(), self._another_piece()]
        text = (Path(__file__).parent / "redo.py").read_text(encoding="utf-8")
        parts.append(text.split(MARK, 1)[1].split("\n", 1)[1].strip())
        return parts, self.used

    def _clear(self) -> str:
        writes = {"error_sum": "0.0", "evaluations": "0.0", "trouble": "0.0"}
        if self.stops:
            writes["events"] = "0.0"
        if self.log:
            writes |= {"logged": "0.0", "span_start": "-h" if self.plan_of_steps == "fixed" else "0.0"}
        if self.plan_of_steps == "doubling":
            writes["h"] = "interval"
        return self.assembly.lane_function("clear", "Before an interval.", [], writes)

    def _start(self) -> str:
        kept = {**{f"{s}_before": s for s in self.assembly.states}, "error_before": "error_sum"}
        if self.stops:
            kept |= {"events_before": "events", **{f"{m}_before": m for m in self.modes}}
        if self.log:
            kept["logged_before"] = "logged"
            if self.plan_of_steps == "fixed":
                kept["span_start"] = "span_start + h"
        return self.assembly.lane_function("start", "Before a step.", [], kept)

    def _judge(self) -> str:
        """After a common step: which of the lanes it does not serve."""
        a, arm = self.assembly, self.assembly.scene.robot
        numbers = (*(f"{s}_before" for s in a.states[:8]), *(f"command{k}" for k in range(1, 5)))
        # Steps of their own do not help lanes whose state or effort is not finite.
        lines = [f"defect = {' + '.join(f'({n} - {n})' for n in numbers)}"]
        writes = {"marked": "where(defect == 0.0, mark, 0.0)"}
        if self.plan_of_steps != "fixed":
            turning = [v for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
            fastest = f"abs({turning[0]}_before)"
            for v in turning[1:]:
                fastest = f"maximum({fastest}, abs({v}_before))"
            steady = [name for name in a.numbers if name.startswith("steady")]
            rule = self._use(error_control.least_steps)
            lines.append(f"steps = {rule}({fastest}, {steady[-1] if steady else '0.0'}, interval)")
            writes["floor"] = "steps"
        mark = "1.0" if self.plan_of_steps == "adaptive" else "0.0"
        if self.stops:
            lines += self._meetings("before")
            touched = "abs(met_a_now) + abs(met_b_now) + abs(mode_a) + abs(mode_b)"
            mark = f"where({touched} > 0.0, 2.0, {mark})"
            writes |= _MEETINGS
        if self.plan_of_steps == "doubling":
            lines.append("good = where(steps <= 1.0, where(error_sum <= tip_tolerance, 1.0, 0.0), 0.0)")
            mark = f"where(good == 0.0, 1.0, {mark})"
        lines.append(f"mark = {mark}")
        if self.plan_of_steps != "adaptive":
            writes["evaluations"] = f"evaluations + {self._stages}"
        return a.lane_function(
            "judge", "After a common step: mark the lanes it does not serve.", lines, writes
        )

    @property
    def _stages(self) -> str:
        return f"{METHODS[self.assembly.scene.integrator].stages}.0"

    def _held(self) -> list[str]:
        """The step with sliders at rest, and the contacts."""
        a = self.assembly
        arm: Any = a.scene.robot
        functions: list[Any] = [f for f in arm.functions if "qdd1" not in gives_of(f)]
        functions.append(arm.held_dynamics)
        joints = [hook.joint + 1 for _, hook in self.stops]
        at_rest = [f"held{k} = abs({m})" for k, m in zip(joints, self.modes, strict=True)]
        rhs = a.right_hand_side(functions, [f"held{k}" for k in joints])
        lines, step_functions = a.step_of("rhs_held", rhs)
        lines.append("moving = where(phase >= 2.0, where(phase <= 5.0, 1.0, 0.0), 0.0)")
        self.used.extend(step_functions)
        contact = [*at_rest, *rhs[1][:-1]]
        known = {*a.states, *a.numbers, *words(line.split(" = ")[0] for line in contact)}
        mobility = {
            f"mobility{i}_{x}": f"W{i}{k}" for x, k in zip("ab", joints, strict=True) for i in range(1, 5)
        }
        for call in calls(mobility.values(), known, (*functions, arm.slider_mobility), arm.sincos):
            emit(call, contact, self.used)
        accelerations = {f"accel_{x}": f"qdd{k}" for x, k in zip("ab", joints, strict=True)}
        holds = {f"hold_{x}": f"hold{k}" for x, k in zip("ab", joints, strict=True)}
        return [
            a.rhs_function("rhs_held", rhs),
            a.step_function("step_held", [*at_rest, *lines], only="moving"),
            a.lane_function(
                "contact",
                "Accelerations, the forces that hold, and mobilities, of the present state.",
                contact,
                {**accelerations, **holds, **mobility},
            ),
        ]

    def _touch(self) -> str:
        """At a stop: impulses, rest and release, as :func:`stops.touch` decides."""
        a, arm = self.assembly, self.assembly.scene.robot
        sa, sb = (hook.joint for _, hook in self.stops)
        lines = [
            *self._sliders,
            f"waa = mobility{sa + 1}_a", f"wab = mobility{sa + 1}_b", f"wbb = mobility{sb + 1}_b",
            self._call(stops.touch),
        ]  # fmt: skip
        writes = {f"{m}": f"where(over_budget > 0.0, {m}_before, {m}_new)" for m in self.modes}
        rates = {arm.rates[sa]: "struck_a", arm.rates[sb]: "struck_b"}
        for k, v in enumerate(arm.rates):
            moved = rates.get(v, f"{v} + (impulse_a * mobility{k + 1}_a + impulse_b * mobility{k + 1}_b)")
            lines.append(f"{v}_struck = where(strikes > 0.0, {moved}, {v})")
        if "work" in a.states:
            lines.append(
                "work_struck = where(strikes > 0.0, work + 0.5 * (impulse_a * (rate_a + struck_a) "
                "+ impulse_b * (rate_b + struck_b)), work)"
            )
        for s in a.states:
            struck = s if s in arm.coordinates else f"{s}_struck"
            writes[s] = f"where(over_budget > 0.0, {s}_before, {struck})"
            writes[f"{s}_from"] = f"where(going_on > 0.0, {struck}, {s}_from)"
        writes |= {
            "from_error": "where(going_on > 0.0, error_sum, from_error)",
            "h": "where(going_on > 0.0, left, h)",
            "events": "events_new", "changes": "changes_new", "phase": "phase_new",
            "touching": "where(phase_new == 1.0, 1.0, 0.0)",
            "trouble": f"where(over_budget > 0.0, {EVENT_BUDGET}, trouble)",
        }  # fmt: skip
        for x in "ab":
            writes[f"let_go_{x}"] = f"let_go_{x}_new"
            writes[f"hold_{x}_from"] = f"where(going_on > 0.0, hold_{x}, hold_{x}_from)"
            if self.log:
                writes |= {f"told_{x}": f"told_{x}_new", f"told_speed_{x}": f"told_speed_{x}_new"}
                lines.append(f"told_{x}_new, told_speed_{x}_new = told_now_{x}, told_speed_now_{x}")
        return a.lane_function("touch", "At a stop: strike, let go, rest, or go on.", lines, writes)

    def _contact_needed(self, suffix: str = "") -> str:
        """Whether a slider is at a stop, or held there: an expression, 0 if not."""
        at = self._use(stops.at_stop)
        return " + ".join(
            f"abs({at}(place_{x}{suffix}, mode_{x}{suffix}, lower_{x}, upper_{x}))" for x in "ab"
        )

    def _begin(self) -> str:
        """Lanes that have just come from the common step."""
        a = self.assembly
        plan = {
            "fixed": ["left_first, void = h, 0.0"],
            "doubling": [self._call(error_control.begin_doubling)]
            if self.plan_of_steps == "doubling"
            else [],
            "adaptive": [self._call(error_control.begin_adaptive)]
            if self.plan_of_steps == "adaptive"
            else [],
        }[self.plan_of_steps]
        lines, fresh = [*plan], "0.0"
        if self.stops:
            lines += [*self._sliders, *self._begun("before")]
            lines.append(f"contacts = {self._contact_needed('_before')}")
            # What is known of the common step saves trying it again.
            lines.append("begun_at_stop = where(met_a == 3.0, 1.0, where(met_b == 3.0, 1.0, 0.0))")
            fresh = "where(void + begun_at_stop + abs(mode_a) + abs(mode_b) > 0.0, 0.0, 1.0)"
        lines.append(f"fresh = {fresh}")
        now = "newly > 0.0"
        values = {
            **{s: f"where(fresh > 0.0, {s}, {s}_before)" for s in a.states},
            **{f"{s}_from": f"{s}_before" for s in a.states},
            "error_sum": "where(fresh > 0.0, error_sum, error_before)",
            "from_error": "error_before", "elapsed": "0.0", "left": "left_first", "due": "fresh",
            "h": "where(fresh > 0.0, h, left_first)", "phase": "2.0",
        }  # fmt: skip
        if self.plan_of_steps == "doubling":
            values |= {"steps_of_lane": "steps_first", "steps_left": "steps_first"}
        if self.plan_of_steps == "adaptive":
            values["next_step"] = "next_first"
        if self.stops:
            values["phase"] = "where(fresh > 0.0, 2.0, where(contacts > 0.0, 1.0, 2.0))"
            values |= dict.fromkeys(("changes", "tries", "let_go_a", "let_go_b"), "0.0")
        writes = {name: f"where({now}, {value}, {name})" for name, value in values.items()}
        writes["newly"] = "0.0"
        if self.stops:
            lines.append(f"phase_now = {writes['phase']}")
            writes |= {"phase": "phase_now", "touching": "where(phase_now == 1.0, 1.0, 0.0)"}
        return a.lane_function(
            "begin_lanes", "Lanes that have just come from the common step.", lines, writes
        )

    def _look(self) -> str:
        """After a piece: count it, and how it meets the stops."""
        writes: dict[str, str] = {}
        lines = ["moved = where(phase >= 2.0, where(phase <= 5.0, 1.0, 0.0), 0.0)"]
        if self.stops:
            lines += self._meetings("from")
            writes |= {**_MEETINGS, "held": "abs(mode_a) + abs(mode_b)"}
        writes |= {"due": "moved", "evaluations": f"evaluations + moved * {self._stages}"}
        return self.assembly.lane_function("look", "After a piece of motion.", lines, writes)

    def _decide(self) -> str:
        """After a piece: what the lane does next."""
        a = self.assembly
        tried = "where(phase == 2.0, 1.0, where(phase == 4.0, 1.0, 0.0))"
        judge = {
            "fixed": ["good, left_retry = 1.0, left"],
            "doubling": [self._call(error_control.judge_doubling)]
            if self.plan_of_steps == "doubling"
            else [],
            "adaptive": [self._call(error_control.judge_adaptive)]
            if self.plan_of_steps == "adaptive"
            else [],
        }[self.plan_of_steps]
        end = {
            "fixed": ["last, left_again = 1.0, left"],
            "doubling": [self._call(error_control.end_doubling)] if self.plan_of_steps == "doubling" else [],
            "adaptive": [self._call(error_control.end_adaptive)] if self.plan_of_steps == "adaptive" else [],
        }[self.plan_of_steps]
        lines = [*judge]
        if self.stops:
            lines += [*self._sliders, *self._begun("from"), *self._begun("before"), self._call(stops.decide)]
        else:
            lines += ["again, there, accepted = 0.0, 0.0, due * good"]
        doubling = self.plan_of_steps == "doubling"
        lines += [
            f"failed = due * {tried} * (1.0 - good)",
            f"back = {'failed' if doubling else '0.0 * failed'}",
            f"retry = {'0.0 * failed' if doubling else 'failed'}",
            "moved = accepted + there",
            "elapsed_new = where(back > 0.0, 0.0, elapsed + where(moved > 0.0, h, 0.0))",
            "left_moved = left - h",
            "ended = where(accepted > 0.0, where(left_moved <= 0.0, 1.0, 0.0), 0.0)",
            *end,
            "done = ended * last",
            "continuing = accepted * (1.0 - done)",
            "left_new = where(failed > 0.0, left_retry, where(ended > 0.0, left_again, "
            "where(moved > 0.0, left_moved, left)))",
        ]  # fmt: skip
        if self.stops:
            # A held slider has just shown that it stays; a free one at its stop must be looked at.
            at = self._use(stops.at_stop)
            free = " + ".join(
                f"where(mode_{x} == 0.0, abs({at}(place_{x}, mode_{x}, lower_{x}, upper_{x})), 0.0)"
                for x in "ab"
            )
            lines += [
                f"contacts = where({free} > 0.0, 1.0, 0.0)",
                f"contacts_before = where({self._contact_needed('_before')} > 0.0, 1.0, 0.0)",
            ]
        else:
            lines += ["contacts, contacts_before = 0.0, 0.0"]
        lines += [
            "goes = continuing * (1.0 - contacts)",
            "back_free = back * (1.0 - contacts_before)",
        ]
        piece = "h_next_piece" if self.stops else "h"
        writes: dict[str, str] = {}
        arm = a.scene.robot
        places = {
            arm.coordinates[hook.joint]: f"place_{x}_new"
            for x, (_, hook) in zip("ab", self.stops, strict=False)
        }
        for s in a.states:
            here = places.get(s, s)
            writes[s] = f"where(back > 0.0, {s}_before, where(again + retry > 0.0, {s}_from, {here}))"
            writes[f"{s}_from"] = f"where(goes > 0.0, {s}, where(back > 0.0, {s}_before, {s}_from))"
        writes |= {
            "error_sum": "where(back > 0.0, error_before, where(again + retry > 0.0, from_error, error_sum))",
            "from_error": "where(goes > 0.0, error_sum, where(back > 0.0, error_before, from_error))",
            "elapsed": "elapsed_new",
            "left": "left_new",
            "h": f"where(again > 0.0, {piece}, where(goes + failed > 0.0, left_new, h))",
            "due": "0.0",
        }
        phase = "where(back > 0.0, where(contacts_before > 0.0, 1.0, 2.0), where(retry > 0.0, 2.0, phase))"
        phase = f"where(continuing > 0.0, where(contacts > 0.0, 1.0, 2.0), {phase})"
        if self.stops:
            phase = f"where(again > 0.0, phase_next, where(there > 0.0, 1.0, {phase}))"
        lines.append(f"phase_new = where(due > 0.0, where(done > 0.0, 6.0, {phase}), phase)")
        writes["phase"] = "phase_new"
        if self.plan_of_steps == "doubling":
            writes |= {
                "steps_of_lane": "where(back > 0.0, steps_retry, steps_of_lane)",
                "steps_left": "where(back > 0.0, steps_retry, "
                "where(ended > 0.0, steps_left_again, steps_left))",
            }
        if self.plan_of_steps == "adaptive":
            writes["next_step"] = "where(accepted + failed > 0.0, next_new, next_step)"
        if self.plan_of_steps != "fixed":
            writes["trouble"] = f"where(done * flagged > 0.0, {TOLERANCE_NOT_REACHED}, trouble)"
        if self.stops:
            for name in ("target", "side", "low", "high", "gap_low", "gap_high", "tries"):
                writes[name] = f"where(again > 0.0, {name}_new, {name})"
            for x in "ab":
                writes[f"mode_{x}"] = f"where(back > 0.0, mode_{x}_before, mode_{x})"
                writes[f"let_go_{x}"] = f"where(goes + back > 0.0, 0.0, let_go_{x})"
                writes[f"hold_{x}_from"] = f"where(goes > 0.0, hold_{x}, hold_{x}_from)"
            writes |= {
                "touching": "where(phase_new == 1.0, 1.0, 0.0)",
                "changes": "where(back > 0.0, 0.0, changes)",
                "events": "where(back > 0.0, events_before, events)",
            }
            if self.log:
                writes["logged"] = "where(back > 0.0, logged_before, logged)"
        return a.lane_function("decide", "After a piece of motion: what a lane does next.", lines, writes)

    def _constants(self) -> str:
        a, rows = self.assembly, self.assembly.every_row
        own = set(self.scratch)
        named = words(self._texts)
        entering = [r for r in a.rows if r in named and r not in own and not r.startswith(("obs_", "out_"))]
        leaving = [*a.states, "error_sum", *self.results]
        asked = ["marked", "newly", *(("due", "touching", "held") if self.stops else ())]
        lines = [
            f"SCRATCH = {len(rows) * LANES}",
            *(f"{n.upper()} = {rows[n] * LANES}" for n in ("marked", "newly", "phase")),
            "COMPLETE = 6.0",
            f"enter = move({[rows[r] for r in [*entering, *self.log]]})",
            f"leave = move({[rows[r] for r in [*leaving, *self.log]]})",
            *(f"any_{n} = any_set({rows[n]})" for n in asked),
        ]
        return "\n".join(lines)

    def _another_piece(self) -> str:
        """What happens to the slots of the scratch block between two looks at who is complete."""
        if not self.stops:
            body = [
                "if any_newly(S, 0):",
                "    begin_lanes(S, 0)",
                "step(S, 0)",
                "look(S, 0)",
                "decide(S, 0)",
            ]
        else:
            body = [
                "if any_newly(S, 0):",
                "    begin_lanes(S, 0)",
                "    if any_due(S, 0):",
                "        decide(S, 0)",
                "while any_touching(S, 0):",
                "    contact(S, 0)",
                "    touch(S, 0)",
                *(["    tell(S)"] if self.log else []),
                "step_held(S, 0)",
                "look(S, 0)",
                "if any_held(S, 0):",
                "    contact(S, 0)",
                "decide(S, 0)",
            ]
        text = (
            "@njit(inline='always', **OPTIONS)\ndef another_piece(S):\n"
            f'    """Another piece of motion of every slot."""\n{indent(body, 1)}'
        )
        return f"{self._tell()}\n\n\n{text}" if self.log else text

    def _tell(self) -> str:
        """The log of events, where it is kept."""
        rows = self.assembly.every_row
        row = {
            n: rows[n] * LANES
            for n in ("told_a", "told_b", "told_speed_a", "told_speed_b", "elapsed", "span_start")
        }
        log = rows["logged"] * LANES
        body = [
            '"""Write the events of the sliders into the log of their lane."""',
            f"for i in range({LANES}):",
            f"    for told, speed, slider in (({row['told_a']}, {row['told_speed_a']}, 0.0), "
            f"({row['told_b']}, {row['told_speed_b']}, 10.0)):",
            f"        n = int(S[i + {log}])",
            f"        if S[i + told] > 0.0 and n < {MOST_LOGGED}:",
            f"            at = i + {log + LANES} + n * {len(LOGGED) * LANES}",
            f"            S[at] = S[i + {row['span_start']}] + S[i + {row['elapsed']}]",
            f"            S[at + {LANES}] = S[i + told] + slider",
            f"            S[at + {2 * LANES}] = S[i + speed]",
            f"            S[i + {log}] += 1.0",
        ]
        return f"@njit(**OPTIONS)\ndef tell(S):\n{indent(body, 1)}"

    def block_loop(self, first: list[str], then: list[str]) -> list[str]:
        """Lines of :meth:`Assembly.block_loop` where lanes take steps of their own.

        All blocks go through the common step; those with a lane that it does not serve wait, so
        that such lanes of the whole batch fill the scratch block together.
        """
        common = [] if self.plan_of_steps == "adaptive" else ["step(W, o)"]
        if self.plan_of_steps != "fixed":
            return [
                "waiting = False",
                "for sweep in range(2):",
                "    if sweep == 1:",
                "        if not waiting:",
                "            break",
                "        redo(W, 0, count)",
                f"    for b in range({BLOCKS}):",
                *block(HEAD, 2),
                "        if sweep == 0:",
                *block([*first, "clear(W, o)", "start(W, o)", *common, "judge(W, o)"], 3),
                "            if any_marked(W, o):",
                "                waiting = True",
                "                continue",
                "        elif not any_marked(W, o):",
                "            continue",
                *block(then, 2),
            ]
        return [
            f"for begin_block in range(0, {BLOCKS}, {GROUP}):",
            f"    end_block = min({BLOCKS}, begin_block + {GROUP})",
            "    for b in range(begin_block, end_block):",
            *block([*HEAD, *first, "clear(W, o)"], 2),
            "    for _ in range(substeps):",
            "        waiting = False",
            "        for b in range(begin_block, end_block):",
            *block(["o = b * STRIDE", "start(W, o)", "step(W, o)", "judge(W, o)"], 3),
            "            if any_marked(W, o):",
            "                waiting = True",
            "        if waiting:",
            f"            redo(W, begin_block * {LANES}, min(count, end_block * {LANES}))",
            "    for b in range(begin_block, end_block):",
            *block([*HEAD, *then], 2),
        ]
