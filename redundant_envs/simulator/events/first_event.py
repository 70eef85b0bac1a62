"""Time of the first event of a coordinate in a trial step, an estimate from which a search begins: of an
impact at a stop, a release from it, a limit that is passed, or a turn that may lie beyond one."""

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import logical_not, maximum, minimum, sqrt, where
from redundant_envs.simulator.events.boundary import BoundedCoordinate, direction, inside
from redundant_envs.simulator.events.crossings import Crossing

LAST_SHARE = 1e-5
"""Largest length of the last piece to a stop, as a fraction of the planned step. The acceleration of its
start holds in it; the error of velocities is 5e-11 of what this neglects in a whole step."""
STRAIGHT_SHARE = 2e-8
"""The same where the order of events decides: even without acceleration the error is rounding."""
LATE_SHARE = 1e-7
"""Fraction of the step by which a release may be late: the pull of the stop until then is rounding."""


class Encounter(NamedTuple):
    """A coordinate and its boundary in a trial step."""

    number: float  # of the boundary
    motion: BoundedCoordinate
    force: Any  # exerted by its stop along it at the end of the trial step, N
    start_force: Any  # at its start
    crossing: Any  # how the trial step meets the boundary
    turning_time: Any  # at which the coordinate turns in it, s
    cleared: Any  # whether it is known to turn before its limit
    mobility: Any  # of the coordinate, 1/kg
    late: Any = LATE_SHARE  # fraction of the step by which a release or a passage may be found late
    steepness: Any = 0.0  # rate at which the pull grows at the end of the step; 0 if it is not known
    left: Any = False  # whether a guard has passed 0 just before the step

    @property
    def pull(self) -> Any:
        """Force with which its stop would have to pull it at the end of the step, N."""
        return self.motion.active_stop * self.force


class FirstEvent(NamedTuple):
    """The first event of a coordinate in a trial step."""

    time: Any  # from the start of the step, s; later than its end if there is no event
    side: Any  # of the limit
    turns: Any  # whether the coordinate only turns near the limit


def quintic_through(s: BoundedCoordinate, h: Any, gap: Any) -> list[Any]:
    """Coefficients in s, m, of the quintic with a coordinate's positions, velocities and accelerations at
    both ends of a step, of which s is a fraction. The coordinate starts ``gap`` above its limit; the
    acceleration at the end is that of the last stage."""
    d = s.position - s.start_position
    s0 = h * s.start_velocity
    s1 = h * s.velocity
    c2 = 0.5 * h * h * s.watched.first
    e2 = 0.5 * h * h * s.watched.last
    c3 = 10.0 * d - 6.0 * s0 - 4.0 * s1 - 3.0 * c2 + e2
    c4 = 8.0 * s0 + 7.0 * s1 + 3.0 * c2 - 2.0 * e2 - 15.0 * d
    c5 = 6.0 * d - 3.0 * (s0 + s1) - c2 + e2
    return [gap, s0, c2, c3, c4, c5]


def polynomial(coefficients: Sequence[Any], s: Any) -> Any:
    """Value of a polynomial."""
    return reduce(lambda inner, c: c + s * inner, reversed(coefficients))


@branches
def nearer_root(g: Any, slope: Any, low: Any, high: Any, s: Any, new: Any) -> tuple[Any, Any, Any]:
    """A smaller bracket of a zero, and the next guess: the Newton step to ``new`` if it stays in it, else the
    middle. ``g`` and ``slope`` are those at ``s``."""
    low, high = where(g > 0.0, low, s), where(g > 0.0, s, high)
    return low, high, new if slope > 0.0 and new >= low and new <= high else 0.5 * (low + high)


@branches
def crossing_time(s: BoundedCoordinate, h: Any, side: Any, gap: Any, share: Any, turned: Any) -> Any:
    """Time at which the quintic through both ends of a step of length ``h`` passes the limit of a side, s, by
    two iterations: a third one would save one trial step in two hundred. The coordinate starts ``gap`` above
    the limit; of the step, ``share`` is a guess, and ``turned`` where an inward motion has turned."""
    c = quintic_through(s, h, gap)
    slopes = [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 5.0 * c[5]]
    low, high = turned_inward(s, side, turned), 1.0
    share = maximum(share, low)
    per_slope: Any = None
    for _ in range(2):
        g, slope = side * polynomial(c, share), side * polynomial(slopes, share)
        # The second reciprocal follows from the first by a Newton step of its own, without a division.
        per_slope = 1.0 / slope if per_slope is None else per_slope * (2.0 - slope * per_slope)
        low, high, share = nearer_root(g, slope, low, high, share, share - g * per_slope)
    return h * share


@branches
def turned_inward(s: BoundedCoordinate, side: Any, turned: Any) -> Any:
    """Fraction of a step before which a coordinate that starts inward does not pass its limit."""
    v0, v1 = s.start_velocity, s.velocity
    return minimum(turned, 1.0) if side * v0 < 0.0 and v0 * v1 < 0.0 else 0.0


@branches
def chord(e: Encounter, h: Any, side: Any, gap: Any) -> tuple[Any, Any]:
    """Fraction of a step at which a coordinate has its event, as numerator and denominator. A free one, which
    starts ``gap`` above its limit, meets that with the parabola of its positions and first velocity; for a
    resting one the chord of the forces that hold it changes its sign."""
    s = e.motion
    if e.pull > 0.0:
        push = maximum(-s.active_stop * e.start_force, 0.0)
        return push, push + e.pull
    start = side * h * s.start_velocity
    bend = side * (s.position - s.start_position) - start
    outward = sqrt(maximum(start * start - 4.0 * bend * side * gap, 0.0))
    return (-2.0 * side * gap, start + outward) if start > 0.0 else (outward - start, 2.0 * bend)


@branches
def first_event(e: Encounter, h: Any, per_h: Any, smooth: bool) -> FirstEvent:
    """The first event of a coordinate in a trial step of length ``h``, with 1 / ``h``; with Euler's method,
    which is not ``smooth``, the end of a step is quadratic in its length."""
    s = e.motion
    if s.bounces:
        certain, arrival = arrival_nearby(s, h)
        if certain and not e.cleared:
            return arrival
    side = s.side_beyond
    gap = s.start_position - s.limit(side)
    numerator, denominator = chord(e, h, side, gap)
    share = numerator / denominator  # one division for three formulas
    # A coordinate that ends beyond the other limit has turned before.
    turns = (abs(e.crossing) == Crossing.TURNS_NEAR) & logical_not(e.cleared) & s.free
    if e.pull > 0.0:
        time = h * share
    elif turns:
        time = e.turning_time
    elif side == 0.0:
        time = h + 1.0
    else:
        # For a coordinate that begins at its limit and returns the formula fails: its event is near the end.
        guess = inside(share, 0.0, 1.0, 1.0)
        time = crossing_time(s, h, side, gap, guess, e.turning_time * per_h) if smooth else h * guess
    if turns or side == 0.0:
        side = direction(e.crossing)
    return FirstEvent(time, side, turns)


@branches
def first_passage(e: Encounter, h: Any, node: float) -> FirstEvent:
    """The first event of a guard: where the parabola through its values at both ends of the step, and at a
    ``node`` between them, is 0; or where the chord is, if the parabola has no such zero."""
    if not e.pull > 0.0:
        return FirstEvent(h + 1.0, 0.0, False)
    start = minimum(e.start_force, 0.0)
    guess = start / (start - e.pull)
    if node > 0.0:
        slope = (e.motion.watched.middle - start) / node
        bend = (e.pull - e.motion.watched.middle) / (1.0 - node) - slope
        slope = slope - node * bend
        share = -2.0 * start / (slope + sqrt(maximum(slope * slope - 4.0 * bend * start, 0.0)))
        guess = inside(share, 0.0, 1.0, guess)
    return FirstEvent(h * guess, 0.0, False)


@branches
def arrival_nearby(s: BoundedCoordinate, h: Any) -> tuple[Any, FirstEvent]:
    """Whether a coordinate certainly reaches a stop near which it starts, and its impact there, whatever the
    end of the step of ``h``: which of two arrives first follows from their start. One that turns before it is
    beyond the stop by more than rounding does not arrive."""
    side, speed = direction(s.start_velocity), abs(s.start_velocity)
    way, acceleration = side * (s.limit(side) - s.start_position), side * s.watched.first
    time = 2.0 * way / (speed + sqrt(maximum(speed * speed + 2.0 * acceleration * way, 0.0)))
    before = (way > 0.0) & (way <= maximum(s.closeness, STRAIGHT_SHARE * h * speed))
    goes_beyond = speed * speed + 2.0 * acceleration * (way + s.closeness) > 0.0
    certain = s.free & before & goes_beyond & (speed > 0.0) & (time <= 0.5 * h)
    return certain, FirstEvent(time, side, False)
