"""Brackets of the time of an event, or of a turn, which trial steps make ever smaller.

Sides are 1 at the upper limit, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import logical_not, maximum, minimum, where
from redundant_envs.events.boundary import ROUNDING, BoundedCoordinate, pick
from redundant_envs.events.first_event import TAYLOR_SHARE, Encounter, Event
from redundant_envs.tracing.ways import branches

RELEASE_SHARE = 1e-7
"""Fraction of the step by which a release may be late: the pull of the stop until then is rounding."""
PUSH_ON = 5e-8
"""Fraction of the step added to a guess of a release, so that it is after the release in most cases."""
MOST_GUESSES = 10
"""Number of trial steps towards an event before its bracket is halved, so that every search ends."""
MOST_TURN_GUESSES = 60
"""Number of trial steps towards a turn; by then its bracket is smaller than rounding."""


class Trial(NamedTuple):
    """A trial step of a lane.

    Attributes
    ----------
    h : its length, s
    left : the time left of the planned step at its start, s
    interval : the control interval that it belongs to, s
    encounters : coordinates at their boundaries in it
    events : the first event of each
    """

    h: Any
    left: Any
    interval: Any
    encounters: list[Encounter]
    events: list[Event]


class Search(NamedTuple):
    """The search for an event or a turn: two times between which it is, and the values there.

    Attributes
    ----------
    target : number of the boundary
    side : of the limit; of a release, the side of it on which the last trial step ended
    low, high : lengths of trial steps, s
    gap_low, gap_high : values at both that have different signs: of a pull, or of the speed of a turn
    tries : trial steps of this search
    """

    target: Any
    side: Any
    low: Any
    high: Any
    gap_low: Any
    gap_high: Any
    tries: Any

    def is_narrow(self, left: Any) -> Any:
        """Whether the ends of the bracket count as equal in the time left."""
        return self.high - self.low <= ROUNDING * left


class Sought(NamedTuple):
    """The coordinate whose event is sought, at the end of the trial step.

    Attributes
    ----------
    chosen : for each boundary, whether it is this one
    free : whether the coordinate rests at no stop
    closeness : positions nearer than this to the limit are at it, m
    limit : its position, m
    gap : distance of the coordinate beyond it, m; while it rests, the force with which its stop must pull, N
    speed, acceleration : outward, m/s and m/s^2
    time : of the first event that it has in the step, s
    bounces : whether its limit is a stop
    """

    chosen: list[Any]
    free: Any
    closeness: Any
    limit: Any
    gap: Any
    speed: Any
    acceleration: Any
    time: Any
    bounces: Any

    @property
    def over(self) -> Any:
        """Whether the step ends after the event."""
        return self.gap > 0.0


class TaylorStep(NamedTuple):
    """The remaining distance to a stop, covered by a Taylor step.

    Attributes
    ----------
    possible : whether its time is negligible
    time : its duration, s; shorter if another coordinate reaches its stop before
    arrives : for each boundary, whether its coordinate is the one that reaches its stop
    """

    possible: Any
    time: Any
    arrives: list[Any]


def sought_boundary(search: Search, trial: Trial) -> Sought:
    """The coordinate whose event is sought, at the end of the trial step."""
    motions = [e.motion for e in trial.encounters]
    chosen = [search.target == e.number for e in trial.encounters]
    free = pick(chosen, [s.active_stop for s in motions]) == 0.0
    upper, lower = pick(chosen, [s.upper for s in motions]), pick(chosen, [s.lower for s in motions])
    limit = where(search.side > 0.0, upper, lower)
    beyond = search.side * (pick(chosen, [s.position for s in motions]) - limit)
    alike = len({s.bounces for s in motions}) == 1
    return Sought(
        chosen=chosen, free=free, closeness=pick(chosen, [s.closeness for s in motions]), limit=limit,
        gap=where(free, beyond, pick(chosen, [e.pull for e in trial.encounters])),
        speed=search.side * pick(chosen, [s.velocity for s in motions]),
        acceleration=search.side * pick(chosen, [s.watched.last for s in motions]),
        time=pick(chosen, [event.time for event in trial.events]),
        bounces=motions[0].bounces if alike else pick(chosen, [float(s.bounces) for s in motions]) > 0.0,
    )  # fmt: skip


def begun(trial: Trial, target: Any, side: Any, chosen: Sequence[Any], for_turn: Any) -> Search:
    """A search whose bracket is the whole step.

    Parameters
    ----------
    trial : the step
    target, side, chosen : number of the boundary, side of the limit, and for each boundary whether it is it
    for_turn : whether a turn is sought
    """
    start_speed = abs(pick(chosen, [e.motion.start_velocity for e in trial.encounters]))
    speed = abs(pick(chosen, [e.motion.velocity for e in trial.encounters]))
    start_pull = minimum(pick(chosen, [e.start_pull for e in trial.encounters]), 0.0)
    pull = pick(chosen, [e.pull for e in trial.encounters])
    gaps = where(for_turn, start_speed, start_pull), where(for_turn, speed, pull)
    return Search(target, side, 0.0, trial.h, *gaps, 0.0)


@branches
def towards_event(search: Search, h: Any, sought: Sought) -> Search:
    """The search after a trial step of length ``h`` towards an event.

    An end that stays for the second time gets a smaller weight (Anderson and Bjorck 1973).
    """
    weight = weight_of_end(1.0 - sought.gap / where(sought.over, search.gap_high, search.gap_low))
    if sought.over:
        weight_low = weight * search.gap_low if search.side > 0.0 else search.gap_low
        return search._replace(high=h, gap_low=weight_low, gap_high=sought.gap)
    weight_high = search.gap_high if search.side > 0.0 else weight * search.gap_high
    return search._replace(low=h, gap_low=sought.gap, gap_high=weight_high)


@branches
def weight_of_end(weight: Any) -> Any:
    """The weight of an end that stays; a half where the formula gives none."""
    return weight if weight > 0.0 else 0.5


@branches
def towards_turn(search: Search, h: Any, sought: Sought) -> Search:
    """The search after a trial step of length ``h`` towards a turn; the gaps are speeds."""
    if sought.speed > 0.0:
        return search._replace(low=h, gap_low=sought.speed)
    return search._replace(high=h, gap_high=-sought.speed)


def correction(sought: Sought, search: Search) -> Any:
    """The correction that leads to the next guess of an event, from the search after the trial step.

    For a resting coordinate it is a chord of holding forces, as a fraction of the bracket; towards an impact
    it is Halley's step, s.
    """
    numerator, denominator = correction_terms(sought, search)
    return numerator / denominator  # one division for both formulas


@branches
def correction_terms(sought: Sought, search: Search) -> tuple[Any, Any]:
    """Numerator and denominator of :func:`correction`."""
    if not sought.free:
        return search.gap_low, search.gap_low - search.gap_high
    gap, speed = sought.gap, sought.speed
    return -2.0 * gap * speed, curved_slope(speed, 2.0 * speed * speed - gap * sought.acceleration)


@branches
def curved_slope(speed: Any, curved: Any) -> Any:
    """The denominator of Halley's step, or of Newton's where it would be too small."""
    return curved if curved > speed * speed else 2.0 * speed * speed


@branches
def next_towards_event(trial: Trial, search: Search, sought: Sought, step: Any) -> Any:
    """Length of the next trial step towards an event, s; after many of them, to the middle of the bracket.

    Parameters
    ----------
    trial, sought : the step, and the coordinate whose event is sought
    search : the search with the bracket after the step
    step : the :func:`correction`
    """
    low, high = search.low, search.high
    middle = 0.5 * (low + high)
    if not sought.free and search.is_narrow(trial.left):
        return high
    return inside(guess_of_event(trial, search, sought, step, middle), low, high, middle)


@branches
def guess_of_event(trial: Trial, search: Search, sought: Sought, step: Any, middle: Any) -> Any:
    """A guess of the time of an event, which may be outside the bracket; arguments as above."""
    if not search.tries < MOST_GUESSES:
        return middle
    if not sought.free:
        return search.low + (search.high - search.low) * step + PUSH_ON * trial.left
    return trial.h + step if sought.speed > 0.0 else middle


@branches
def inside(guess: Any, low: Any, high: Any, otherwise: Any) -> Any:
    """A guess if it is between the ends of a bracket and at none of them."""
    return guess if guess > low and guess < high else otherwise


def next_towards_turn(search: Search) -> Any:
    """Length of the next trial step towards a turn, s, by a chord of speeds."""
    share = search.gap_low / (search.gap_low + search.gap_high)
    return inside_of_turn(search, search.low + (search.high - search.low) * share)


@branches
def inside_of_turn(search: Search, guess: Any) -> Any:
    """A guess of a turn if it is in the bracket; its lower end in place of one beyond the upper."""
    low, high = search.low, search.high
    if not guess > low:
        return 0.5 * (low + high)
    return guess if guess < high else low


def taylor_step(trial: Trial, sought: Sought) -> TaylorStep:
    """The remaining distance of the sought coordinate to its stop, or of another one that reaches its own
    before."""
    time = time_of_way(sought)
    possible = (abs(time) <= TAYLOR_SHARE * trial.left) & (time <= trial.left - trial.h) & sought.bounces
    arrives = list(sought.chosen)
    for k, s in enumerate(e.motion for e in trial.encounters):
        if not s.bounces:
            continue
        own = maximum(way_to_stop(s), 0.0) / abs(s.velocity)
        sooner = possible & s.free & (abs(s.velocity) > 0.0) & (own < time)
        time = where(sooner, own, time)
        arrives = [x | sooner if j == k else x & logical_not(sooner) for j, x in enumerate(arrives)]
    return TaylorStep(possible, time, arrives)


@branches
def time_of_way(sought: Sought) -> Any:
    """Time in which the sought coordinate covers its remaining distance, s; 1 s if it moves away."""
    return -sought.gap / sought.speed if sought.speed > 0.0 else 1.0


@branches
def way_to_stop(s: BoundedCoordinate) -> Any:
    """Distance of a coordinate from the stop towards which it moves, m."""
    return s.upper - s.position if s.velocity > 0.0 else s.position - s.lower


@branches
def side_of_search(search: Search, sought: Sought) -> Any:
    """Side of the limit; of a release, the side of it on which the trial step has ended."""
    if sought.free:
        return search.side
    return 1.0 if sought.over else -1.0


@branches
def slide_to_event(sought: Sought, rest_of_way: TaylorStep) -> Any:
    """Time of the Taylor step that follows the trial step, s."""
    return rest_of_way.time if sought.free and rest_of_way.possible else 0.0


def ends_at_event(
    trial: Trial, before: Search, after: Search, sought: Sought, rest_of_way: TaylorStep
) -> Any:
    """Whether a trial step ends at the event: at the limit, or just after the stop would begin to pull.

    Parameters
    ----------
    trial, sought : the step, and the coordinate whose event is sought
    before, after : the search before and after the step
    rest_of_way : the remaining distance to the stop
    """
    gap, narrow = sought.gap, after.is_narrow(trial.left)
    late = gap * (trial.h - before.low) <= RELEASE_SHARE * trial.left * (gap - before.gap_low)
    # A coordinate that is distinguishable from its limit at the end of the bracket has not arrived.
    rounding = sought.closeness + 4.0 * ROUNDING * trial.left * abs(sought.speed)
    at_limit = (abs(gap) <= sought.closeness) | rest_of_way.possible | (narrow & (gap >= -rounding))
    return where(sought.free, at_limit, (narrow | late) & sought.over)
