"""A control interval of a lane: the step that all lanes take together, and the local steps of the others.

A lane leaves the common step for three reasons: an error above its tolerance, a stop that it meets, and the
integrator dop853, whose steps are always local.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from redundant_envs.algebra import where
from redundant_envs.quantities import check_names
from redundant_envs.simulator.fields import copies, motion_fields
from redundant_envs.simulator.lane import LOG, SCRATCH, STATE, Field, Lane, Layout
from redundant_envs.simulator.local_steps import LocalSteps
from redundant_envs.simulator.names import OF_THE_FIELD, names_of_arm, owners
from redundant_envs.simulator.setting import MOST_LOGGED, SEARCH, WATCHED, Plan
from redundant_envs.simulator.step import known_numbers


class Interval(LocalSteps):
    """The procedures of the lanes of a scene in a control interval, and their fields."""

    def fields(self) -> Iterator[Field]:
        """Fields of the lanes."""
        dynamics = self.dynamics
        yield from motion_fields(dynamics)
        if not self.local:
            return
        for name in self.active:
            yield Field(name, "", "side of the stop a slider rests at: 1 upper, -1 lower, 0 none", STATE)
        if self.plan is Plan.ADAPTIVE:
            yield Field("next_step", "s", "length of the next step", STATE)
        kept = [Field(name, "", name, STATE, book=name == "work") for name in self.kept]
        yield from copies(kept, "{}_start", "before the common step")
        if self.origin != "{}_start":
            yield from copies(kept, self.origin, "when the interval began")
        yield from copies(kept, "{}_trial", "at the start of the trial step")
        for name, unit, doc in (
            ("evaluations", "", "evaluations of the right-hand side"),
            ("reason", "", "why the lane leaves the common step (Reason)"),
            ("error_start", "m", "error before the common step"),
            ("error_trial", "m", "error at the start of the trial step"),
            ("min_steps", "", "least number of steps allowed; 0 where one may serve"),
            ("step", "s", "length of the trial step"),
            ("left", "s", "time left of the planned step"),
            ("elapsed", "s", "time since the common step began"),
            ("phase", "", "what the lane does next (Phase)"),
            ("divisions", "", "into how many steps the interval is divided"),
            ("steps_left", "", "planned steps to go, or steps made (dop853)"),
        ):
            yield Field(name, unit, doc, SCRATCH)
        for name, doc in (
            ("entered", "has just left the common step"),
            ("due", "has made a trial step that is not judged yet"),
            ("complete", "has crossed its interval, or given it up"),
        ):
            yield Field(name, "", doc, SCRATCH, truth=True)
        for q in dynamics.arm.coordinates:
            yield Field(f"{q}_seen", "", f"{q} at the end of the interval the time before", SCRATCH)
        for name, doc in self.doubts.items():
            yield Field(name, "", doc, SCRATCH, truth=True)
        if self.boundaries:
            yield from self._fields_of_events()
        if self.stops:
            yield from self._fields_of_stops()

    def _fields_of_events(self) -> Iterator[Field]:
        for name, unit, doc in (
            ("searched", "", "trial steps in search of the present event"),
            ("slide", "s", "time of the Taylor step to a stop"),
            *((name, "", "of the search for an event (Search)") for name in SEARCH),
        ):
            yield Field(name, unit, doc, SCRATCH)
        for b in self.boundaries:
            for name in WATCHED:
                doc = "acceleration at the stages, or pull of the stop"
                yield Field(f"{name}_{b.name}", "m/s^2 or N", f"{name} {doc}", SCRATCH)
            for name, unit, doc in (
                ("crossing", "", "how the trial step meets a stop (Crossing)"),
                ("turning", "s", "when the joint turns in the trial step"),
            ):
                yield Field(f"{name}_{b.name}", unit, doc, SCRATCH)
            yield Field(f"cleared_{b.name}", "", "is known to turn before its stop", SCRATCH, truth=True)
        for s in self.switches:
            yield Field(s.side, "", "which law of a force holds: 1 above, -1 below, 0 between", SCRATCH)
            yield Field(f"{s.side}_start", "", f"{s.side} before the common step", SCRATCH)

    def _fields_of_stops(self) -> Iterator[Field]:
        dynamics = self.dynamics
        for name, doc in (
            ("impacts", "impacts of the interval"),
            ("impacts_start", "impacts before the common step"),
            ("changes", "times that contacts were resolved"),
        ):
            yield Field(name, "", doc, SCRATCH)
        for name, doc in (("touching", "contacts come next"), ("held", "a slider rests at its stop")):
            yield Field(name, "", doc, SCRATCH, truth=True)
        for v in dynamics.states[dynamics.count :]:
            yield Field(f"{v}_slope", "", f"time derivative of {v}", SCRATCH, book=v == "work")
        for s in self.stops:
            for name, unit, doc in (
                ("force", "N", "that holds the slider"),
                ("force_trial", "N", "force at the start of the trial step"),
            ):
                yield Field(f"{name}_{s.name}", unit, doc, SCRATCH)
            yield Field(
                f"happened_{s.name}", "", "what the contact was resolved to (Event)", SCRATCH, book=True
            )
            yield Field(f"speed_{s.name}", "m/s", "into the stop, before an impact", SCRATCH, book=True)
            doc = "leaves its stop and does not rest there before it is struck"
            yield Field(f"released_{s.name}", "", doc, SCRATCH, truth=True)
            for v in dynamics.arm.rates:
                yield Field(f"mobility_{v}_{s.name}", "", f"{v} per impulse along {s.name}", SCRATCH)
        if self.logs:
            yield Field("span_start", "s", "when the common step began", SCRATCH, book=True)
            yield Field("logged_start", "", "events kept before the common step", SCRATCH, book=True)
            yield Field("logged", "", "events kept", STATE, book=True)
            for n in range(MOST_LOGGED):
                for name, unit in (("time", "s"), ("kind", ""), ("speed", "m/s")):
                    yield Field(f"log_{name}_{n}", unit, f"{name} of event {n}", LOG)

    def renew(self, lane: Lane) -> None:
        """At the end of an interval: update the states of effects that were constant in it."""
        dynamics = self.dynamics
        if dynamics.remembered:
            numbers = known_numbers(dynamics, lane, held=False)
            x = dynamics.quantities(lane.get(dynamics.states), numbers)
            for name, value in dynamics.updates(x).items():
                lane[name] = value

    def undo(self, lane: Lane, failed: Any) -> None:
        """Return lanes that failed to their states at the start of the interval."""
        for name in self.kept:
            lane[name] = where(failed, lane[self.origin.format(name)], lane[name])

    def layout(self) -> Layout:
        fields, arm = list(self.fields()), self.dynamics.arm
        check_names(f"{arm.kind}.functions", names_of_arm(arm), owners(fields, OF_THE_FIELD))
        return Layout(fields)
