"""The search for an event in time: brackets of it, or of a turn, which trial steps make ever smaller.

A trial step goes to the end of the planned step. If it has an event, trial steps from the same start end ever
nearer to it: this keeps the method's own order, and nothing is interpolated. The last piece to a stop, at
most 1e-5 of the planned step, takes no trial step: the accelerations at its start are known.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import any_of, logical_not, maximum, minimum, sqrt, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.simulator.events.boundary import BoundedCoordinate, direction, inside
from redundant_envs.simulator.events.crossings import Crossing, Overshoot, may_pass, most_pull, passes_within
from redundant_envs.simulator.events.first_event import LAST_SHARE, STRAIGHT_SHARE, Encounter, FirstEvent

MAX_BEND = 2e-3
"""Largest change of the square of a speed in the last piece to a stop, as a fraction of it."""
NEAR = 8.0
"""If another coordinate could come to a stop within so many times the longest last piece, this piece is short
enough to be straight: their order must not depend on how it is guessed."""
MAX_LONG_PIECES = 8.0
"""After so many impacts pieces are straight, too: no comparison would show what they neglect (0022)."""
MAX_GUESSES = 10
"""Number of trial steps towards an event before its bracket is halved, so that every search ends."""
LATER = 0.1
"""Where laws are weighed, the part of a correction by which a guess is later, so that it is after the event:
a chord is off by less, and what may be late depends on how late it is."""
TIMES_LATE = 10.0
"""Times by which a step must be longer than a guard may pass late: then its inner stages lie before a passage
at its end, and a positive value there is an earlier one."""
MAX_TURN_GUESSES = 60
"""Number of trial steps towards a turn; by then its bracket is smaller than rounding."""
TOGETHER_SHARE = 1e-13
"""Fraction of the control interval: impacts of two coordinates that are no farther apart count as one impact
of both. So the result does not depend on the number of steps in an interval."""


def select_flagged(chosen: Sequence[Any], values: Sequence[Any]) -> Any:
    """The number, or record, of the chosen coordinate; that of the first one if none of the others is."""
    value = values[0]
    if isinstance(value, tuple):
        return type(value)(*(select_flagged(chosen, field) for field in zip(*values, strict=True)))
    for is_chosen, other in zip(chosen[1:], values[1:], strict=True):
        value = value if other is value else where(is_chosen, other, value)
    return value


class Trial(NamedTuple):
    """A trial step of a lane."""

    h: Any  # its length, s
    left: Any  # the time left of the planned step at its start, s
    interval: Any  # the control interval that it belongs to, s
    impacts: Any  # so far, since the start of the common step
    encounters: list[Encounter]  # coordinates at their boundaries in it
    events: list[FirstEvent]  # the first of each
    weighed: bool = False  # whether it is known by how much the laws of guards differ at its end
    node: float | None = None  # of the middle stage, as a fraction of the step, if joints have dry friction

    def of(self, chosen: Sequence[Any]) -> tuple[Encounter, FirstEvent]:
        """The encounter and the event of a coordinate."""
        return select_flagged(chosen, self.encounters), select_flagged(chosen, self.events)


class Aim(NamedTuple):
    """An event that may be sought from now on."""

    exists: Any
    chosen: list[Any]  # for each boundary, whether the event is there; by default it is the first
    target: Any  # number of the boundary
    side: Any  # of the limit
    turns: Any  # whether it is a turn
    h: Any  # length of the first trial step towards it, s


class Search(NamedTuple):
    """The search for an event or a turn: two times between which it is, and the values there."""

    target: Any  # number of the boundary
    side: Any  # of the limit; of a release, the side of it on which the last trial step ended
    low: Any  # lengths of trial steps, s
    high: Any
    gap_low: Any  # values at both that have different signs: of a pull, or of the speed of a turn
    gap_high: Any
    tries: Any  # trial steps of this search

    def is_narrow(self, left: Any) -> Any:
        """Whether the ends of the bracket count as equal in the time left."""
        return self.high - self.low <= ROUNDING * left


class Sought(NamedTuple):
    """The coordinate whose event is sought, at the end of the trial step."""

    chosen: list[Any]  # for each boundary, whether it is this one
    free: Any  # whether the coordinate rests at no stop
    closeness: Any  # positions nearer than this to the limit are at it, m
    limit: Any  # its position, m
    gap: Any  # distance beyond it, m; while it rests, the force with which its stop must pull, N
    speed: Any  # outward, m/s
    acceleration: Any  # outward, m/s^2
    time: Any  # of the first event that it has in the step, s
    bounces: Any  # whether its limit is a stop
    late: Any  # fraction of the step by which the event may be found late
    steepness: Any  # rate at which the gap of a guard grows there; 0 if it is not known


class LastPiece(NamedTuple):
    """The remaining way to a stop, which takes no trial step."""

    possible: Any  # whether it is short enough
    time: Any  # its duration, s, until the first coordinate reaches its stop; 0 if it is not possible
    positions: list[Any]  # of the coordinates behind it


# ---- what to seek --------------------------------------------------------------------------------------


@branches
def may_hide_event(trial: Trial, e: Encounter, overshoot: Overshoot) -> Any:
    """Whether a step may hide an event of a coordinate that is larger than rounding: a free one may reach its
    limit and leave it, the stop of a resting one may pull, or a guard be positive, before the end alone. Then
    a step of half the length follows."""
    if e.motion.guards:
        watched = e.motion.watched
        leaves = e.left & (watched.most == watched.first)  # its first value is no sign of another passage
        seen = passes_within(watched) if leaves else may_pass(watched, overshoot)
        return logical_not(e.pull > 0.0) & seen
    if e.motion.free:
        return e.crossing == Crossing.UNCLEAR
    moves = most_pull(e.motion, overshoot) * e.mobility * (trial.h * trial.h)
    return logical_not(e.pull > 0.0) & (moves > e.motion.closeness)


@branches
def hides_passage(trial: Trial, e: Encounter, overshoot: Overshoot) -> Any:
    """Whether a step that ends at an event may hide an earlier passage of a guard: of several a search may
    have found the last one, and the value was positive before. Then a step of half the length follows, unless
    it is so short that a passage may be found late anyway."""
    if not e.motion.guards:
        return False
    if not e.pull > 0.0:
        return may_hide_event(trial, e, overshoot)
    return passes_within(e.motion.watched) & (trial.h > TIMES_LATE * e.late * trial.left)


def earliest_event(trial: Trial) -> Aim:
    """The first event of all boundaries in a step to the end of the planned one."""
    time, chosen = trial.events[0].time, [True]
    for event in trial.events[1:]:
        sooner = event.time < time
        chosen = [*(other & logical_not(sooner) for other in chosen), sooner]
        time = where(sooner, event.time, time)
    e, event = trial.of(chosen)
    h = minimum(maximum(time, 0.0), trial.h)
    return Aim(time <= trial.h, chosen, e.number, event.side, event.turns & e.motion.free, h)


@branches
def came_before(trial: Trial, low: Any, e: Encounter, event: FirstEvent, sought: Sought) -> Any:
    """Whether an event came before the end of a trial step, and after ``low``, s.

    A guard of laws has to come before another one that is sought, by more than it may be found late: those
    that pass together are found together, and no search goes to and fro between them.
    """
    s, side = e.motion, e.motion.side_beyond
    if s.guards and not s.sticks and not sought.free:
        return (e.pull > 0.0) & (event.time + e.late * trial.left < sought.time)
    passed = event.turns | ((side != 0.0) & (side * (s.position - s.limit(side)) > s.closeness))
    pulled = (e.pull > 0.0) & (trial.h - low > ROUNDING * trial.left)
    return passed if s.free else pulled


@branches
def other_event(trial: Trial, search: Search, sought: Sought) -> Aim:
    """An event at another boundary than the sought one, before the end of a trial step."""
    late = [
        came_before(trial, search.low, e, event, sought) & logical_not(is_sought)
        for e, event, is_sought in zip(trial.encounters, trial.events, sought.chosen, strict=True)
    ]
    chosen = [is_late & logical_not(any_of(late[:k])) for k, is_late in enumerate(late)]
    e, event = trial.of(chosen)
    side = event.side if event.turns else e.motion.side_beyond
    # The same step is never repeated.
    h = 0.5 * trial.h
    if e.motion.free and event.time < trial.h:
        h = event.time
    elif e.motion.guards and not e.motion.sticks:
        h = inside(event.time, 0.0, trial.h, h)
    return Aim(any_of(late), chosen, e.number, side, event.turns, h)


# ---- a bracket -----------------------------------------------------------------------------------------


def sought_boundary(search: Search, trial: Trial) -> Sought:
    """The coordinate whose event is sought, at the end of the trial step."""
    chosen = [search.target == e.number for e in trial.encounters]
    (e, event), side = trial.of(chosen), search.side
    s, limit = e.motion, e.motion.limit(side)
    gap = where(s.free, side * (s.position - limit), e.pull)
    motion = s.free, s.closeness, limit, gap, side * s.velocity, side * s.watched.last
    return Sought(chosen, *motion, event.time, s.bounces, e.late, e.steepness)


@branches
def begun(trial: Trial, aim: Aim) -> Search:
    """A search whose bracket is the whole step."""
    e, _ = trial.of(aim.chosen)
    speeds = abs(e.motion.start_velocity), abs(e.motion.velocity)
    gaps = speeds if aim.turns else (minimum(e.motion.active_stop * e.start_force, 0.0), e.pull)
    return Search(aim.target, aim.side, 0.0, trial.h, *gaps, 0.0)


@branches
def towards_event(search: Search, h: Any, sought: Sought) -> Search:
    """The search after a trial step of length ``h`` towards an event; an end that stays for the second time
    gets a smaller weight (Anderson and Bjorck 1973)."""
    over = sought.gap > 0.0  # the step ends after the event
    weight = 1.0 - sought.gap / where(over, search.gap_high, search.gap_low)
    weight = weight if weight > 0.0 else 0.5
    after = search._replace(tries=search.tries + 1.0)
    if not sought.free:
        after = after._replace(side=direction(sought.gap))
    if over:
        weight_low = weight * search.gap_low if search.side > 0.0 else search.gap_low
        return after._replace(high=h, gap_low=weight_low, gap_high=sought.gap)
    weight_high = search.gap_high if search.side > 0.0 else weight * search.gap_high
    return after._replace(low=h, gap_low=sought.gap, gap_high=weight_high)


@branches
def towards_turn(search: Search, h: Any, sought: Sought) -> Search:
    """The search after a trial step of length ``h`` towards a turn; the gaps are speeds."""
    after = search._replace(tries=search.tries + 1.0)
    if sought.speed > 0.0:
        return after._replace(low=h, gap_low=sought.speed)
    return after._replace(high=h, gap_high=-sought.speed)


# ---- the next trial step -------------------------------------------------------------------------------


@branches
def correction(sought: Sought, search: Search) -> tuple[Any, Any]:
    """Numerator and denominator of the correction to the next guess: for a resting coordinate a chord of
    holding forces, as a share of the bracket, else Halley's step, s, or Newton's if the denominator is
    small."""
    if not sought.free:
        return search.gap_low, search.gap_low - search.gap_high
    gap, speed = sought.gap, sought.speed
    curved = 2.0 * speed * speed - gap * sought.acceleration
    return -2.0 * gap * speed, curved if curved > speed * speed else 2.0 * speed * speed


@branches
def next_towards_event(trial: Trial, search: Search, sought: Sought) -> Any:
    """Length of the next trial step towards an event, s, from the search after the last one: the guess to
    which its correction leads; after many trial steps the middle of the bracket."""
    low, high = search.low, search.high
    guess = middle = 0.5 * (low + high)
    if not sought.free and search.is_narrow(trial.left):
        return high
    numerator, denominator = correction(sought, search)
    step = numerator / denominator  # one division for both formulas
    if search.tries <= MAX_GUESSES:
        if not sought.free:
            guess = low + (high - low) * step
            if sought.steepness > 0.0:
                guess = trial.h - sought.gap / sought.steepness
            # A little later, so that it is after the event in most cases.
            later = 0.5 * sought.late * trial.left
            if trial.weighed:
                later = minimum(later, LATER * abs(guess - trial.h))
            guess = guess + later
        elif sought.speed > 0.0:
            guess = trial.h + step
    return inside(guess, low, high, middle)


@branches
def next_towards_turn(search: Search) -> Any:
    """Length of the next trial step towards a turn, s, by a chord of speeds; the bracket's lower end if that
    leads beyond the upper one."""
    low, high = search.low, search.high
    guess = low + (high - low) * (search.gap_low / (search.gap_low + search.gap_high))
    if not guess > low:
        return 0.5 * (low + high)
    return guess if guess < high else low


def last_piece(trial: Trial, sought: Sought) -> LastPiece:
    """The remaining way of the sought coordinate to its stop, or of another one that is at its own before."""
    time, bend = time_of_way(sought)
    few = trial.impacts < MAX_LONG_PIECES
    alone = few & (abs(bend) <= MAX_BEND) & logical_not(any_of(others_near(trial, sought)))
    share = where(alone, LAST_SHARE, STRAIGHT_SHARE)
    possible = (abs(time) <= share * trial.left) & (time <= trial.left - trial.h) & sought.bounces
    arrives = list(sought.chosen)
    for k, s in enumerate(e.motion for e in trial.encounters):
        if not s.bounces:
            continue
        t_stop = maximum(direction(s.velocity) * (s.limit(s.velocity) - s.position), 0.0) / abs(s.velocity)
        sooner = possible & s.free & (abs(s.velocity) > 0.0) & (t_stop < time) & logical_not(sought.chosen[k])
        time = where(sooner, t_stop, time)
        arrives = [x | sooner if j == k else x & logical_not(sooner) for j, x in enumerate(arrives)]
    time = where(sought.free & possible, time, 0.0)
    if trial.node is not None:  # as a correction to second order
        e, _ = trial.of(sought.chosen)
        time = time - where(e.motion.sticks, time_since(trial, e, sought), 0.0)
    positions = []
    for e, is_sought, arrived in zip(trial.encounters, sought.chosen, arrives, strict=True):
        s = e.motion
        position = moved_on(time, s.position, s.velocity + 0.5 * time * s.watched.last)
        if s.bounces:
            stop = where(is_sought, sought.limit, s.limit(s.velocity))
            position = position_at_event(s, position, arrived, stop, trial.interval)
        positions.append(position)
    return LastPiece(possible, time, positions)


@branches
def time_of_way(sought: Sought) -> tuple[Any, Any]:
    """Time in which the sought coordinate covers its remaining distance, s, to second order, and the share by
    which the square of its speed changes; 1 s if it moves away."""
    if not sought.speed > 0.0:
        return 1.0, 0.0
    square = sought.speed * sought.speed
    gained = -2.0 * sought.acceleration * sought.gap  # by the square
    return -2.0 * sought.gap / (sought.speed + sqrt(maximum(square + gained, 0.0))), gained / square


@branches
def time_since(trial: Trial, e: Encounter, sought: Sought) -> Any:
    """Time by which the end of a trial step is later than the rest of a joint that slips, or than it is torn
    loose, s. The rate of one that slips falls as its acceleration says, the force that holds another grows
    as in the parabola through both ends of the step and its middle stage."""
    growth = sought.steepness
    if trial.node and not growth > 0.0:
        start, middle, node = e.start_force, e.motion.watched.middle, trial.node
        late = (sought.gap - middle) / (1.0 - node)
        growth = (late + (1.0 - node) * (late - (middle - start) / node)) / trial.h
    return minimum(sought.gap / growth, minimum(sought.late * trial.left, trial.h)) if growth > 0.0 else 0.0


def others_near(trial: Trial, sought: Sought) -> list[Any]:
    """For each other boundary, whether its free coordinate could be at a limit at about the same time."""
    near, reach = [], NEAR * LAST_SHARE * trial.left
    for s, is_sought in zip((e.motion for e in trial.encounters), sought.chosen, strict=True):
        speed = maximum(abs(s.velocity), abs(s.start_velocity))
        way = reach * (speed + reach * maximum(abs(s.watched.least), abs(s.watched.most)))
        here = (s.upper - s.position <= way) | (s.position - s.lower <= way)
        near.append(here & s.free & logical_not(is_sought))
    return near


# ---- the end -------------------------------------------------------------------------------------------


def ends_at_event(trial: Trial, before: Search, after: Search, sought: Sought, possible: Any) -> Any:
    """Whether a trial step ends at the event: at the limit, also after a last piece if one is ``possible``,
    or just after the stop would begin to pull."""
    gap, narrow = sought.gap, after.is_narrow(trial.left)
    late = gap * (trial.h - before.low) <= sought.late * trial.left * (gap - before.gap_low)
    # A coordinate that is distinguishable from its limit at the end of the bracket has not arrived.
    rounding = sought.closeness + 4.0 * ROUNDING * trial.left * abs(sought.speed)
    at_limit = (abs(gap) <= sought.closeness) | possible | (narrow & (gap >= -rounding))
    return where(sought.free, at_limit, (narrow | late) & (gap > 0.0))


@branches
def position_at_event(s: BoundedCoordinate, position: Any, arrives: Any, stop: Any, interval: Any) -> Any:
    """Position of a coordinate at an event, m: ``position``, or exactly a stop. A free one is at ``stop`` if
    it ``arrives``, and at one that it passes, or reaches in a negligible part of the ``interval``."""
    if not s.free:
        return position
    if arrives:
        return stop
    near = s.closeness + TOGETHER_SHARE * interval * abs(s.velocity)
    if position > s.upper or (position >= s.upper - near and s.velocity > 0.0):
        return s.upper
    if position < s.lower or (position <= s.lower + near and -s.velocity > 0.0):
        return s.lower
    return position


@branches
def moved_on(time: Any, x: Any, rate: Any) -> Any:
    """A number after a last piece with a mean rate; without one, exactly the same."""
    return x if time == 0.0 else x + time * rate
