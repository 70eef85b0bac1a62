"""Whether a trial step meets a boundary, and how, and the time of the first event in it.

An event is an impact at a stop, a release from it, a limit that is passed, or a turn that may lie beyond a
limit. The decision record 0003 explains the bounds from the accelerations at the stages.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from redundant_envs.algebra import floor, logical_not, maximum, minimum, sqrt, where
from redundant_envs.events.boundary import BoundedCoordinate, direction, inside
from redundant_envs.numerics.methods import Watched
from redundant_envs.tracing.ways import branches

TAYLOR_SHARE = 2e-8
"""Largest length of a Taylor step to a stop, as a fraction of the planned step: half its square, the error of
positions and velocities, is rounding."""


class Crossing(enum.IntEnum):
    """How a trial step meets a boundary; negative at the lower limit."""

    NONE = 0  # it stays between the limits
    ENDS_BEYOND = 1  # the step ends beyond the limit, and passes it once
    TURNS_NEAR = 2  # the coordinate turns once, and may be beyond the limit then
    UNCLEAR = 4  # it may pass the limit more often than the ends of the step and the turning point show


class Overshoot(NamedTuple):
    """Largest overshoot of an acceleration (Tableau.overshoot_between_nodes)."""

    between: float
    at_ends: float


def may_meet(s: BoundedCoordinate, h: Any, overshoot: Overshoot) -> Any:
    """Whether a free coordinate may meet a limit in a step.

    A cheap bound of :func:`excursions`: if q'' >= -A, q exceeds its ends by at most A h^2 / 8.
    """
    more = overshoot.between * (s.watched.most - s.watched.least)
    eighth = 0.125 * h * h
    top = maximum(s.start_position, s.position) + eighth * maximum(more - s.watched.least, 0.0)
    bottom = minimum(s.start_position, s.position) - eighth * maximum(s.watched.most + more, 0.0)
    return s.free & logical_not((top < s.upper) & (bottom > s.lower))


@branches
def most_pull(s: BoundedCoordinate, overshoot: Overshoot) -> Any:
    """Largest force with which the stop of a resting coordinate may have to pull in a step, or 0."""
    if s.free:
        return 0.0
    return maximum(s.watched.most + margins(s.watched, overshoot)[1], 0.0)


@branches
def acceleration_bounds(s: BoundedCoordinate, overshoot: Overshoot) -> tuple[Any, Any]:
    """Bounds of an acceleration in a step, from its least and greatest value at the stages.

    The range is widened by the overshoot of a parabola between the stages; but a coordinate that starts at
    its stop was struck or released there, so its first stage is an end of the range, which is not widened
    towards that stop.
    """
    w = s.watched
    down, up = margins(w, overshoot)
    return (
        w.least - down if s.start_position > s.lower else w.least,
        w.most + up if s.start_position < s.upper else w.most,
    )


@branches
def overshoot_at_extremes(w: Watched, overshoot: Overshoot) -> tuple[Any, Any]:
    """The overshoot beyond the least value at the stages, and beyond the greatest: larger between stages."""
    return (
        overshoot.between if w.least < minimum(w.first, w.last) else overshoot.at_ends,
        overshoot.between if w.most > maximum(w.first, w.last) else overshoot.at_ends,
    )


def margins(w: Watched, overshoot: Overshoot) -> tuple[Any, Any]:
    """Distances by which a parabola may leave the range of its values at the stages, down and up."""
    down, up = overshoot_at_extremes(w, overshoot)
    return down * (w.most - w.least), up * (w.most - w.least)


def meets_kink(w: Watched, levels: bool, overshoot: Overshoot) -> tuple[Any, Any]:
    """Whether a quantity passes 0, or with ``levels`` a whole number, in a step: seen at stages, or hidden.

    It may do so between two stages and return; a quantity that starts at 0 and leaves it does not pass it.
    """
    down, up = margins(w, overshoot)
    if levels:
        seen = floor(w.least) < floor(w.most)
        hidden = floor(w.least - down) < floor(w.most + up)
    else:
        seen = (w.least < 0.0) & (w.most > 0.0)
        hidden = (w.least - down < 0.0) & (w.most + up > 0.0) & (w.first != 0.0)
    return seen, hidden & logical_not(seen)


@branches  # traced once for all ways of crossing_of
def excursions(s: BoundedCoordinate, h: Any, lo: Any, hi: Any) -> tuple[Any, Any]:
    """Whether a coordinate may turn beyond its upper and its lower limit between the ends of a step.

    It cannot if these are 0 or less, as long as its acceleration stays in lo..hi.
    With q'' >= -A and A h^2 = p, q exceeds its ends by at most (p/2 - |q1 - q0|)^2 / (2 p), and not at
    all if p/2 < |q1 - q0|; with q'' <= B it stays below q0 + v0 h + B h^2 / 2, and if B < 0 it is at
    most v^2 / (2 |B|) above each end.
    """
    q0, v0, q1, v1 = s.start_position, s.start_velocity, s.position, s.velocity
    top, bottom = s.upper + s.closeness, s.lower - s.closeness
    up0, up1 = top - q0, top - q1
    down0, down1 = q0 - bottom, q1 - bottom
    sinks, lifts = h * h * maximum(-lo, 0.0), h * h * maximum(hi, 0.0)
    way = abs(q1 - q0)
    rest = maximum(0.5 * sinks - way, 0.0)
    above = rest * rest - 2.0 * sinks * minimum(up0, up1)
    above = minimum(above, h * maximum(v0, 0.0) + 0.5 * lifts - up0)
    above = minimum(above, minimum(v0 * v0 + 2.0 * hi * up0, v1 * v1 + 2.0 * hi * up1))
    rest = maximum(0.5 * lifts - way, 0.0)
    below = rest * rest - 2.0 * lifts * minimum(down0, down1)
    below = minimum(below, 0.5 * sinks - h * minimum(v0, 0.0) - down0)
    below = minimum(below, minimum(v0 * v0 - 2.0 * lo * down0, v1 * v1 - 2.0 * lo * down1))
    return above, below


@branches
def turning_time(s: BoundedCoordinate, h: Any) -> Any:
    """Time at which the cubic through both ends of a step turns; the end of the step if it does not turn."""
    v0, v1 = s.start_velocity, s.velocity
    if not v0 * v1 < 0.0:
        return h
    s0 = h * v0
    d = s.position - s.start_position
    c2 = 3.0 * d - h * (2.0 * v0 + v1)
    c3 = h * (v0 + v1) - 2.0 * d
    root = sqrt(maximum(c2 * c2 - 3.0 * c3 * s0, 0.0))
    return h * (s0 / (direction(v0) * root - c2))


@branches
def keeps_direction(s: BoundedCoordinate, h: Any, lo: Any, hi: Any) -> Any:
    """Indicator that a velocity keeps its sign in a step: it does if the result is 0 or more.

    Either the velocity cannot change enough from one of its ends while its acceleration stays in lo..hi. Or
    the acceleration grows throughout, and the velocity stays below its ends; or it falls throughout, and the
    velocity stays above them.
    """
    w, v0, v1 = s.watched, s.start_velocity, s.velocity
    slower = h * maximum(-lo, 0.0)  # largest fall and rise of the velocity
    faster = h * maximum(hi, 0.0)
    rises = maximum(v0 - slower, v1 - faster)
    falls = maximum(-v0 - faster, -v1 - slower)
    stays_below = minimum(minimum(w.least - w.first, w.last - w.most), -maximum(v0, v1))
    stays_above = minimum(minimum(w.first - w.most, w.least - w.last), minimum(v0, v1))
    return maximum(maximum(rises, falls), maximum(stays_below, stays_above))


@branches
def crossing_of(s: BoundedCoordinate, h: Any, overshoot: Overshoot) -> Any:
    """How a step meets a boundary: a :class:`Crossing`, with the sign of the side unless it is unclear.

    A velocity that keeps its sign meets a limit once at most, an acceleration that does turns once.
    """
    lo, hi = acceleration_bounds(s, overshoot)
    above, below = excursions(s, h, lo, hi)
    ends_above, ends_below = s.position > s.upper, s.position < s.lower
    ends: Any = Crossing.ENDS_BEYOND if ends_above else -Crossing.ENDS_BEYOND if ends_below else Crossing.NONE
    if keeps_direction(s, h, lo, hi) >= 0.0:
        return ends
    if below > 0.0:
        turns = ends if ends_below else -Crossing.TURNS_NEAR
    else:
        turns = Crossing.TURNS_NEAR if above > 0.0 and not ends_above else ends
    bends_once = maximum(lo, -hi) >= 0.0
    return Crossing.UNCLEAR if turns != Crossing.NONE and not bends_once else turns


# ---- the first event: an estimate, from which a search begins -----------------------------------------


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

    @property
    def pull(self) -> Any:
        """Force with which its stop would have to pull it at the end of the step, N."""
        return self.motion.active_stop * self.force


class Event(NamedTuple):
    """The first event of a coordinate in a trial step."""

    time: Any  # from the start of the step, s; later than its end if there is no event
    side: Any  # of the limit
    turns: Any  # whether the coordinate only turns near the limit


def quintic_through(s: BoundedCoordinate, h: Any, gap: Any) -> list[Any]:
    """Coefficients, m, of the quintic through both ends of a step, in shares of it; it starts at ``gap``."""
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
    """A smaller bracket of a zero, and the next guess: a Newton step if it stays in it, else its middle.

    ``g`` and ``slope`` are of the function at ``s``, from where the Newton step leads to ``new``.
    """
    low, high = where(g > 0.0, low, s), where(g > 0.0, s, high)
    return low, high, new if slope > 0.0 and new >= low and new <= high else 0.5 * (low + high)


@branches
def crossing_time(s: BoundedCoordinate, h: Any, side: Any, gap: Any, share: Any, turned: Any) -> Any:
    """Time at which the quintic through both ends of a step of length ``h`` passes the limit of a side, s.

    Three iterations find the zero to the accuracy with which the quintic describes the event. The coordinate
    starts ``gap`` above the limit; ``share`` is a guess, as a fraction of the step, and at the fraction
    ``turned`` an inward motion has turned.
    """
    c = quintic_through(s, h, gap)
    slopes = [c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 5.0 * c[5]]
    low, high = turned_inward(s, side, turned), 1.0
    share = maximum(share, low)
    # The reciprocal of the slope is updated by a separate Newton step, without a division.
    per_slope = 1.0 / (side * polynomial(slopes, share))
    for _ in range(3):
        g, slope = side * polynomial(c, share), side * polynomial(slopes, share)
        per_slope = per_slope * (2.0 - slope * per_slope)
        low, high, share = nearer_root(g, slope, low, high, share, share - g * per_slope)
    return h * share


@branches
def turned_inward(s: BoundedCoordinate, side: Any, turned: Any) -> Any:
    """Fraction of a step before which a coordinate that starts inward does not pass its limit."""
    v0, v1 = s.start_velocity, s.velocity
    return minimum(turned, 1.0) if side * v0 < 0.0 and v0 * v1 < 0.0 else 0.0


@branches
def chord(e: Encounter, h: Any, side: Any, gap: Any) -> tuple[Any, Any]:
    """Fraction of a step at which a coordinate has its event, from both ends: numerator and denominator.

    For a free coordinate, which starts ``gap`` above its limit, it is where the parabola of its positions and
    first velocity meets the limit, for a resting one where the chord of the forces that hold it changes its
    sign.
    """
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
    """The first event of a coordinate in a trial step of length ``h``, with 1 / ``h``.

    ``smooth`` is false for Euler's method, with which the end of a step is quadratic in its length.
    """
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
    return Event(time, side, turns)


@branches
def arrival_nearby(s: BoundedCoordinate, h: Any) -> tuple[Any, Event]:
    """Whether a coordinate certainly reaches a stop near which it starts, and its impact there, independent
    of the end of the step of ``h``.

    Which of two such coordinates arrives first follows from their start. One that its acceleration turns
    before it is beyond the stop by more than rounding does not arrive.
    """
    side, speed = direction(s.start_velocity), abs(s.start_velocity)
    way, acceleration = side * (s.limit(side) - s.start_position), side * s.watched.first
    time = 2.0 * way / (speed + sqrt(maximum(speed * speed + 2.0 * acceleration * way, 0.0)))
    before = (way > 0.0) & (way <= maximum(s.closeness, TAYLOR_SHARE * h * speed))
    goes_beyond = speed * speed + 2.0 * acceleration * (way + s.closeness) > 0.0
    certain = s.free & before & goes_beyond & (speed > 0.0) & (time <= 0.5 * h)
    return certain, Event(time, side, False)
