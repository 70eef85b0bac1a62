"""What stops add to lanes with steps of their own, as text: contacts, impulses, the log of events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from redundant_envs.algebra import gives_of
from redundant_envs.effects.hooks import Impact
from redundant_envs.evaluators.assemble import EVENT_BUDGET, LANES, Assembly
from redundant_envs.evaluators.assemble_step import right_hand_side, step_of
from redundant_envs.evaluators.quantities import calls
from redundant_envs.evaluators.text import indent, words
from redundant_envs.integrators import contacts, stops
from redundant_envs.integrators.tableaus import METHODS
from redundant_envs.scene import identifier

if TYPE_CHECKING:
    from redundant_envs.evaluators.assemble_lanes import LaneSteps

MOST_LOGGED = 256
"""Events of an interval that a scene with the book of the work keeps."""
LOGGED = ("time", "kind", "speed")
RELEASE = 4.0  # the kind, as contacts.touch tells it
MODES = ("mode_a", "mode_a_before", "mode_b", "mode_b_before")
MEETINGS = {f"{n}_{x}": f"{n}_{x}_now" for x in "ab" for n in ("met", "turns")}


@dataclass(frozen=True)
class StopLines:
    """Text about the sliders a and b of a scene with stops.

    Attributes
    ----------
    lanes : LaneSteps
    stops : tuple of (effect key, Impact)
    """

    lanes: LaneSteps
    stops: tuple[tuple[str, Impact], ...]

    @property
    def assembly(self) -> Assembly:
        """The scene's assembly."""
        return self.lanes.assembly

    def use(self, function: Callable[..., Any]) -> str:
        """Name of a dialect function in the text, which it then is part of."""
        return self.lanes.use(function)

    def call(self, function: Callable[..., Any]) -> str:
        """A statement that gives a dialect function the quantities of its arguments' names."""
        return self.lanes.call(function)

    def _number(self, stop: int, field: str) -> str:
        """Identifier of a stop's own number."""
        key, hook = self.stops[stop]
        return identifier(f"{key}{getattr(hook, field)}")

    @cached_property
    def sliders(self) -> list[str]:
        """Lines that give the sliders a and b the names that the equations of the stops use."""
        arm, lines = self.assembly.scene.robot, []
        for n, (x, (_, hook)) in enumerate(zip("ab", self.stops, strict=False)):
            q, v = arm.coordinates[hook.joint], arm.rates[hook.joint]
            lines += [
                f"place_{x} = {q}", f"rate_{x} = {v}",
                f"lower_{x} = {self._number(n, 'lower')}", f"upper_{x} = {self._number(n, 'upper')}",
            ]  # fmt: skip
        return [*lines, f"restitution = {self._number(0, 'restitution')}"]

    def begun(self, origin: str) -> list[str]:
        """The same for where the sliders were."""
        arm = self.assembly.scene.robot
        return [
            f"{name}_{x}_{origin} = {rows[hook.joint]}_{origin}"
            for x, (_, hook) in zip("ab", self.stops, strict=False)
            for name, rows in (("place", arm.coordinates), ("rate", arm.rates))
        ]

    def meetings(self, origin: str) -> list[str]:
        """Lines that tell how a step from ``origin`` meets the stops."""
        lines = [*self.sliders, *self.begun(origin)]
        for x, (_, hook) in zip("ab", self.stops, strict=False):
            start = f"place_{x}_{origin}, rate_{x}_{origin}, place_{x}, rate_{x}, h"
            numbers = f"{self.seen(x)}, lower_{x}, upper_{x}"
            lines.append(f"met_{x}_now, turns_{x}_now = {self.use(hook.function)}({start}, {numbers})")
        return lines

    @property
    def mobilities(self) -> list[str]:
        """Lines that name the mobilities of the sliders, of the last contact."""
        sa, sb = (hook.joint + 1 for _, hook in self.stops)
        return [f"waa = mobility{sa}_a", f"wab = mobility{sa}_b", f"wbb = mobility{sb}_b"]

    @property
    def unseen(self) -> tuple[str, str]:
        """What accelerations may do between the stages of a step and near its ends, as text."""
        method = METHODS[self.assembly.scene.integrator]
        return repr(method.unseen(at_ends=False)), repr(method.unseen(at_ends=True))

    def seen(self, x: str) -> str:
        """Arguments that tell of the accelerations of a slider in a step, or of its stop's pull."""
        return f"least_{x}, most_{x}, accel_{x}_first, accel_{x}_last, {', '.join(self.unseen)}"

    def held(self) -> list[str]:
        """The step with sliders at rest, and the contacts."""
        a = self.assembly
        arm: Any = a.scene.robot
        functions: list[Any] = [f for f in arm.functions if "qdd1" not in gives_of(f)]
        functions.append(arm.held_dynamics)
        joints = [hook.joint + 1 for _, hook in self.stops]
        at_rest = [f"held{k} = abs({m})" for k, m in zip(joints, self.lanes.modes, strict=True)]
        arguments, motion, used = right_hand_side(a, functions, [f"held{k}" for k in joints])
        contact = [*at_rest, *motion[:-1]]
        pulls = [
            f"pull_{x} = where(held{k} > 0.0, mode_{x} * hold{k}, 0.0)"
            for x, k in zip("ab", joints, strict=True)
        ]
        arguments = [*(n for n in arguments if not n.startswith("held")), *self.lanes.modes]
        # What tells of a slider in a step: its acceleration, or the pull of the stop it rests at.
        sign = [
            f"sign_{x} = where(held{k} > 0.0, pull_{x}, qdd{k})" for x, k in zip("ab", joints, strict=True)
        ]
        rhs = arguments, [*contact, *pulls, *sign, f"{motion[-1]}, sign_a, sign_b"], used
        press = [*contact, *pulls]
        lines, step_functions = step_of(a, rhs, ["sign_a", "sign_b"])
        last = METHODS[a.scene.integrator].stages - 1
        signs = {f"accel_{x}_{n}": f"sign_{x}_k{i}" for x in "ab" for n, i in (("first", 0), ("last", last))}
        signs |= {f"{end}_{x}": f"sign_{x}_{end}" for x in "ab" for end in ("least", "most")}
        lines.append("moving = where(phase >= 2.0, where(phase <= 5.0, 1.0, 0.0), 0.0)")
        self.lanes.used.extend(step_functions)
        known = {*a.states, *a.numbers, *words(line.split(" = ")[0] for line in contact)}
        mobility = {
            f"mobility{i}_{x}": f"W{i}{k}" for x, k in zip("ab", joints, strict=True) for i in range(1, 5)
        }
        for call in calls(mobility.values(), known, (*functions, arm.slider_mobility), arm.sincos):
            a.names.emit(call, contact, self.lanes.used)
        (ka, kb), at = joints, self.use(stops.at_stop)
        let_go = [
            *contact,
            *self.sliders,
            *(
                f"hold_{x}, at_{x} = hold{k}, {at}(place_{x}, mode_{x}, lower_{x}, upper_{x})"
                for x, k in zip("ab", joints, strict=True)
            ),
            f"waa, wab, wbb = W{ka}{ka}, W{kb}{ka}, W{kb}{kb}",
            self.call(contacts.leaving),
        ]
        slopes = ("qdd1", "qdd2", "qdd3", "qdd4", "power")
        slopes_of = {f"slope_{s}": d for s, d in zip(a.states[4:], slopes, strict=False)}
        holds = {f"hold_{x}": f"hold{k}" for x, k in zip("ab", joints, strict=True)}
        writes = {s: f"where(moving > 0.0, {s}_new, {s})" for s in a.states}
        free = ("step", {**dict.fromkeys(self.lanes.modes, 0.0), **self.lanes.constant})
        return [
            a.rhs_function(rhs) + a.subroutine(2),
            a.lane_function(
                "step_held",
                "One step of the lanes of a block that move.",
                lines,
                {**writes, **a.error_writes, **signs},
                special=free,
            ),
            a.lane_function(
                "press",
                "After a step: how hard a stop would have to pull a slider, now or at a stage.",
                press,
                {
                    f"{end}_{x}": f"where(held{k} > 0.0, {rule}({end}_{x}, pull_{x}), {end}_{x})"
                    for x, k in zip("ab", joints, strict=True)
                    for end, rule in (("least", "minimum"), ("most", "maximum"))
                }
                | {
                    f"accel_{x}_last": f"where(held{k} > 0.0, pull_{x}, accel_{x}_last)"
                    for x, k in zip("ab", joints, strict=True)
                },
            ),
            a.lane_function(
                "let_go",
                "Before a common step: sliders that leave their stops at once.",
                let_go,
                {f"mode_{x}": f"where(leaves_{x} > 0.0, 0.0, mode_{x})" for x in "ab"},
            ),
            a.lane_function(
                "contact",
                "Accelerations, the forces that hold, and mobilities, of the present state.",
                contact,
                {**slopes_of, **holds, **mobility},
            ),
        ]

    def touch(self) -> str:
        """At a stop: impulses, rest and release, as :func:`contacts.touch` decides."""
        a, arm = self.assembly, self.assembly.scene.robot
        sa, sb = (hook.joint for _, hook in self.stops)
        moving = a.states[4:]
        # What a Taylor step to the stop has left to do, now that accelerations are known.
        rest = (f"where(slide == 0.0, {s}, {s} + slide * slope_{s})" for s in moving)
        lines = [
            *self.lanes.sums_before,
            f"{', '.join(moving)}, = {', '.join(rest)},",
            *self.sliders,
            *(f"accel_{x} = slope_{arm.rates[j]}" for x, j in zip("ab", (sa, sb), strict=True)),
            *self.mobilities,
            self.call(contacts.touch),
        ]  # fmt: skip
        writes = {f"{m}": f"where(over_budget > 0.0, {m}_before, {m}_new)" for m in self.lanes.modes}
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
            "events": "where(over_budget > 0.0, events_before, events_new)",
            "changes": "changes_new", "phase": "phase_new",
            "touching": "where(phase_new == 1.0, 1.0, 0.0)", "slide": "0.0",
            "trouble": f"where(over_budget > 0.0, {EVENT_BUDGET}, trouble)",
        }  # fmt: skip
        for x in "ab":
            writes[f"let_go_{x}"] = f"let_go_{x}_new"
            writes[f"hold_{x}_from"] = f"where(going_on > 0.0, holds_{x}, hold_{x}_from)"
            if self.lanes.log:
                writes["logged"] = "where(over_budget > 0.0, logged_before, logged)"
                writes |= {f"told_{x}": f"told_{x}_new", f"told_speed_{x}": f"told_speed_{x}_new"}
                lines.append(f"told_{x}_new, told_speed_{x}_new = told_now_{x}, told_speed_now_{x}")
        return a.lane_function("touch", "At a stop: strike, let go, rest, or go on.", lines, writes)

    def contact_needed(self, suffix: str = "") -> str:
        """Whether a slider is at a stop, or held there: an expression, 0 if not."""
        at = self.use(stops.at_stop)
        return " + ".join(
            f"abs({at}(place_{x}{suffix}, mode_{x}{suffix}, lower_{x}, upper_{x}))" for x in "ab"
        )

    def tell(self) -> str:
        """The log of events, where it is kept."""
        rows = self.assembly.every_row
        row = {
            n: rows[n] * LANES
            for n in ("told_a", "told_b", "told_speed_a", "told_speed_b", "elapsed", "span_start", *MODES)
        }
        log = rows["logged"] * LANES
        append = [
            '"""Write an event into the log of lane i, if that has room."""',
            f"n = int(M[o + i + {log}])",
            f"if n < {MOST_LOGGED}:",
            f"    at = o + i + {log + LANES} + n * {len(LOGGED) * LANES}",
            "    M[at] = time",
            f"    M[at + {LANES}] = kind",
            f"    M[at + {2 * LANES}] = speed",
            f"    M[o + i + {log}] += 1.0",
        ]
        tell = [
            '"""Write the events of the sliders into the log of their lane."""',
            f"for i in range({LANES}):",
            f"    for told, speed, slider in (({row['told_a']}, {row['told_speed_a']}, 0.0), "
            f"({row['told_b']}, {row['told_speed_b']}, 10.0)):",
            "        if S[i + told] > 0.0:",
            f"            time = S[i + {row['span_start']}] + S[i + {row['elapsed']}]",
            "            append(S, 0, i, time, S[i + told] + slider, S[i + speed])",
        ]
        tell_let_go = [
            '"""Write into the logs of a block which sliders have been let go before its step."""',
            f"for i in range({LANES}):",
            f"    for mode, was, slider in (({row['mode_a']}, {row['mode_a_before']}, 0.0), "
            f"({row['mode_b']}, {row['mode_b_before']}, 10.0)):",
            "        if W[o + i + mode] != W[o + i + was]:",
            f"            append(W, o, i, W[o + i + {row['span_start']}], {RELEASE} + slider, 0.0)",
        ]
        return (
            f"@njit(**OPTIONS)\ndef append(M, o, i, time, kind, speed):\n{indent(append, 1)}\n\n\n"
            f"@njit(**OPTIONS)\ndef tell(S):\n{indent(tell, 1)}\n\n\n"
            f"@njit(**OPTIONS)\ndef tell_let_go(W, o):\n{indent(tell_let_go, 1)}"
        )
