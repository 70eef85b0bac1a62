"""How a lane that the common step does not serve crosses its interval: read :meth:`LaneProgram.cross`.

``yield Request.STEP`` asks for a trial step of ``lane.step`` from the trial start, ``yield Request.FORCES``
for the accelerations and forces at the stops. All slots are served together; each lane then goes on where it
waits. A trial step never changes the trial start, so that shorter ones can follow from there.
"""

import enum
import math
from collections.abc import Callable, Generator, Iterator
from typing import Any

from redundant_envs.language.algebra import any_of, logical_not, where
from redundant_envs.simulator.events import contacts, search
from redundant_envs.simulator.events.boundary import side_touched
from redundant_envs.simulator.events.search import Aim, LastPiece, Search, Sought, Trial
from redundant_envs.simulator.lane.boundaries import Boundaries
from redundant_envs.simulator.lane.closed_forms import closing
from redundant_envs.simulator.lane.faults import Fault
from redundant_envs.simulator.lane.fields import Variable, engine
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.step_control import End, StepControl

MAX_SEARCHED = 500
"""Trial steps in search of one event; with more the interval is given up."""
SEARCH = Search._fields


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
    def __init__(self, boundaries: Boundaries, control: StepControl) -> None:
        self.boundaries, self.control = boundaries, control
        self.features, self.dynamics = boundaries.features, boundaries.dynamics

    def fields(self) -> Iterator[Variable]:
        """Fields that it alone sets, in the order in which it does so first."""
        if not self.features.local:
            return
        yield from self.control.fields()
        yield from engine("left", "error_trial", "elapsed")
        if self.features.resolves:
            yield from engine("changes")
        for b in self.features.stops:
            yield from b.own_variables("released")
        yield from engine("at_stop", "step")
        for bounded in self.features.bounded:
            yield from bounded.own_variables("cleared")
        yield from engine("searched")
        if self.features.boundaries:
            yield from engine(*SEARCH, "for_turn")

    def cross(self, lane: Lane) -> Generator[Request, None, None]:
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
        for b in self.features.bounded:
            lane[b.cleared] = False
        lane.searched = 0.0
        while True:
            yield Request.STEP
            if self.is_lost(lane):
                return Found.LOST
            if not self.control.accurate(lane):
                return Found.INACCURATE
            if not self.features.boundaries:
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
            if at_turn | (before.tries >= search.MAX_TURN_GUESSES):
                for b, is_sought in zip(self.features.bounded, sought.chosen, strict=False):
                    lane[b.cleared] = lane[b.cleared] | is_sought
                self.retry(lane, trial.left)
                return Found.NOTHING
            self.retry(lane, h)

    def event(self, lane: Lane) -> Generator[Request, None, Found]:
        """Take trial steps ever nearer to an event, unless there is another one before it."""
        while True:
            yield Request.STEP
            if self.is_lost(lane):
                return Found.LOST
            trial = self.trial(lane, settled=True)
            before = Search(*lane.get(SEARCH))
            sought = search.sought_boundary(before, trial)
            other = search.other_event(trial, before, sought)
            if other.exists:
                self.seek(lane, trial, other)
                return Found.OTHER
            after = search.towards_event(before, trial.h, sought)
            piece = search.last_piece(trial, sought)
            if search.ends_at_event(trial, before, after, sought, piece.possible):
                if self.features.guards and self.hides(search.hides_passage, trial):
                    self.retry(lane, 0.5 * trial.h)
                    return Found.NOTHING
                self.arrive(lane, trial, sought, piece)
                return Found.EVENT
            lane.set(SEARCH, after)
            self.retry(lane, search.next_towards_event(trial, after, sought))

    def resolve(self, lane: Lane) -> Generator[Request, None, bool]:
        """Resolve contacts until the motion goes on; false if the interval has more impacts, or resolutions,
        than it may have."""
        self.boundaries.note_resolving(lane, True)
        while True:
            yield Request.FORCES
            if self.has_too_many_events(lane):
                return False
            if self.boundaries.decide(lane):
                self.boundaries.note_resolving(lane, False)
                self.start_here(lane)
                return True

    def has_too_many_events(self, lane: Lane) -> Any:
        most = self.features.bounces.most_impacts(lane)
        each = contacts.CHANGES_OF_IMPACT * self.features.stiction.passes
        return (lane.changes >= each * most) | (self.features.bounces.impacts(lane) > most)

    # ---- a trial step ------------------------------------------------------------------------------------

    def trial(self, lane: Lane, settled: bool = False) -> Trial:
        """The trial step, and the first event of each coordinate in it; where it has ``settled``, with the
        accelerations at its end in place of those of its last stage."""
        features = self.features
        encounters = [b.encounter(lane, float(k)) for k, b in enumerate(features.boundaries)]
        met = [*zip(features.boundaries, encounters, strict=True)]
        events = [b.first_event(e, lane.step) for b, e in met]
        encounters = [b.settled(lane, e) for b, e in met] if settled else encounters
        known = lane.step, lane.left, lane.interval, features.bounces.impacts_since_start(lane)
        return Trial(*known, encounters, events, self.dynamics.bounds_late_switch, features.stiction.node)

    def hides(self, rule: Callable[..., Any], trial: Trial) -> Any:
        """Whether a trial step hides an event of any coordinate, by a rule of :mod:`search`."""
        return any_of(rule(trial, e, self.features.overshoot) for e in trial.encounters)

    def seek(self, lane: Lane, trial: Trial, aim: Aim) -> None:
        """Begin a search for an event."""
        lane.set(SEARCH, search.begun(trial, aim))
        lane.for_turn = aim.turns
        self.retry(lane, aim.h)

    def retry(self, lane: Lane, h: Any) -> None:
        self.back_to(lane, "{}_trial")
        lane.step, lane.searched = h, lane.searched + 1.0

    def start_here(self, lane: Lane) -> None:
        """Start the next trial step here; it ends with the planned step."""
        lane.copy(self.dynamics.states, to="{}_trial")
        lane.error_trial, lane.step = lane.error, lane.left
        for stop in self.features.holding:
            lane[stop.force_trial] = lane[stop.force]
        lane.copy((b.pull for b in self.features.guards), to="{}_trial")

    def moved(self, lane: Lane) -> Found:
        lane.left, lane.elapsed = lane.left - lane.step, lane.elapsed + lane.step
        self.features.watch.take(lane)
        for b in self.features.stops:
            b.note_released(lane)
        self.note_left(lane)
        return Found.NOTHING

    def is_lost(self, lane: Lane) -> Any:
        """Whether a search has no end, or waits for a time that is no number."""
        within = self.control.within_budget(lane)
        if not self.features.boundaries:
            return False
        rest = lane.left - lane.step
        return logical_not((lane.searched < MAX_SEARCHED) & (rest == rest) & within)

    # ---- events ------------------------------------------------------------------------------------------

    def arrive(self, lane: Lane, trial: Trial, sought: Sought, piece: LastPiece) -> None:
        """End a trial step, and the last piece, at an event: sliders at their stops are there exactly."""
        features, met = self.features, zip(trial.encounters, sought.chosen, strict=True)
        beyond = [where(is_sought, lane.side, e.motion.side_beyond) for e, is_sought in met]
        positions = dict(zip(features.boundaries, piece.positions, strict=True))
        if features.resolves:
            self.move(lane, piece.time)
        for stop in features.from_base:
            stop.set_position(lane, positions[stop])
        spent = lane.step + piece.time
        lane.left, lane.elapsed = lane.left - spent, lane.elapsed + spent
        lane.at_stop = sought.bounces
        self.features.watch.take(lane)
        for (b, position), side, is_sought in zip(positions.items(), beyond, sought.chosen, strict=True):
            b.arrive(lane, is_sought, side, position)
        features.stiction.stick(lane)

    def move(self, lane: Lane, time: Any) -> None:
        """Move the state by a last piece, with the accelerations at its start."""
        arm, closed = self.dynamics.arm, self.dynamics.closed
        before = lane.values(self.dynamics.states)
        if closed:
            x = self.boundaries.quantities_of_motion(lane)
            self.dynamics.close(x, closing(before, time, {}))
            lane.set(closed, x.each(closed))
        for q, v in zip(arm.coordinates, arm.rates, strict=True):
            lane[q] = search.moved_on(time, lane[q], lane[v] + 0.5 * time * lane[f"{v}_slope"])
        moving = self.dynamics.states[self.dynamics.count :]
        for s in moving[: len(moving) - len(closed)]:
            lane[s] = search.moved_on(time, lane[s], lane[f"{s}_slope"])
        if self.features.stiction.node is not None:
            self.features.stiction.stick(lane, before)

    def note_left(self, lane: Lane) -> None:
        """Record that no guard has just passed 0."""
        if self.dynamics.bounds_late_switch:
            for b in self.features.guards:
                lane[b.left] = False

    # ---- the interval ------------------------------------------------------------------------------------

    def begin(self, lane: Lane) -> None:
        """Plan the first step; the common step is its first trial step, if it is of use."""
        useless = self.control.begin(lane)
        released = any_of(lane[a] != lane[f"{a}_start"] for a in self.features.active)
        self.at_start(lane)
        lane.due, lane.at_stop = False, False
        if self.dynamics.bounds_late_switch:
            lane.departure = math.inf
        pulled = self.forces_in_common_step(lane)
        if self.features.boundaries:
            begun = any_of(b.starts_at_stop(lane) for b in self.features.stops)
            lane.due = logical_not(useless | begun | released | pulled)
        if lane.due:
            lane.step = lane.h
            for b in self.features.sticking:
                lane.set((b.pull,), (lane[b.first],), of="{}_trial")
        else:
            lane.step = lane.left
            lane.at_stop = self.decides_at_start(lane)
            self.back_to(lane, "{}_start")

    def decides_at_start(self, lane: Lane) -> Any:
        """Whether contacts, or which joints stick, must be resolved before the first trial step."""
        touched = (b.rule(lane, side_touched, "{}_start") for b in self.features.stops)
        return bool(self.features.sticking) or any_of(side != 0.0 for side in touched)

    def forces_in_common_step(self, lane: Lane) -> Any:
        """The forces that hold sliders at both ends of the common step; whether a stop would have to pull one
        from the beginning, or one that sticks is torn loose, so that the common step is of no use."""
        pulled: Any = False
        for b in self.features.holding:
            side, rests, first = lane[b.active_stop], lane[b.active_stop] != 0.0, lane[b.first]
            lane[b.force_trial] = where(rests, side * first, 0.0)
            lane[b.force] = where(rests, side * lane[b.last], 0.0)
            pulled = pulled | (rests & (first > 0.0))
        return pulled | any_of(lane[b.first] > 0.0 for b in self.features.sticking)

    def at_start(self, lane: Lane) -> None:
        """The trial start, and what is counted, at the start of the interval."""
        lane.copy(self.dynamics.states, of="{}_start", to="{}_trial")
        lane.error_trial, lane.elapsed = lane.error_start, 0.0
        lane.copy(self.features.sides, of="{}_start")
        lane.copy((b.pull for b in self.features.guards), of="{}_start", to="{}_trial")
        self.note_left(lane)
        self.boundaries.note_resolving(lane, False)
        if self.features.resolves:
            lane.changes = 0.0
        self.features.bounces.begin(lane)
        lane.copy(self.features.restored, of="{}_start")
        for b in self.features.stops:
            b.note_released(lane, "{}_start")

    def back_to(self, lane: Lane, form: str) -> None:
        """Return to the state in the fields of a form."""
        lane.copy(self.dynamics.states, of=form)
        lane.error = lane[form.format("error")]

    def shorten(self, lane: Lane) -> None:
        """After an inaccurate step: equal steps begin the interval anew, others begin the step anew."""
        self.control.shorten(lane)
        if self.control.repeats:
            self.at_start(lane)
        lane.step, lane.at_stop = lane.left, self.control.repeats and self.decides_at_start(lane)
        self.back_to(lane, "{}_start" if self.control.repeats else "{}_trial")

    def give_up(self, lane: Lane) -> None:
        """Leave the lane as it was at the start of the interval, but for its estimate."""
        lane.copy((*self.dynamics.states, *self.features.restored), of="{}_start")
        self.boundaries.pieces.note(lane, Fault.EVENT_BUDGET)
