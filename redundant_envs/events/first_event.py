"""Time of the first event of a coordinate in a trial step: an estimate, from which a search begins.

An event is an impact at a stop, a release from it, a limit that is passed, or a turn that may lie beyond a
limit. Sides are 1 at the upper limit, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from redundant_envs.algebra import logical_not, maximum, minimum, sqrt
from redundant_envs.events.boundary import BoundedCoordinate
from redundant_envs.events.crossings import Crossing
from redundant_envs.tracing.ways import branches

TAYLOR_SHARE = 2e-8
"""Largest length of a Taylor step to a stop, as a fraction of the planned step: half its square, the error of
positions and velocities, is rounding."""


class Encounter(NamedTuple):
    """A coordinate and its boundary in a trial step.

    Attributes
    ----------
    number : of the boundary
    motion : of the coordinate
    force, start_force : exerted by its stop along it at the end of the trial step and at its start, N
    crossing : how the trial step meets the boundary
    turning_time : time at which the coordinate turns in it, s
    cleared : whether it is known to turn before its limit
    mobility : of the coordinate, 1/kg
    """

    number: float
    motion: BoundedCoordinate
    force: Any
    start_force: Any
    crossing: Any
    turning_time: Any
    cleared: Any
    mobility: Any

    @property
    def pull(self) -> Any:
        """Force with which its stop would have to pull it at the end of the step, N."""
        return self.motion.active_stop * self.force

    @property
    def start_pull(self) -> Any:
        """Force with which its stop would have to pull it at the start of the step, N."""
        return self.motion.active_stop * self.start_force


class Event(NamedTuple):
    """The first event of a coordinate in a trial step.

    Attributes
    ----------
    time : from the start of the step, s; later than its end if there is no event
    side : of the limit
    turns : whether the coordinate only turns near the limit
    """

    time: Any
    side: Any
    turns: Any


class Quintic(NamedTuple):
    """side (gap + s0 s + c2 s^2 + ... + c5 s^5): distance of a coordinate beyond a limit, at a fraction s of
    a step."""

    side: Any
    gap: Any
    s0: Any
    c2: Any
    c3: Any
    c4: Any
    c5: Any

    def value(self, s: Any) -> Any:
        """Distance of the coordinate beyond the limit, m."""
        inner = self.c2 + s * (self.c3 + s * (self.c4 + s * self.c5))
        return self.side * (self.gap + s * (self.s0 + s * inner))

    def slope(self, s: Any) -> Any:
        """Its derivative with respect to s, m."""
        inner = 3.0 * self.c3 + s * (4.0 * self.c4 + s * (5.0 * self.c5))
        return self.side * (self.s0 + s * (2.0 * self.c2 + s * inner))


def quintic_through(s: BoundedCoordinate, h: Any, side: Any, gap: Any) -> Quintic:
    """The quintic with a coordinate's positions, velocities and accelerations at both ends of a step.

    The acceleration at the end is that of the last stage. The coordinate starts ``gap`` above its limit.
    """
    d = s.position - s.start_position
    s0 = h * s.start_velocity
    s1 = h * s.velocity
    c2 = 0.5 * h * h * s.watched.first
    e2 = 0.5 * h * h * s.watched.last
    c3 = 10.0 * d - 6.0 * s0 - 4.0 * s1 - 3.0 * c2 + e2
    c4 = 8.0 * s0 + 7.0 * s1 + 3.0 * c2 - 2.0 * e2 - 15.0 * d
    c5 = 6.0 * d - 3.0 * (s0 + s1) - c2 + e2
    return Quintic(side, gap, s0, c2, c3, c4, c5)


@branches
def halved_bracket(positive: Any, low: Any, high: Any, s: Any) -> tuple[Any, Any]:
    """A bracket of which ``s`` becomes the upper end if the function is ``positive`` there."""
    return (low, s) if positive else (s, high)


@branches
def between(guess: Any, low: Any, high: Any, otherwise: Any) -> Any:
    """A guess if it is within a bracket."""
    return guess if guess >= low and guess <= high else otherwise


def nearer_root(f: Quintic, low: Any, high: Any, s: Any, per_slope: Any) -> tuple[Any, Any, Any, Any]:
    """A bracketed Newton step towards a zero.

    The reciprocal of the slope is updated by a separate Newton step, without a division.

    Parameters
    ----------
    f : the function whose zero is sought
    low, high : ends of the bracket
    s, per_slope : a guess of the zero, and the reciprocal of the slope at the previous guess
    """
    g, slope = f.value(s), f.slope(s)
    per_slope = per_slope * (2.0 - slope * per_slope)
    low, high = halved_bracket(g > 0.0, low, high, s)
    return low, high, newton_step(slope, low, high, s - g * per_slope), per_slope


@branches
def newton_step(slope: Any, low: Any, high: Any, new: Any) -> Any:
    """A Newton step if it stays in the bracket, else the middle of the bracket."""
    middle = 0.5 * (low + high)
    return between(new, low, high, middle) if slope > 0.0 else middle


@branches
def crossing_time(s: BoundedCoordinate, h: Any, side: Any, gap: Any, share: Any, turned: Any) -> Any:
    """Time at which the quintic through both ends of a step passes a limit, s.

    Three iterations find the zero to the accuracy with which the quintic describes the event.

    Parameters
    ----------
    s, h : the coordinate, and the length of the step
    side, gap : side of the limit, and distance above it at which the coordinate starts, m
    share : a guess, as a fraction of the step
    turned : fraction of the step at which an inward motion has turned
    """
    f = quintic_through(s, h, side, gap)
    low, high = turned_inward(s, side, turned), 1.0
    share = maximum(share, low)
    per_slope = 1.0 / f.slope(share)
    for _ in range(3):
        low, high, share, per_slope = nearer_root(f, low, high, share, per_slope)
    return h * share


@branches
def turned_inward(s: BoundedCoordinate, side: Any, turned: Any) -> Any:
    """Fraction of a step before which a coordinate that starts inward does not pass its limit."""
    v0, v1 = s.start_velocity, s.velocity
    return minimum(turned, 1.0) if side * v0 < 0.0 and v0 * v1 < 0.0 else 0.0


@branches
def chord_share(e: Encounter, h: Any, side: Any, gap: Any) -> Any:
    """Fraction of a step at which a coordinate has its event, from both ends.

    For a free coordinate it is where the parabola of its positions and first velocity meets the limit, for a
    resting one where the chord of the forces that hold it changes its sign.

    Parameters
    ----------
    e, h : the coordinate at its boundary, and the length of the step
    side, gap : side of the limit, and distance above it at which the coordinate starts, m
    """
    numerator, denominator = chord(e, h, side, gap)
    return numerator / denominator  # one division for three formulas


@branches
def chord(e: Encounter, h: Any, side: Any, gap: Any) -> tuple[Any, Any]:
    """Numerator and denominator of :func:`chord_share`, with the same arguments."""
    s = e.motion
    if e.pull > 0.0:
        push = maximum(-s.active_stop * e.start_force, 0.0)
        return push, push + e.pull
    start = side * h * s.start_velocity
    bend = side * (s.position - s.start_position) - start
    outward = sqrt(maximum(start * start - 4.0 * bend * side * gap, 0.0))
    return (-2.0 * side * gap, start + outward) if start > 0.0 else (outward - start, 2.0 * bend)


@branches
def first_event(e: Encounter, h: Any, per_h: Any, smooth: bool) -> Event:
    """The first event of a coordinate in a trial step.

    Parameters
    ----------
    e : the coordinate at its boundary
    h, per_h : length of the step, s, and one over it
    smooth : whether the method is not Euler's, with which the end of a step is quadratic in its length
    """
    s = e.motion
    if s.bounces:
        near = arrival_nearby(s, h)
        if near.certain and not e.cleared:
            return Event(near.time, near.side, False)
    side = s.side_beyond
    gap = s.start_position - s.limit(side)
    share = chord_share(e, h, side, gap)
    # A coordinate that ends beyond the other limit has turned before.
    turns = (abs(e.crossing) == Crossing.TURNS_NEAR) & logical_not(e.cleared) & s.free
    if e.pull > 0.0:
        time = h * share
    elif turns:
        time = e.turning_time
    elif side == 0.0:
        time = h + 1.0
    else:
        time = passing_time(e, h, per_h, smooth, side, gap, share)
    if turns or side == 0.0:
        side = 1.0 if e.crossing > 0.0 else -1.0
    return Event(time, side, turns)


@branches
def passing_time(e: Encounter, h: Any, per_h: Any, smooth: bool, side: Any, gap: Any, share: Any) -> Any:
    """Time at which a coordinate that ends beyond its limit passes it, s.

    Parameters
    ----------
    e, h, per_h, smooth : as for :func:`first_event`
    side, gap, share : side of the limit, distance above it at the start, and :func:`chord_share`
    """
    # For a coordinate that begins at its limit and returns the formula fails: its event is near the end.
    guess = share_within(share)
    return crossing_time(e.motion, h, side, gap, guess, e.turning_time * per_h) if smooth else h * guess


@branches
def share_within(share: Any) -> Any:
    """A fraction of a step, or the whole step in place of one outside."""
    return share if share > 0.0 and share < 1.0 else 1.0


class Arrival(NamedTuple):
    """Arrival of a coordinate at a stop that is very near at the start of a step.

    Attributes
    ----------
    certain : whether it reaches the stop, and would pass it if nothing stopped it
    time : of the arrival, s
    side : of the stop
    """

    certain: Any
    time: Any
    side: Any


@branches
def arrival_nearby(s: BoundedCoordinate, h: Any) -> Arrival:
    """Arrival of a coordinate at a stop near which it starts, independent of the end of the step of ``h``.

    Which of two such coordinates arrives first follows from their start. One that its acceleration turns
    before it is beyond the stop by more than rounding does not arrive.
    """
    side, speed = direction(s.start_velocity), abs(s.start_velocity)
    way, acceleration = side * (s.limit(side) - s.start_position), side * s.watched.first
    time = 2.0 * way / (speed + sqrt(maximum(speed * speed + 2.0 * acceleration * way, 0.0)))
    before = (way > 0.0) & (way <= maximum(s.closeness, TAYLOR_SHARE * h * speed))
    goes_beyond = speed * speed + 2.0 * acceleration * (way + s.closeness) > 0.0
    return Arrival(s.free & before & goes_beyond & (speed > 0.0) & (time <= 0.5 * h), time, side)


@branches
def direction(velocity: Any) -> Any:
    """The side towards which a velocity points; -1 for 0."""
    return 1.0 if velocity > 0.0 else -1.0
