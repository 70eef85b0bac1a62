"""How a lane that the common step does not serve crosses its interval: read :meth:`LaneProgram.cross`.

``yield Request.STEP`` asks for a trial step of ``lane.step`` from the trial start, ``yield Request.FORCES``
for the accelerations and forces at the stops. All slots are served together; each lane then goes on where it
waits. A trial step never changes the trial start, so that shorter ones can follow from there.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Generator
from typing import Any

from redundant_envs.algebra import any_of, logical_not, maximum, minimum, sqrt, where
from redundant_envs.events import contacts, search
from redundant_envs.events.boundary import Boundary, guarded, law_behind, leaves_stop, starts_at_stop
from redundant_envs.events.first_event import Encounter, first_event, first_passage
from redundant_envs.events.search import Aim, LastPiece, Search, Sought, Trial
from redundant_envs.lane.boundaries import Boundaries
from redundant_envs.lane.closed_forms import InStep
from redundant_envs.lane.features import Fault
from redundant_envs.lane.memory import Lane
from redundant_envs.lane.step_control import End, StepControl

MOST_SEARCHED = 500
"""Trial steps in search of one event; with more the interval is given up."""
SEARCH = Search._fields
SMALLEST_LATE_SHARE, LARGEST_LATE_SHARE = 1e-13, 1e-6
"""Fraction of a planned step by which a joint may be torn loose late; the smallest for every change."""
LATE_REST = 0.01
"""The same of a joint that comes to rest, over the root of the tolerance, as a fraction of the trial step: a
short one must not hide how a joint slips, sticks, and slips again."""
LATE_ERROR = 0.02
"""Fraction of the tolerance that the tip may be off since a change of a law was found late."""
MOST_LATE_SHARE = 1e-3
"""Fraction of a planned step by which it may be late at most: laws may agree by chance where a step ends."""
PASSES_OF_FRICTION = 8
"""Times as many resolutions with stops and dry friction: of the contacts and of the modes, each twice at an
impact and twice where a slider turns."""
SHARE_OF_BOUNCES = 1 / 64
"""Less of it with stops and dry friction: a slider that bounces turns as often as it strikes its stop."""


class Request(enum.Enum):
    """What a lane waits for."""

    STEP = "moving"  # a trial step
    FORCES = "touching"  # the accelerations and forces at its stops


class Found(enum.Enum):
    """How trial steps towards the end of a planned step, or towards an event, end."""

    NOTHING = "nothing"  # the trial step has no event
    EVENT = "event"  # it ends at an event
    INACCURATE = "inaccurate"  # its error is too large
    LOST = "lost"  # there were too many trial steps
    OTHER = "other"  # there is another event before, or a turn: this is sought now


class LaneProgram:
    """The program of a lane."""

    def __init__(self, boundaries: Boundaries, control: StepControl) -> None:
        self.dynamics, self.boundaries, self.control = boundaries.dynamics, boundaries, control

    def cross(self, lane: Lane) -> Generator[Request, None, None]:
        """Cross the interval."""
        self.begin(lane)
        while True:
            if lane.at_stop and not (yield from self.resolve(lane)):
                return self.give_up(lane)
            match (yield from self.step_or_event(lane)):
                case Found.LOST:
                    lane.error = lane.error_start
                    return self.give_up(lane)
                case Found.INACCURATE:
                    self.shorten(lane)
                case Found.EVENT:
                    lane.at_stop = lane.at_stop | self.boundaries.touches(lane)
                    if not lane.at_stop:
                        self.start_here(lane)
                case Found.NOTHING:
                    match self.control.end(lane):
                        case End.CROSSED:
                            return None
                        case End.REPEATED:
                            self.shorten(lane)
                        case _:
                            lane.at_stop = self.boundaries.touches(lane)
                            if not lane.at_stop:
                                self.start_here(lane)

    def step_or_event(self, lane: Lane) -> Generator[Request, None, Found]:
        """Take trial steps to the end of the planned one, or to the first event before it."""
        for b in self.dynamics.bounded:
            lane[f"cleared_{b.name}"] = False
        lane.searched = 0.0
        while True:
            yield Request.STEP
            if self.is_lost(lane):
                return Found.LOST
            if not self.control.accurate(lane):
                return Found.INACCURATE
            if not self.dynamics.boundaries:
                return self.moved(lane)
            trial = self.trial(lane)
            if self.hides(search.may_hide_event, trial):
                self.retry(lane, 0.5 * trial.h)
                continue
            aim = search.earliest_event(trial)
            if not aim.exists:
                return self.moved(lane)
            self.seek(lane, trial, aim)
            while True:
                match (yield from self.turn(lane) if lane.for_turn else self.event(lane)):
                    case Found.NOTHING:
                        break  # it turns before its limit: to the end of the planned step once more
                    case Found.LOST | Found.EVENT as found:
                        return found

    def turn(self, lane: Lane) -> Generator[Request, None, Found]:
        """Take trial steps to where a coordinate turns near its limit, until it is known where it turns."""
        while True:
            yield Request.STEP
            if self.is_lost(lane):
                return Found.LOST
            trial = self.trial(lane)
            before = Search(*lane.get(SEARCH))
            sought = search.sought_boundary(before, trial)
            if sought.gap > sought.closeness:
                aim = Aim(True, sought.chosen, before.target, before.side, False, sought.time)
                self.seek(lane, trial, aim)
                return Found.OTHER
            after = search.towards_turn(before, trial.h, sought)
            h = search.next_towards_turn(after)
            at_turn = abs(sought.speed * (h - trial.h)) <= sought.closeness
            lane.set(SEARCH, after)
            if at_turn | (before.tries >= search.MOST_TURN_GUESSES):
                for b, is_sought in zip(self.dynamics.bounded, sought.chosen, strict=False):
                    lane[f"cleared_{b.name}"] = lane[f"cleared_{b.name}"] | is_sought
                self.retry(lane, trial.left)
                return Found.NOTHING
            self.retry(lane, h)

    def event(self, lane: Lane) -> Generator[Request, None, Found]:
        """Take trial steps ever nearer to an event, unless there is another one before it."""
        while True:
            yield Request.STEP
            if self.is_lost(lane):
                return Found.LOST
            trial = self.settled(lane, self.trial(lane))
            before = Search(*lane.get(SEARCH))
            sought = search.sought_boundary(before, trial)
            other = search.other_event(trial, before, sought)
            if other.exists:
                self.seek(lane, trial, other)
                return Found.OTHER
            after = search.towards_event(before, trial.h, sought)
            piece = search.last_piece(trial, sought)
            if search.ends_at_event(trial, before, after, sought, piece.possible):
                if self.dynamics.guards and self.hides(search.hides_passage, trial):
                    self.retry(lane, 0.5 * trial.h)
                    return Found.NOTHING
                self.arrive(lane, trial, sought, piece)
                return Found.EVENT
            lane.set(SEARCH, after)
            self.retry(lane, search.next_towards_event(trial, after, sought))

    def resolve(self, lane: Lane) -> Generator[Request, None, bool]:
        """Resolve contacts until the motion goes on; false if they do not end."""
        if self.dynamics.impulses_change_laws:
            lane.resolving = True
        while True:
            yield Request.FORCES
            if self.has_too_many_events(lane):
                return False
            if self.boundaries.decide(lane):
                if self.dynamics.impulses_change_laws:
                    lane.resolving = False
                self.start_here(lane)
                return True

    def has_too_many_events(self, lane: Lane) -> Any:
        """Whether the interval has more impacts, or resolutions, than it may have, and is given up."""
        most = self.boundaries.most_impacts(lane)
        each = contacts.CHANGES_OF_IMPACT * (PASSES_OF_FRICTION if self.dynamics.gripped else 1)
        too_many = lane.changes >= each * most
        return too_many | (lane.impacts > most) if self.dynamics.stops else too_many

    # ---- a trial step ------------------------------------------------------------------------------------

    def trial(self, lane: Lane) -> Trial:
        """The trial step, and the first event of each coordinate in it."""
        h, encounters = lane.step, []
        moved = self.boundaries.in_step(lane, "{}_trial")
        for k, (b, motion) in enumerate(zip(self.dynamics.bounded, moved, strict=True)):
            known = lane.get(("crossing", "turning", "cleared"), of=f"{{}}_{b.name}")
            forces, mobility = [0.0, 0.0], 0.0
            if b in self.dynamics.holding:
                forces = lane.get(("force", "force_trial"), of=f"{{}}_{b.name}")
                mobility = self.boundaries.mobility(lane, b, b)
            encounters.append(Encounter(float(k), motion, *forces, *known, mobility))  # type: ignore[call-arg]
        for k, b in enumerate(self.dynamics.guards, start=len(moved)):
            pulls = lane.get((b.pull, f"{b.pull}_trial"))
            motion = guarded(self.boundaries.watched(lane, b), b.sticks)
            slows = -(lane[b.side] * lane[f"alpha_{b.name}"]) if b.sticks else 0.0
            still = 0.0, h, False, 0.0, self.late_share(lane, b), slows
            left = lane[b.left] if self.dynamics.weighs_laws and not b.sticks else False
            encounters.append(Encounter(float(k), motion, *pulls, *still, left))  # type: ignore[call-arg]
        method = self.dynamics.method
        events = [
            first_passage(e, h, method.c[method.middle])
            if e.motion.guards
            else first_event(e, h, 1.0 / h, method.stages > 1)
            for e in encounters
        ]
        impacts = lane.impacts - lane.impacts_start if self.dynamics.stops else 0.0
        node = method.c[method.middle] if self.dynamics.frictions else None
        weighed = self.dynamics.weighs_laws
        return Trial(h, lane.left, lane.interval, impacts, encounters, events, weighed, node)

    def late_share(self, lane: Lane, b: Boundary) -> Any:
        """Fraction of the planned step by which a change of law may be found late.

        Until then the motion departs by what the laws differ. With dry friction it is led back to the change,
        and only the square of the lateness is an error, and a part of it where a limit falls as a joint is
        torn loose.
        """
        if self.dynamics.scene.tolerance is None:
            return SMALLEST_LATE_SHARE
        if b.sticks:
            share = lane.tip_tolerance
            if self.dynamics.gripped:
                share = share * SHARE_OF_BOUNCES
            least = maximum(minimum(share, LARGEST_LATE_SHARE), SMALLEST_LATE_SHARE)
            if b.joint not in self.dynamics.frictions:
                return least
            late = LATE_REST * sqrt(lane.tip_tolerance) * (lane.step / lane.left)
            return where(lane[b.side] == 0.0, least, maximum(least, late))
        allowed = LATE_ERROR * lane.tip_tolerance / (lane.departure * lane.left)
        return minimum(maximum(allowed, SMALLEST_LATE_SHARE), MOST_LATE_SHARE)

    def hides(self, rule: Callable[..., Any], trial: Trial) -> Any:
        """Whether a trial step hides an event of any coordinate, by a rule of :mod:`search`."""
        return any_of(rule(trial, e, self.dynamics.overshoot) for e in trial.encounters)

    def settled(self, lane: Lane, trial: Trial) -> Trial:
        """A trial step that slots have taken, with the accelerations at its end in place of those of its last
        stage."""
        encounters = []
        for b, e in zip(self.dynamics.boundaries, trial.encounters, strict=True):
            watched = e.motion.watched
            if b.bounces:
                watched = watched._replace(last=self.boundaries.present_acceleration(lane, b))
            encounters.append(e._replace(motion=e.motion._replace(watched=watched)))
        return trial._replace(encounters=encounters)

    def seek(self, lane: Lane, trial: Trial, aim: Aim) -> None:
        """Begin a search for an event."""
        lane.set(SEARCH, search.begun(trial, aim))
        lane.for_turn = aim.turns
        self.retry(lane, aim.h)

    def retry(self, lane: Lane, h: Any) -> None:
        """Take the next trial step from the same start."""
        self.back_to(lane, "{}_trial")
        lane.step, lane.searched = h, lane.searched + 1.0

    def start_here(self, lane: Lane) -> None:
        """Start the next trial step here; it ends with the planned step."""
        lane.copy(self.dynamics.states, to="{}_trial")
        lane.error_trial, lane.step = lane.error, lane.left
        for b in self.dynamics.holding:
            lane[f"force_trial_{b.name}"] = lane[f"force_{b.name}"]
        for b in self.dynamics.guards:
            lane[f"{b.pull}_trial"] = lane[b.pull]

    def moved(self, lane: Lane) -> Found:
        """End a trial step without an event."""
        lane.left, lane.elapsed = lane.left - lane.step, lane.elapsed + lane.step
        self.note_released(lane)
        self.note_left(lane)
        return Found.NOTHING

    def is_lost(self, lane: Lane) -> Any:
        """Whether a search has no end, or waits for a time that is no number."""
        within = self.control.within_budget(lane)
        if not self.dynamics.boundaries:
            return False
        rest = lane.left - lane.step
        return logical_not((lane.searched < MOST_SEARCHED) & (rest == rest) & within)

    # ---- events ------------------------------------------------------------------------------------------

    def arrive(self, lane: Lane, trial: Trial, sought: Sought, piece: LastPiece) -> None:
        """End a trial step, and the last piece, at an event: sliders at their stops are there exactly."""
        met, arm = zip(trial.encounters, sought.chosen, strict=True), self.dynamics.arm
        crossed = [where(is_sought, lane.side, e.motion.side_beyond) for e, is_sought in met]
        at_end = zip(self.dynamics.boundaries, piece.positions, strict=True)
        exact = {arm.coordinates[b.number - 1]: (b, p) for b, p in at_end if b.holds}
        if self.dynamics.resolves:
            self.move(lane, piece.time)
        for q, (b, p) in exact.items():
            if b not in self.dynamics.angular:
                lane[q] = p
        for b in self.dynamics.angular:
            q = arm.coordinates[b.number - 1]
            at_stop = (exact[q][1] == lane[b.lower]) | (exact[q][1] == lane[b.upper])
            own = self.dynamics.own_value(b, exact[q][1], lane, arm.coordinates)
            lane[q] = where(at_stop, own, lane[q])
        spent = lane.step + piece.time
        lane.left, lane.elapsed = lane.left - spent, lane.elapsed + spent
        lane.at_stop = sought.bounces
        for b, side, is_sought, position in zip(
            self.dynamics.boundaries, crossed, sought.chosen, piece.positions, strict=True
        ):
            if b.bounces:
                if b.joint is None:
                    lane[f"arrived_{b.name}"] = position <= 0.0
                # It comes to its stop, even if by rounding it seems to move away.
                leaves = self.boundaries.at_stop(lane, b, leaves_stop)
                lane[f"released_{b.name}"] = leaves & logical_not(is_sought)
            elif b.sticks:
                passed = is_sought | (lane[b.pull] > 0.0)
                self.boundaries.guards.rest_or_tear_loose(lane, b, passed)
                lane.at_stop = lane.at_stop | passed
            elif b.guards:
                passed = is_sought | (lane[b.pull] > 0.0)
                lane[b.side] = where(passed, -lane[b.side], lane[b.side])
                lane[b.pull] = where(passed, -lane[b.pull], lane[b.pull])
                if self.dynamics.weighs_laws:
                    lane[b.left] = passed
            else:
                lane[b.side] = where(side != 0.0, law_behind(lane[b.side], side), lane[b.side])
        self.boundaries.guards.stick(lane)

    def move(self, lane: Lane, time: Any) -> None:
        """Move the state by a last piece, with the accelerations at its start."""
        arm, closed = self.dynamics.arm, self.dynamics.closed
        moving = [s for s in self.dynamics.states[self.dynamics.count :] if s not in closed]
        if closed:
            x = self.boundaries.quantities_of_motion(lane)
            self.dynamics.close(x, InStep(dict(zip(closed, lane.get(closed), strict=True)), time, {}))
            lane.set(closed, x.each(closed))
        names = (*arm.coordinates, *arm.rates) if self.dynamics.frictions else ()
        before = dict(zip(names, lane.get(names), strict=True))
        for q, v in zip(arm.coordinates, arm.rates, strict=True):
            lane[q] = search.moved_on(time, lane[q], lane[v] + 0.5 * time * lane[f"{v}_slope"])
        for s in moving:
            lane[s] = search.moved_on(time, lane[s], lane[f"{s}_slope"])
        if self.dynamics.frictions:
            self.boundaries.guards.stick(lane, before)

    def note_released(self, lane: Lane, form: str = "{}") -> None:
        """Record which coordinates leave their stops, in the state in the fields of a form."""
        for b in self.dynamics.stops:
            lane[f"released_{b.name}"] = self.boundaries.at_stop(lane, b, leaves_stop, form)
            if b.joint is None:
                lane[f"arrived_{b.name}"] = False

    def note_left(self, lane: Lane) -> None:
        """Record that no guard has just passed 0."""
        if self.dynamics.weighs_laws:
            for b in self.dynamics.guards:
                lane[b.left] = False

    # ---- the interval ------------------------------------------------------------------------------------

    def begin(self, lane: Lane) -> None:
        """Plan the first step; the common step is its first trial step, if it is of use."""
        useless = self.control.begin(lane)
        released = any_of(lane[a] != lane[f"{a}_start"] for a in self.dynamics.active)
        self.at_start(lane)
        lane.due, lane.at_stop = False, False
        if self.dynamics.weighs_laws:
            lane.departure = math.inf
        pulled = self.forces_in_common_step(lane)
        if self.dynamics.boundaries:
            begun = any_of(self.boundaries.at_start(lane, starts_at_stop))
            lane.due = logical_not(useless | begun | released | pulled)
        if lane.due:
            lane.step = lane.h
            for b in self.dynamics.sticking:
                lane[f"{b.pull}_trial"] = lane[f"first_{b.name}"]
        else:
            lane.step = lane.left
            lane.at_stop = self.decides_at_start(lane)
            self.back_to(lane, "{}_start")

    def decides_at_start(self, lane: Lane) -> Any:
        """Whether contacts, or which joints stick, must be resolved before the first trial step."""
        return bool(self.dynamics.sticking) or self.boundaries.touched_before(lane)

    def forces_in_common_step(self, lane: Lane) -> Any:
        """The forces that hold sliders at both ends of the common step; whether a stop would have to pull one
        from the beginning, so that the common step is of no use."""
        pulled: Any = False
        for b in self.dynamics.holding:
            side, rests = lane[b.active], lane[b.active] != 0.0
            first, last = lane.get(("first", "last"), of=f"{{}}_{b.name}")
            lane[f"force_trial_{b.name}"] = where(rests, side * first, 0.0)
            lane[f"force_{b.name}"] = where(rests, side * last, 0.0)
            pulled = pulled | (rests & (first > 0.0))
        for b in self.dynamics.sticking:
            pulled = pulled | (lane[f"first_{b.name}"] > 0.0)
        return pulled

    def at_start(self, lane: Lane) -> None:
        """The trial start, and what is counted, at the start of the interval."""
        lane.copy(self.dynamics.states, of="{}_start", to="{}_trial")
        lane.error_trial, lane.elapsed = lane.error_start, 0.0
        for b in (*self.dynamics.laws, *self.dynamics.guards):
            lane[b.side] = lane[f"{b.side}_start"]
        for b in self.dynamics.guards:
            lane[f"{b.pull}_trial"] = lane[f"{b.pull}_start"]
        self.note_left(lane)
        if self.dynamics.impulses_change_laws:
            lane.resolving = False
        if self.dynamics.resolves:
            lane.changes = 0.0
        if self.dynamics.compares_bounces:
            lane.bounces_end, lane.bounce_missed = -1.0, False
        lane.copy((*self.dynamics.active, *self.dynamics.rests, *self.dynamics.counted), of="{}_start")
        self.note_released(lane, "{}_start")

    def back_to(self, lane: Lane, form: str) -> None:
        """Return to the state in the fields of a form."""
        lane.copy(self.dynamics.states, of=form)
        lane.error = lane[form.format("error")]

    def shorten(self, lane: Lane) -> None:
        """After an inaccurate step: equal steps begin the interval anew, others begin the step anew."""
        self.control.shorten(lane)
        if self.control.repeats:
            self.at_start(lane)
        lane.step, lane.at_stop = lane.left, False
        if not self.control.repeats:
            return self.back_to(lane, "{}_trial")
        lane.at_stop = self.decides_at_start(lane)
        return self.back_to(lane, "{}_start")

    def give_up(self, lane: Lane) -> None:
        """Leave the lane as it was at the start of the interval, but for its estimate."""
        kept = *self.dynamics.states, *self.dynamics.active, *self.dynamics.rests, *self.dynamics.counted
        lane.copy(kept, of="{}_start")
        self.control.note(lane, Fault.EVENT_BUDGET)
