"""A control interval of a lane: the step that all make together, and what those do that it does not serve.

Three things make a lane leave the common step: an error above its tolerance, a stop that it meets, and the
integrator dop853, whose steps are always a lane's own (local time stepping).
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.algebra import any_of, cases, logical_not, maximum, minimum, where
from redundant_envs.integrators import contacts, events, step_control
from redundant_envs.integrators.events import Phase
from redundant_envs.integrators.methods import Watched
from redundant_envs.simulator.dynamics import Dynamics, Stop
from redundant_envs.simulator.fields import copies, motion_fields
from redundant_envs.simulator.lane import LOG, SCRATCH, STATE, Field, Lane, Layout
from redundant_envs.simulator.step import (
    active_stop,
    contact_quantities,
    known_numbers,
    lane_step,
    pull,
    step_error,
    tip_norms,
)


class Fault(enum.IntFlag):
    """What went wrong in a lane; the one place where it is reported (``info["numerics"]``)."""

    NON_FINITE = 1
    BAD_ACTION = 2
    SPEED_BOUND = 4
    TOLERANCE_NOT_REACHED = 8
    EVENT_BUDGET = 16
    NO_STEP_FOUND = 32


GIVEN_UP = Fault.EVENT_BUDGET
"""From this fault on the interval was not crossed, and its lane is back where it began."""


class Reason(enum.IntEnum):
    """Why a lane leaves the common step."""

    NONE = 0
    ACCURACY = 1
    STOP = 2
    NEAR_STOP = 3
    """Not known yet, but near a stop."""


class Plan(enum.Enum):
    """How the steps of a lane are chosen."""

    FIXED = "fixed"
    DOUBLING = "doubling"
    ADAPTIVE = "adaptive"


MOST_SEARCHED = 500
"""Trial steps in search of one event; with more the interval is given up."""
MOST_TRIALS = 65536
"""Of an interval that is crossed with 1, 2, 4, ... 16384 steps: twice as many as those without an event."""
MOST_LOGGED = 256
"""Events of an interval that are kept where the work is tracked."""
WATCHED = Watched._fields
SEARCH = events.Search._fields


@dataclass(frozen=True)
class Interval:
    """What the lanes of a scene do in a control interval."""

    dynamics: Dynamics

    @cached_property
    def plan(self) -> Plan:
        scene = self.dynamics.scene
        if scene.integrator == "dop853":
            return Plan.ADAPTIVE
        return Plan.FIXED if scene.tolerance is None else Plan.DOUBLING

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        return self.dynamics.stops

    @property
    def local(self) -> bool:
        """Whether lanes may take steps of their own."""
        return bool(self.stops) or self.plan is not Plan.FIXED

    @property
    def repeated(self) -> bool:
        """Whether an interval is several common steps."""
        return self.dynamics.scene.substeps > 1

    @property
    def estimates(self) -> bool:
        """Whether the method has an error estimate."""
        return bool(self.dynamics.method.error5)

    @property
    def logs(self) -> bool:
        """Whether events are kept."""
        return bool(self.stops) and self.dynamics.track_work

    @property
    def origin(self) -> str:
        """Form of the fields that hold what a lane was when the interval began."""
        return "{}_interval" if self.local and self.plan is Plan.FIXED and self.repeated else "{}_start"

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Fields of the stops at which sliders rest."""
        return tuple(active_stop(s.name) for s in self.stops)

    @property
    def kept(self) -> tuple[str, ...]:
        """What a lane has when an interval begins, and again when the interval is given up."""
        return (*self.dynamics.states, *self.active)

    @property
    def positions(self) -> list[str]:
        """Coordinates of the sliders with stops."""
        return [self.dynamics.arm.coordinates[s.joint] for s in self.stops]

    @property
    def rates(self) -> list[str]:
        return [self.dynamics.arm.rates[s.joint] for s in self.stops]

    @cached_property
    def unseen(self) -> events.Unseen:
        method = self.dynamics.method
        return events.Unseen(method.unseen(at_ends=False), method.unseen(at_ends=True))

    # ---- fields ------------------------------------------------------------------------------------

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
        kept = [Field(name, "", name, STATE) for name in self.kept]
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
        if self.stops:
            yield from self._fields_of_stops()

    def _fields_of_stops(self) -> Iterator[Field]:
        dynamics = self.dynamics
        for name, unit, doc in (
            ("impacts", "", "impacts of the interval"),
            ("impacts_start", "", "impacts before the common step"),
            ("changes", "", "times that contacts were resolved"),
            ("searched", "", "trial steps in search of the present event"),
            ("slide", "s", "time of the Taylor step to a stop"),
            *((name, "", "of the search for an event (events.Search)") for name in SEARCH),
        ):
            yield Field(name, unit, doc, SCRATCH)
        for name, doc in (("touching", "contacts come next"), ("held", "a slider rests at its stop")):
            yield Field(name, "", doc, SCRATCH, truth=True)
        for v in dynamics.states[dynamics.count :]:
            yield Field(f"{v}_slope", "", f"time derivative of {v}", SCRATCH)
        for s in self.stops:
            for name in WATCHED:
                doc = "acceleration at the stages, or pull of the stop"
                yield Field(f"{name}_{s.name}", "m/s^2 or N", f"{name} {doc}", SCRATCH)
            for name, unit, doc in (
                ("crossing", "", "how the trial step meets a stop (events.Crossing)"),
                ("turning", "s", "when the slider turns in the trial step"),
                ("force", "N", "that holds the slider"),
                ("force_trial", "N", "force at the start of the trial step"),
                ("happened", "", "what the contact was resolved to (contacts.Event)"),
                ("speed", "m/s", "into the stop, before an impact"),
            ):
                yield Field(f"{name}_{s.name}", unit, doc, SCRATCH)
            for name, doc in (
                ("cleared", "is known to turn before its stop"),
                ("released", "has left its stop and does not rest before it moves"),
            ):
                yield Field(f"{name}_{s.name}", "", doc, SCRATCH, truth=True)
            for v in dynamics.arm.rates:
                yield Field(f"mobility_{v}_{s.name}", "", f"{v} per impulse along {s.name}", SCRATCH)
        if self.logs:
            yield Field("span_start", "s", "when the common step began", SCRATCH)
            yield Field("logged_start", "", "events kept before the common step", SCRATCH)
            yield Field("logged", "", "events kept", STATE)
            for n in range(MOST_LOGGED):
                for name, unit in (("time", "s"), ("kind", ""), ("speed", "m/s")):
                    yield Field(f"log_{name}_{n}", unit, f"{name} of event {n}", LOG)

    # ---- the common step ---------------------------------------------------------------------------

    def clear(self, lane: Lane) -> None:
        """Before an interval."""
        lane.error = 0.0
        if not self.local:
            return
        lane.evaluations = lane.fault = 0.0
        if self.stops:
            lane.impacts = 0.0
        if self.logs:
            lane.logged = 0.0
            lane.span_start = -lane.h if self.plan is Plan.FIXED else 0.0
        if self.origin != "{}_start":
            lane.set(self.kept, lane.get(self.kept), of=self.origin)

    def start(self, lane: Lane) -> None:
        """Before a common step: keep the state, and see which lanes that step may serve."""
        lane.set(self.kept, lane.get(self.kept), of="{}_start")
        lane.error_start = lane.error
        if self.stops:
            lane.impacts_start = lane.impacts
        if self.plan is not Plan.FIXED:
            steps = self.least_steps(lane)
            lane.min_steps = where(steps <= 1.0, 0.0, steps)
        if self.logs:
            lane.logged_start = lane.logged
            if self.plan is Plan.FIXED:
                lane.span_start = lane.span_start + lane.h

    def least_steps(self, lane: Lane) -> Any:
        """How many steps the present rates and all springs and dampers need."""
        arm = self.dynamics.arm
        turning = [abs(lane[v]) for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
        steady = lane.steady if "steady" in self.dynamics.prepared else 0.0
        return step_control.least_steps(reduce(maximum, turning), steady, lane.interval)

    def common_step(self, lane: Lane) -> None:
        """The step of all lanes."""
        self._set_step(lane, lane.h, None)

    def _set_step(self, lane: Lane, h: Any, moving: Any) -> None:
        """The fields of a step; of lanes that are not ``moving`` the state stays."""
        dynamics = self.dynamics
        step = lane_step(dynamics, lane, h, held=bool(self.stops))
        if self.estimates:
            error = step_error(dynamics, lane, step)
            # The error of an adaptive step decides on that step, all others are summed up.
            lane.error = error if self.plan is Plan.ADAPTIVE else lane.error + error
        new = [*step.positions, *step.velocities, *step.others]
        if moving is not None:
            new = [where(moving, x, lane[s]) for s, x in zip(dynamics.states, new, strict=True)]
        lane.set(dynamics.states, new)
        for stop, watched in zip(self.stops, step.watched, strict=True):
            lane.set(WATCHED, watched, of=f"{{}}_{stop.name}")

    def press(self, lane: Lane) -> None:
        """After a step with sliders at rest: how hard a stop would have to pull one now, too."""
        x = self.contact_quantities(lane)
        for s in self.stops:
            held = x[f"held{s.joint + 1}"] > 0.0
            now = pull(x, s.joint, lane[active_stop(s.name)])
            for name, value in (
                ("least", minimum(lane[f"least_{s.name}"], now)),
                ("most", maximum(lane[f"most_{s.name}"], now)),
                ("last", now),
            ):
                lane[f"{name}_{s.name}"] = where(held, value, lane[f"{name}_{s.name}"])

    def contact_quantities(self, lane: Lane) -> Any:
        """Quantities of the present state, with the sliders at rest that are."""
        numbers = known_numbers(self.dynamics, lane, held=True)
        x = contact_quantities(self.dynamics, lane.get(self.dynamics.states), numbers)
        x["derivatives"] = self.dynamics.accelerations(x)
        return x

    def judge(self, lane: Lane) -> None:
        """After a common step: why a lane leaves it, if it does.

        What the step did to a lane that it could not serve is never looked at.
        """
        reason: Any = Reason.NONE
        if self.stops:
            sliders = self.sliders(lane, "{}_start", lane.h)
            pulled = any_of(events.most_pull(s, self.unseen) > 0.0 for s in sliders)
            near = any_of(events.may_meet(s, lane.h, self.unseen) for s in sliders)
            reason = cases((pulled, Reason.STOP), (near, Reason.NEAR_STOP), default=Reason.NONE)
        stages = float(self.dynamics.method.stages)
        if self.plan is Plan.FIXED:
            lane.evaluations = lane.evaluations + stages
        elif self.plan is Plan.DOUBLING:
            # A link that has become fast in the step may have been too fast for it.
            slow = self.least_steps(lane) <= step_control.TOO_FAST
            single = lane.min_steps == 0.0
            served = single & slow & (lane.error <= lane.tip_tolerance)
            reason = where(served, reason, Reason.ACCURACY)
            lane.evaluations = where(single, lane.evaluations + stages, lane.evaluations)
            lane.error = where(single, lane.error, 0.0)
        self._leave(lane, reason)

    def refuse(self, lane: Lane) -> None:
        """Instead of a common step: no lane is served by it."""
        if self.plan is Plan.DOUBLING:
            lane.error = 0.0
        self._leave(lane, Reason.ACCURACY)

    def _leave(self, lane: Lane, reason: Any) -> None:
        # Steps of their own do not help lanes whose state or effort is not finite.
        names = [f"{s}_start" for s in self.dynamics.states[: 2 * self.dynamics.count]]
        defect = self.defect(lane.get((*names, *self.dynamics.commands)))
        lane.reason = where(defect == 0.0, reason, Reason.NONE)
        first = self.dynamics.states[0]
        lane[first] = where(defect == 0.0, lane[first], defect)  # if no step has shown it, this does

    @staticmethod
    def defect(values: list[Any]) -> Any:
        """0 if some numbers are finite, else NaN."""
        return reduce(lambda total, x: total + (x - x), values[1:], values[0] - values[0])

    def sliders(self, lane: Lane, origin: str, h: Any) -> list[events.Slider]:
        """The sliders in a step that began where the fields of a form tell."""
        return [
            events.Slider(
                lane[q], lane[v], lane[origin.format(q)], lane[origin.format(v)],
                Watched(*lane.get(WATCHED, of=f"{{}}_{s.name}")), lane[active_stop(s.name)],
                lane[s.lower], lane[s.upper],
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip

    def _set_crossings(self, lane: Lane, sliders: list[events.Slider], h: Any) -> None:
        for s, slider in zip(self.stops, sliders, strict=True):
            lane[f"crossing_{s.name}"] = events.crossing_of(slider, h, self.unseen)
            lane[f"turning_{s.name}"] = events.turning_time(slider, h)

    def begun_at(self, lane: Lane, rule: Any) -> list[Any]:
        """A rule of :mod:`events` on every slider as it was before the common step."""
        return [
            rule(*lane.get((q, v, active_stop(s.name)), of="{}_start"), lane[s.lower], lane[s.upper])
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]

    def meet(self, lane: Lane) -> None:
        """After :meth:`judge`, where a slider is near a stop: whether it meets it."""
        sliders = self.sliders(lane, "{}_start", lane.h)
        self._set_crossings(lane, sliders, lane.h)
        # A slider that was released before the step starts at its stop and may leave it.
        starts = self.begun_at(lane, events.starts_at_stop)
        meets = any_of(
            slider.free & ((lane[f"crossing_{s.name}"] != 0.0) | start)
            for s, slider, start in zip(self.stops, sliders, starts, strict=True)
        )
        met = where(meets, Reason.STOP, Reason.NONE)
        lane.reason = where(lane.reason == Reason.NEAR_STOP, met, lane.reason)

    # ---- contacts ----------------------------------------------------------------------------------

    def mobility(self, column: Any) -> list[list[Any]]:
        """Mobilities of the sliders: how fast each moves by an impulse along each."""
        upper = {(i, j): column(i, j) for j in range(len(self.stops)) for i in range(j + 1)}
        n = range(len(self.stops))
        return [[upper[min(i, j), max(i, j)] for j in n] for i in n]

    def release(self, lane: Lane) -> None:
        """Before a common step: sliders leave their stops that would have to pull them."""
        x = self.contact_quantities(lane)
        joints = [s.joint + 1 for s in self.stops]
        sliders = [
            contacts.Contact(
                lane[q], lane[v], lane[active_stop(s.name)], lane[s.lower], lane[s.upper], None,
                x[f"hold{s.joint + 1}"], None,
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip
        w = self.mobility(lambda i, j: x[f"W{joints[i]}{joints[j]}"])
        for name, leaves in zip(self.active, contacts.leaving(sliders, w), strict=True):
            lane[name] = where(leaves, 0.0, lane[name])

    def look_at_contacts(self, lane: Lane) -> None:
        """Accelerations, the forces that hold, and mobilities, of the present state."""
        x, dynamics = self.contact_quantities(lane), self.dynamics
        lane.set(dynamics.states[dynamics.count :], x["derivatives"], of="{}_slope")
        for s in self.stops:
            lane[f"force_{s.name}"] = x[f"hold{s.joint + 1}"]
            for k, v in enumerate(dynamics.arm.rates):
                lane[f"mobility_{v}_{s.name}"] = x[f"W{k + 1}{s.joint + 1}"]

    def resolve_contacts(self, lane: Lane) -> None:
        """At a stop: impulses, rest and release, as :func:`contacts.resolve_contacts` decides."""
        dynamics = self.dynamics
        moving = dynamics.states[dynamics.count :]
        # What a Taylor step to the stop has left to do, now that accelerations are known.
        now = {
            s: where(lane.slide == 0.0, lane[s], lane[s] + lane.slide * lane[f"{s}_slope"]) for s in moving
        }
        now |= {q: lane[q] for q in dynamics.arm.coordinates}
        touching = [
            contacts.Contact(
                now[q], now[v], lane[active_stop(s.name)], lane[s.lower], lane[s.upper], lane[f"{v}_slope"],
                lane[f"force_{s.name}"], lane[f"released_{s.name}"],
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip
        rates, names = self.rates, [s.name for s in self.stops]
        w = self.mobility(lambda i, j: lane[f"mobility_{rates[i]}_{names[j]}"])
        r = contacts.resolve_contacts(
            lane.phase, lane.changes, lane.impacts, touching, w, lane[self.stops[0].restitution]
        )
        struck = dict(zip(rates, r.velocities, strict=True))
        for v in dynamics.arm.rates:
            if v not in struck:
                pushes = [j * lane[f"mobility_{v}_{n}"] for j, n in zip(r.impulses, names, strict=True)]
                struck[v] = now[v] + sum(pushes[1:], pushes[0])
        if "work" in now:
            done = [j * (c.velocity + v) for j, c, v in zip(r.impulses, touching, r.velocities, strict=True)]
            struck["work"] = now["work"] + 0.5 * sum(done[1:], done[0])
        for s in dynamics.states:
            after = where(r.strikes, struck[s], now[s]) if s in struck else now[s]
            lane[s] = where(r.given_up, lane[f"{s}_start"], after)
            lane[f"{s}_trial"] = where(r.going_on, after, lane[f"{s}_trial"])
        for name, value in zip(self.active, r.active_stops, strict=True):
            lane[name] = where(r.given_up, lane[f"{name}_start"], value)
        lane.error_trial = where(r.going_on, lane.error, lane.error_trial)
        lane.step = where(r.going_on, lane.left, lane.step)
        lane.impacts = where(r.given_up, lane.impacts_start, r.impacts)
        lane.changes = lane.changes + where(lane.phase == Phase.AT_STOP, 1.0, 0.0)
        lane.fault = where(r.given_up, Fault.EVENT_BUDGET, lane.fault)
        lane.slide = 0.0
        self._set_phase(
            lane, cases((r.given_up, Phase.COMPLETE), (r.going_on, Phase.RUN), default=lane.phase)
        )
        for stop, force, released, happened, speed in zip(
            self.stops, r.forces, r.released, r.happened, r.speeds, strict=True
        ):
            lane[f"force_trial_{stop.name}"] = where(r.going_on, force, lane[f"force_trial_{stop.name}"])
            lane[f"released_{stop.name}"] = released
            if self.logs:
                lane[f"happened_{stop.name}"], lane[f"speed_{stop.name}"] = happened, speed
        if self.logs:
            lane.logged = where(r.given_up, lane.logged_start, lane.logged)

    def _set_phase(self, lane: Lane, phase: Any) -> None:
        lane.phase = phase
        lane.complete = phase == Phase.COMPLETE
        if self.stops:
            lane.touching = phase == Phase.AT_STOP

    # ---- lanes with steps of their own ---------------------------------------------------------------

    def enter(self, lane: Lane) -> None:
        """Lanes that have just left the common step: what is known of it saves trying it again."""
        new = lane.entered
        plan = self._first_plan(lane)
        fresh: Any = False
        phase: Any = Phase.RUN
        if self.stops:
            begun = any_of(self.begun_at(lane, events.starts_at_stop))
            rested = any_of(a != 0.0 for a in lane.get(self.active, of="{}_start"))
            fresh = logical_not(plan.void | begun | rested)
            touched = self._touched_before(lane)
            phase = where(fresh, Phase.RUN, where(touched, Phase.AT_STOP, Phase.RUN))
        values = {
            **{s: where(fresh, lane[s], lane[f"{s}_start"]) for s in self.dynamics.states},
            **{f"{s}_trial": lane[f"{s}_start"] for s in self.dynamics.states},
            "error": where(fresh, lane.error, lane.error_start),
            "error_trial": lane.error_start, "elapsed": 0.0, "left": plan.left,
            "step": where(fresh, lane.h, plan.left),
        }  # fmt: skip
        if self.plan is Plan.DOUBLING:
            values |= {"divisions": plan.steps, "steps_left": plan.steps}
            values |= {f"{q}_seen": step_control.NEVER_SEEN for q in self.dynamics.arm.coordinates}
        elif self.plan is Plan.ADAPTIVE:
            values |= {"next_step": plan.following, "steps_left": 0.0}
        if self.stops:
            values |= dict.fromkeys(("changes", "searched", "tries", "slide"), 0.0)
            values |= {a: lane[f"{a}_start"] for a in self.active}
            for s, leaves in zip(self.stops, self.begun_at(lane, events.leaves_stop), strict=True):
                lane[f"cleared_{s.name}"] = logical_not(new) & lane[f"cleared_{s.name}"]
                lane[f"released_{s.name}"] = where(new, leaves, lane[f"released_{s.name}"])
        if self.logs:
            values["logged"] = lane.logged_start
        for name, value in values.items():
            lane[name] = where(new, value, lane[name])
        lane.due = where(new, fresh, lane.due)
        self._set_phase(lane, where(new, phase, lane.phase))
        lane.entered = False

    def _first_plan(self, lane: Lane) -> step_control.Plan:
        if self.plan is Plan.FIXED:
            return step_control.Plan(lane.h, False)
        if self.plan is Plan.ADAPTIVE:
            return step_control.first_adaptive(lane.next_step, lane.min_steps, lane.interval)
        failed = lane.reason == Reason.ACCURACY
        return step_control.first_doubling(
            failed, lane.error, lane.min_steps, lane.tip_tolerance, lane.interval
        )

    def _touched_before(self, lane: Lane) -> Any:
        """Whether a slider was at a stop, or rested there, before the common step."""
        return any_of(
            events.side_touched(lane[f"{q}_start"], lane[f"{a}_start"], lane[s.lower], lane[s.upper]) != 0.0
            for s, q, a in zip(self.stops, self.positions, self.active, strict=True)
        )

    def trial_step(self, lane: Lane) -> None:
        """A trial step of the lanes that move."""
        self._set_step(lane, lane.step, self._moving(lane))

    @staticmethod
    def _moving(lane: Lane) -> Any:
        return (lane.phase >= Phase.RUN) & (lane.phase <= Phase.FIND_EVENT)

    def look(self, lane: Lane) -> None:
        """After a trial step: count it, and how it meets the stops."""
        moved = self._moving(lane)
        if self.stops:
            self._set_crossings(lane, self.sliders(lane, "{}_trial", lane.step), lane.step)
            lane.held = any_of(a != 0.0 for a in lane.get(self.active))
        lane.due = moved
        lane.evaluations = lane.evaluations + where(moved, float(self.dynamics.method.stages), 0.0)

    def decide(self, lane: Lane) -> None:
        """After a trial step: what the lane does next."""
        dynamics, due, phase = self.dynamics, lane.due, lane.phase
        doubling = self.plan is Plan.DOUBLING
        verdict = self._verdict(lane)
        trial = events.Trial(due, phase, lane.step, lane.left, verdict.good)
        outcome = self._outcome(lane, trial)
        again, there, accepted = outcome.again, outcome.there, outcome.accepted
        tried = (phase == Phase.RUN) | (phase == Phase.RUN_PAST_TURN)
        failed = due & tried & logical_not(verdict.good)
        span = lane.step + outcome.slide if self.stops else lane.step
        left_after = lane.left - span
        ended = accepted & logical_not(left_after > 0.0)
        lost = self._lost(lane)
        elapsed = lane.elapsed + span
        ending = self._ending(lane, ended, accepted, elapsed, verdict)
        # An inaccurate step of equal ones begins the interval anew, of others itself.
        if doubling:
            failed, ended = failed | ending.unsure, ended & logical_not(ending.unsure)
            accepted = accepted & logical_not(ending.unsure)
        back = failed | lost if doubling else lost
        retry: Any = False if doubling else failed
        moved = accepted | there
        done = ended & ending.last
        continuing = accepted & logical_not(done)
        left = cases((failed, verdict.left), (ended, ending.left), (moved, left_after), default=lane.left)
        touches: Any = False
        touched_before: Any = False
        if self.stops:
            # A held slider has just shown that it stays; a free one at its stop must be looked at.
            sliders = self.sliders(lane, "{}_trial", lane.step)
            touches = any_of(
                s.free & (events.side_touched(s.position, s.active_stop, s.lower, s.upper) != 0.0)
                for s in sliders
            )
            touched_before = self._touched_before(lane)
        goes = continuing & logical_not(touches)
        here = dict(zip(self.positions, outcome.positions, strict=True))
        for q, v in zip(dynamics.arm.coordinates, dynamics.arm.rates, strict=True):
            if self.stops and q not in here:
                here[q] = lane[q] + outcome.slide * lane[v]
        new = {}
        for s in dynamics.states:
            start, trial_start, present = lane[f"{s}_start"], lane[f"{s}_trial"], lane[s]
            new[f"{s}_trial"] = cases((goes, present), (back, start), default=trial_start)
            new[s] = cases((back, start), (again | retry, trial_start), default=here.get(s, present))
        error, error_start, error_trial = lane.error, lane.error_start, lane.error_trial
        new |= {
            "error": cases((back, error_start), (again | retry, error_trial), default=error),
            "error_trial": cases((goes, error), (back, error_start), default=error_trial),
            "elapsed": cases((back, 0.0), (moved, elapsed), default=lane.elapsed),
            "left": left,
            "step": cases((again, outcome.h), (goes | failed, left), default=lane.step),
        }
        if doubling:
            new |= {
                "min_steps": ending.min_steps,
                "divisions": where(back, verdict.steps, lane.divisions),
                "steps_left": cases(
                    (back, verdict.steps), (ended, ending.steps_left), default=lane.steps_left
                ),
            }
            for q in dynamics.arm.coordinates:
                new[f"{q}_seen"] = where(ending.unsure & ending.last, lane[q], lane[f"{q}_seen"])
        elif self.plan is Plan.ADAPTIVE:
            new["steps_left"] = lane.steps_left + where(due, 1.0, 0.0)
            new["next_step"] = where(accepted | failed, verdict.following, lane.next_step)
        if self.plan is not Plan.FIXED:
            fault = Fault.TOLERANCE_NOT_REACHED
            if self.plan is Plan.ADAPTIVE:
                fault |= Fault.NO_STEP_FOUND
            new["fault"] = where(done & ending.flagged, fault, lane.fault)
        next_phase = cases(
            (logical_not(due), phase),
            (done, Phase.COMPLETE),
            (lost, Phase.COMPLETE),
            (again, outcome.phase),
            (there, Phase.AT_STOP),
            (continuing, where(touches, Phase.AT_STOP, Phase.RUN)),
            (back, where(touched_before, Phase.AT_STOP, Phase.RUN)),
            (retry, Phase.RUN),
            default=phase,
        )
        if self.stops:
            new |= self._after_search(lane, outcome, goes, back, lost, new)
        for name, value in new.items():
            lane[name] = value
        lane.due = False
        self._set_phase(lane, next_phase)

    def _verdict(self, lane: Lane) -> step_control.Verdict:
        if self.plan is Plan.FIXED:
            return step_control.Verdict(True, lane.left)
        if self.plan is Plan.ADAPTIVE:
            return step_control.judge_adaptive(
                lane.error, lane.step, lane.next_step, lane.min_steps, lane.interval, lane.steps_left
            )
        return step_control.judge_doubling(lane.error, lane.tip_tolerance, lane.divisions, lane.interval)

    def _outcome(self, lane: Lane, trial: events.Trial) -> events.Outcome:
        search = events.Search(*lane.get(SEARCH)) if self.stops else None
        if search is None:
            nothing = trial.due & trial.good
            return events.Outcome(nothing, False, False, None, None, None, [], 0.0, [])  # type: ignore[arg-type]
        rates = self.rates
        touching = [
            events.Contact(
                *lane.get(
                    ("force", "force_trial", "crossing", "turning", "cleared", f"mobility_{v}"),
                    of=f"{{}}_{s.name}",
                )
            )
            for s, v in zip(self.stops, rates, strict=True)
        ]
        sliders = self.sliders(lane, "{}_trial", lane.step)
        smooth = self.dynamics.method.stages > 1
        return events.after_trial(trial, search, sliders, touching, self.unseen, smooth)

    def _lost(self, lane: Lane) -> Any:
        """No event is looked for without end, and no time that is not a number is waited for."""
        if not self.stops:
            return False
        rest = lane.left - lane.step
        lost = logical_not((lane.searched < MOST_SEARCHED) & (rest == rest))
        if self.plan is Plan.DOUBLING:
            lost = lost | logical_not(lane.evaluations < float(MOST_TRIALS * self.dynamics.method.stages))
        return lane.due & lost

    def _ending(
        self, lane: Lane, ended: Any, accepted: Any, elapsed: Any, verdict: step_control.Verdict
    ) -> step_control.Ending:
        if self.plan is Plan.FIXED:
            return step_control.Ending(True, lane.left, False)
        if self.plan is Plan.ADAPTIVE:
            return step_control.end_adaptive(lane.interval, elapsed, verdict.following)
        terms = [
            n * abs(lane[q] - lane[f"{q}_seen"])
            for n, q in zip(tip_norms(self.dynamics, lane), self.dynamics.arm.coordinates, strict=True)
        ]
        crossed = step_control.Crossed(
            ended, accepted, lane.steps_left, lane.divisions, self.least_steps(lane),
            sum(terms[1:], terms[0]), lane.impacts if self.stops else 0.0,
        )  # fmt: skip
        return step_control.end_doubling(
            crossed, lane.error, lane.tip_tolerance, lane.min_steps, lane.interval
        )

    def _after_search(
        self, lane: Lane, outcome: events.Outcome, goes: Any, back: Any, lost: Any, new: dict[str, Any]
    ) -> dict[str, Any]:
        """What a trial step changes of searches, contacts and events."""
        again, due = outcome.again, lane.due
        values = {
            name: where(again, value, lane[name]) for name, value in zip(SEARCH, outcome.search, strict=True)
        }
        values |= {
            "searched": cases((again, lane.searched + 1.0), (due, 0.0), default=lane.searched),
            "fault": where(lost, Fault.EVENT_BUDGET, new.get("fault", lane.fault)),
            "slide": where(due, outcome.slide, lane.slide),
            "changes": where(back, 0.0, lane.changes),
            "impacts": where(back, lane.impacts_start, lane.impacts),
            **{a: where(back, lane[f"{a}_start"], lane[a]) for a in self.active},
        }
        if self.logs:
            values["logged"] = where(back, lane.logged_start, lane.logged)
        leaves = self.begun_at(lane, events.leaves_stop)
        for s, cleared, leave in zip(self.stops, outcome.cleared, leaves, strict=True):
            was, released = lane[f"cleared_{s.name}"], lane[f"released_{s.name}"]
            values[f"cleared_{s.name}"] = where(again, cleared, logical_not(due) & was)
            values[f"released_{s.name}"] = where(back, leave, logical_not(goes) & released)
            force, trial_force = lane[f"force_{s.name}"], lane[f"force_trial_{s.name}"]
            values[f"force_trial_{s.name}"] = where(goes, force, trial_force)
        return values

    # ---- the end of an interval ----------------------------------------------------------------------

    def undo(self, lane: Lane, failed: Any) -> None:
        """Lanes that failed go back to where the interval began."""
        for name in self.kept:
            lane[name] = where(failed, lane[self.origin.format(name)], lane[name])

    def layout(self) -> Layout:
        return Layout(self.fields())
