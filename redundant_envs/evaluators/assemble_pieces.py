"""What lanes with steps of their own do in the scratch block, as text: begin, look, decide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from redundant_envs.evaluators.assemble import EVENT_BUDGET, NO_STEP_FOUND, TOLERANCE_NOT_REACHED
from redundant_envs.evaluators.assemble_stops import MEETINGS
from redundant_envs.evaluators.quantities import calls
from redundant_envs.evaluators.text import indent
from redundant_envs.integrators import stops
from redundant_envs.integrators.tableaus import METHODS

if TYPE_CHECKING:
    from redundant_envs.evaluators.assemble_lanes import LaneSteps


MOST_PIECES = 65536
"""Of an interval that is crossed with 1, 2, 4, ... 16384 steps: twice as many as those without an event."""


@dataclass(frozen=True)
class PieceLines:
    """Text about the pieces of motion in the scratch block.

    Attributes
    ----------
    lanes : LaneSteps
    """

    lanes: LaneSteps

    def begin(self) -> str:
        """Lanes that have just come from the common step."""
        a = self.lanes.assembly
        lines, fresh = [*self.lanes.sums_before, self.lanes.call(self.lanes.rules.begin)], "0.0"
        if self.lanes.stops:
            lines += [*self.lanes.at_stops.sliders, *self.lanes.at_stops.begun("before")]
            lines.append(f"contacts = {self.lanes.at_stops.contact_needed('_before')}")
            # What is known of the common step saves trying it again.
            start = self.lanes.use(stops.starts_at_stop)
            begun = (
                f"{start}(place_{x}_before, rate_{x}_before, mode_{x}_before, lower_{x}, upper_{x})"
                for x in "ab"
            )
            lines.append(f"begun_at_stop = {' + '.join(begun)}")
            fresh = "where(void + begun_at_stop + abs(mode_a_before) + abs(mode_b_before) > 0.0, 0.0, 1.0)"
        lines.append(f"fresh = {fresh}")
        now = "newly > 0.0"
        values = {
            **{s: f"where(fresh > 0.0, {s}, {s}_before)" for s in a.states},
            **{f"{s}_from": f"{s}_before" for s in a.states},
            "error_sum": "where(fresh > 0.0, error_sum, error_before)",
            "from_error": "error_before", "elapsed": "0.0", "left": "left_first", "due": "fresh",
            "h": "where(fresh > 0.0, h, left_first)", "phase": "2.0",
        }  # fmt: skip
        if self.lanes.plan_of_steps == "doubling":
            values |= {"steps_of_lane": "steps_first", "steps_left": "steps_first"}
            values |= {f"{q}_seen": "1e300" for q in self.lanes.coordinates}
        if self.lanes.plan_of_steps == "adaptive":
            values |= {"next_step": "next_first", "steps_left": "0.0"}
        if self.lanes.stops:
            values["phase"] = "where(fresh > 0.0, 2.0, where(contacts > 0.0, 1.0, 2.0))"
            zero = ["changes", "searched", "tries", "slide"]
            zero += [f"cleared_{x}" for x in "ab"]
            values |= dict.fromkeys(zero, "0.0")
            values |= self.leaving()
            values |= {m: f"{m}_before" for m in (*self.lanes.modes, *self.lanes.log[:1])}
        writes = {name: f"where({now}, {value}, {name})" for name, value in values.items()}
        writes["newly"] = "0.0"
        if self.lanes.stops:
            lines.append(f"phase_now = {writes['phase']}")
            writes |= {"phase": "phase_now", "touching": "where(phase_now == 1.0, 1.0, 0.0)"}
        return a.lane_function(
            "begin_lanes", "Lanes that have just come from the common step.", lines, writes
        )

    def look(self) -> str:
        """After a piece: count it, and how it meets the stops."""
        writes: dict[str, str] = {}
        lines = ["moved = where(phase >= 2.0, where(phase <= 5.0, 1.0, 0.0), 0.0)"]
        if self.lanes.stops:
            lines += self.lanes.at_stops.meetings("from")
            writes |= {**MEETINGS, "held": "abs(mode_a) + abs(mode_b)"}
        writes |= {"due": "moved", "evaluations": f"evaluations + moved * {self.lanes.stages}"}
        return self.lanes.assembly.lane_function("look", "After a piece of motion.", lines, writes)

    def decide(self) -> str:
        """After a piece: what the lane does next."""
        a = self.lanes.assembly
        tried = "where(phase == 2.0, 1.0, where(phase == 4.0, 1.0, 0.0))"
        lines = list(self.lanes.sums_before)
        if self.lanes.plan_of_steps == "doubling":
            lines.append(self.lanes.least_steps())
        lines.append(self.lanes.call(self.lanes.rules.judge))
        if self.lanes.stops:
            lines += [
                *self.lanes.at_stops.sliders,
                *self.lanes.at_stops.begun("from"),
                *self.lanes.at_stops.begun("before"),
                f"smooth = {float(METHODS[a.scene.integrator].stages > 1)}",
                f"unseen, unseen_end = {', '.join(self.lanes.at_stops.unseen)}",
                *self.lanes.at_stops.mobilities,
                self.lanes.call(stops.decide),
            ]
        else:
            lines += ["again, there, accepted, events = 0.0, 0.0, due * good, 0.0"]
        anew = self.lanes.plan_of_steps == "doubling"  # a failed piece begins the interval anew, not itself
        lost = "due * where(searched < 500.0, where(left - h == left - h, 0.0, 1.0), 1.0)"
        if anew:
            most = MOST_PIECES * METHODS[a.scene.integrator].stages
            lost = f"maximum({lost}, where(evaluations < {most}.0, 0.0, due))"
        lines += [
            f"failed = due * {tried} * (1.0 - good)",
            f"h_moved = {'h + slide_new' if self.lanes.stops else 'h'}",
            "left_moved = left - h_moved",
            "ended = where(accepted > 0.0, where(left_moved > 0.0, 0.0, 1.0), 0.0)",
            # No event is looked for without end, and no time that is not a number is waited for.
            f"lost = {lost if self.lanes.stops else '0.0'}",
            "elapsed_new = elapsed + h_moved",
            *self.change(),
            self.lanes.call(self.lanes.rules.end),
            *(["failed = maximum(failed, unsure)"] if anew else []),
            *(["accepted = accepted * (1.0 - unsure)", "ended = ended * (1.0 - unsure)"] if anew else []),
            f"back = {'maximum(failed, lost)' if anew else 'lost'}",
            f"retry = {'0.0' if anew else 'failed'}",
            "moved = accepted + there",
            "elapsed_new = where(back > 0.0, 0.0, where(moved > 0.0, elapsed_new, elapsed))",
            "done = ended * last",
            "continuing = accepted * (1.0 - done)",
            "left_new = where(failed > 0.0, left_retry, where(ended > 0.0, left_again, "
            "where(moved > 0.0, left_moved, left)))",
        ]  # fmt: skip
        if self.lanes.stops:
            # A held slider has just shown that it stays; a free one at its stop must be looked at.
            at = self.lanes.use(stops.at_stop)
            free = " + ".join(
                f"where(mode_{x} == 0.0, abs({at}(place_{x}, mode_{x}, lower_{x}, upper_{x})), 0.0)"
                for x in "ab"
            )
            lines += [
                f"contacts = where({free} > 0.0, 1.0, 0.0)",
                f"contacts_before = where({self.lanes.at_stops.contact_needed('_before')} > 0.0, 1.0, 0.0)",
            ]
        else:
            lines += ["contacts, contacts_before = 0.0, 0.0"]
        lines += [
            "goes = continuing * (1.0 - contacts)",
        ]
        piece = "h_next_piece" if self.lanes.stops else "h"
        writes: dict[str, str] = {}
        arm = a.scene.robot
        places = {
            arm.coordinates[hook.joint]: f"place_{x}_new"
            for x, (_, hook) in zip("ab", self.lanes.stops, strict=False)
        }
        for s, rate in zip(arm.coordinates, arm.rates, strict=True):
            if self.lanes.stops and s not in places:
                places[s] = f"{s} + slide_new * {rate}"
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
        if self.lanes.stops:
            phase = f"where(again > 0.0, phase_next, where(there > 0.0, 1.0, {phase}))"
            phase = f"where(lost > 0.0, 6.0, {phase})"
        lines.append(f"phase_new = where(due > 0.0, where(done > 0.0, 6.0, {phase}), phase)")
        writes["phase"] = "phase_new"
        if self.lanes.plan_of_steps == "doubling":
            writes |= {
                "floor": "floor_new",
                "steps_of_lane": "where(back > 0.0, steps_retry, steps_of_lane)",
                "steps_left": "where(back > 0.0, steps_retry, "
                "where(ended > 0.0, steps_left_again, steps_left))",
                **{f"{q}_seen": f"where(unsure * last > 0.0, {q}, {q}_seen)" for q in self.lanes.coordinates},
            }
        if self.lanes.plan_of_steps == "adaptive":
            writes["steps_left"] = "steps_left + due"
            writes["next_step"] = "where(accepted + failed > 0.0, next_new, next_step)"
        if self.lanes.plan_of_steps != "fixed":
            fault = NO_STEP_FOUND if self.lanes.plan_of_steps == "adaptive" else TOLERANCE_NOT_REACHED
            writes["trouble"] = f"where(done * flagged > 0.0, {fault}, trouble)"
        if self.lanes.stops:
            writes["searched"] = "where(again > 0.0, searched + 1.0, where(due > 0.0, 0.0, searched))"
            ends = writes.get("trouble", "trouble")
            writes["trouble"] = f"where(lost > 0.0, {EVENT_BUDGET}, {ends})"
            writes["slide"] = "where(due > 0.0, slide_new, slide)"
            for name in ("target", "side", "low", "high", "gap_low", "gap_high", "tries"):
                writes[name] = f"where(again > 0.0, {name}_new, {name})"
            for x in "ab":
                writes[f"mode_{x}"] = f"where(back > 0.0, mode_{x}_before, mode_{x})"
                writes[f"cleared_{x}"] = (
                    f"where(again > 0.0, cleared_{x}_new, where(due > 0.0, 0.0, cleared_{x}))"
                )
                leaves = self.leaving()[f"let_go_{x}"]
                writes[f"let_go_{x}"] = f"where(back > 0.0, {leaves}, where(goes > 0.0, 0.0, let_go_{x}))"
                writes[f"hold_{x}_from"] = f"where(goes > 0.0, hold_{x}, hold_{x}_from)"
            writes |= {
                "touching": "where(phase_new == 1.0, 1.0, 0.0)",
                "changes": "where(back > 0.0, 0.0, changes)",
                "events": "where(back > 0.0, events_before, events)",
            }
            if self.lanes.log:
                writes["logged"] = "where(back > 0.0, logged_before, logged)"
        return a.lane_function("decide", "After a piece of motion: what a lane does next.", lines, writes)

    def leaving(self) -> dict[str, str]:
        """Rows that keep a slider from resting, at the start of an interval."""
        rule = self.lanes.use(stops.leaves_stop)
        start = "place_{0}_before, rate_{0}_before, mode_{0}_before, lower_{0}, upper_{0}"
        return {f"let_go_{x}": f"{rule}({start.format(x)})" for x in "ab"}

    def change(self) -> list[str]:
        """Lines that tell by how much an interval came out otherwise than the time before, m at the tip."""
        if not self.lanes.coordinates:
            return []
        a = self.lanes.assembly
        arm = a.scene.robot
        lines: list[str] = []
        norms = [f"n{k}" for k in range(1, 5)]
        for call in calls(norms, {*a.states, *a.numbers}, (*arm.functions, arm.column_norms), arm.sincos):
            a.names.emit(call, lines, self.lanes.used)
        terms = (f"{n} * abs({q} - {q}_seen)" for n, q in zip(norms, arm.coordinates, strict=True))
        return [*lines, f"change = {' + '.join(terms)}"]

    def another_piece(self) -> str:
        """What happens to the slots of the scratch block between two looks at who is complete."""
        if not self.lanes.stops:
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
                *(["    tell(S)"] if self.lanes.log else []),
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
        return f"{self.lanes.at_stops.tell()}\n\n\n{text}" if self.lanes.log else text
