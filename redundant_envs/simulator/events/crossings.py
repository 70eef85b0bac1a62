"""Whether a trial step meets a boundary, and how: bounds from the accelerations at its stages, which
docs/design.md explains ("An impact is found between the stages of a step")."""

import enum
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import floor, logical_not, maximum, minimum, sqrt
from redundant_envs.language.limits import ROUNDING
from redundant_envs.simulator.events.boundary import BoundedCoordinate, direction
from redundant_envs.simulator.numerics.methods import Watched

NEARLY_0 = 1e-4
"""Value of a guard at an end of a step, in units of its range in the step, that is nearly 0, as after a
passage that was found late, or before one in the next step: one to and fro between this end and the stage
beside it has at most a thousandth of that range."""


class Crossing(enum.IntEnum):
    """How a trial step meets a boundary; negative at the lower limit."""

    NONE = 0  # it stays between the limits
    ENDS_BEYOND = 1  # the step ends beyond the limit, and passes it once
    TURNS_NEAR = 2  # the coordinate turns once, and may be beyond the limit then
    UNCLEAR = 4  # it may pass the limit more often than the ends of the step and the turning point show


class Overshoot(NamedTuple):
    """Largest overshoot of an acceleration between stages and near ends (Tableau.overshoot_between_nodes)."""

    between: float
    at_ends: float


def may_meet(s: BoundedCoordinate, h: Any, overshoot: Overshoot) -> Any:
    """Whether a free coordinate may meet a limit in a step, by a cheap bound of :func:`excursions`: it
    exceeds its ends by at most A h^2 / 8 if q'' >= -A."""
    more = overshoot.between * (s.watched.most - s.watched.least)
    eighth = 0.125 * h * h
    top = maximum(s.start_position, s.position) + eighth * maximum(more - s.watched.least, 0.0)
    bottom = minimum(s.start_position, s.position) - eighth * maximum(s.watched.most + more, 0.0)
    return s.free & logical_not((top < s.upper) & (bottom > s.lower))


@branches
def most_pull(s: BoundedCoordinate, overshoot: Overshoot) -> Any:
    """Largest force with which the stop of a resting coordinate may have to pull in a step, or 0."""
    return 0.0 if s.free else maximum(s.watched.most + margins(s.watched, overshoot)[1], 0.0)


@branches
def acceleration_bounds(s: BoundedCoordinate, overshoot: Overshoot) -> tuple[Any, Any]:
    """Bounds of an acceleration in a step: the range at its stages, widened by the overshoot of a parabola. A
    coordinate that starts at its stop was struck or released there: the range is not widened towards it."""
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


def passes_within(w: Watched) -> Any:
    """Whether a guard may be positive, by more than rounding, at or near a stage within a step."""
    return w.inner > ROUNDING * (w.most - w.least)


@branches
def may_pass(w: Watched, overshoot: Overshoot) -> Any:
    """Whether a guard may be positive at a stage of a step or between two, by more than rounding. The first
    value of one that leaves 0 does not count, nor the last of one that only gets there."""
    size, ends = w.most - w.least, maximum(w.first, w.last)
    at_ends = ends if -ends <= NEARLY_0 * size else ends + overshoot.at_ends * size
    return maximum(at_ends, w.inner) > ROUNDING * size


def meets_kink(w: Watched, levels: bool, overshoot: Overshoot) -> tuple[Any, Any]:
    """Whether a quantity passes 0, or with ``levels`` a whole number, in a step: seen at stages, or between
    two of them and back. A quantity that starts at 0 and leaves it does not pass it."""
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
    """Indicator, 0 or more if a velocity keeps its sign in a step: it cannot change enough from one of its
    ends with an acceleration in lo..hi; or its acceleration grows throughout, and it stays below its ends; or
    falls throughout, and it stays above them."""
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
    """How a step meets a boundary: a :class:`Crossing`, with the sign of the side unless it is unclear. A
    velocity that keeps its sign meets a limit once at most, an acceleration that does turns once."""
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
