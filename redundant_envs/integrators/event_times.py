"""Time of a slider's event in a trial step: an estimate, from which the search for the event begins.

An event is an impact at a stop, a release from it, or a turn that may lie beyond it. Sides are 1 at the upper
stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from redundant_envs.algebra import logical_not, maximum, minimum, sqrt, where
from redundant_envs.integrators.crossings import Crossing
from redundant_envs.integrators.sliders import Slider

TAYLOR_SHARE = 2e-8
"""Largest length of a Taylor step to a stop, as a fraction of the planned step: half its square, the error of
positions and velocities, is rounding."""


class Encounter(NamedTuple):
    """Data of a slider and its stops in a trial step, beside its motion.

    Attributes
    ----------
    force, start_force : exerted by its stop along it at the end of the trial step and at its start, N
    crossing : how the trial step meets a stop
    turning_time : time at which the slider turns in it, s
    cleared : whether it is known to turn before its stop
    mobility : of the slider, 1/kg
    """

    force: Any
    start_force: Any
    crossing: Any
    turning_time: Any
    cleared: Any
    mobility: Any


class SliderEvent(NamedTuple):
    """The first event of a slider in a trial step.

    Attributes
    ----------
    time : from the start of the step, s; later than its end if there is no event
    side : of the stop
    turns : whether the slider only turns near the stop
    """

    time: Any
    side: Any
    turns: Any


class Quintic(NamedTuple):
    """side (gap + s0 s + c2 s^2 + ... + c5 s^5): distance of a slider beyond a stop, at a fraction s of a
    step."""

    side: Any
    gap: Any
    s0: Any
    c2: Any
    c3: Any
    c4: Any
    c5: Any

    def value(self, s: Any) -> Any:
        """Distance of the slider beyond the stop, m."""
        inner = self.c2 + s * (self.c3 + s * (self.c4 + s * self.c5))
        return self.side * (self.gap + s * (self.s0 + s * inner))

    def slope(self, s: Any) -> Any:
        """Its derivative with respect to s, m."""
        inner = 3.0 * self.c3 + s * (4.0 * self.c4 + s * (5.0 * self.c5))
        return self.side * (self.s0 + s * (2.0 * self.c2 + s * inner))


def quintic_through(s: Slider, h: Any, side: Any, gap: Any) -> Quintic:
    """The quintic with a slider's positions, velocities and accelerations at both ends of a step.

    The acceleration at the end is that of the last stage. The slider starts ``gap`` above its stop.
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
    low = where(g > 0.0, low, s)
    high = where(g > 0.0, s, high)
    new = s - g * per_slope
    middle = 0.5 * (low + high)
    new = where(slope > 0.0, where(new >= low, where(new <= high, new, middle), middle), middle)
    return low, high, new, per_slope


def crossing_time(s: Slider, h: Any, side: Any, gap: Any, share: Any, turned: Any) -> Any:
    """Time at which the quintic through both ends of a step passes a stop, s.

    Three iterations find the zero to the accuracy with which the quintic describes the event.

    Parameters
    ----------
    s, h : the slider, and the length of the step
    side, gap : side of the stop, and distance above it at which the slider starts, m
    share : a guess, as a fraction of the step
    turned : fraction of the step at which an inward motion has turned
    """
    v0, v1 = s.start_velocity, s.velocity
    f = quintic_through(s, h, side, gap)
    low = where(side * v0 < 0.0, where(v0 * v1 < 0.0, minimum(turned, 1.0), 0.0), 0.0)
    high: Any = 1.0
    share = maximum(share, low)
    per_slope = 1.0 / f.slope(share)
    for _ in range(3):
        low, high, share, per_slope = nearer_root(f, low, high, share, per_slope)
    return h * share


def chord_share(s: Slider, e: Encounter, h: Any, side: Any, gap: Any) -> Any:
    """Fraction of a step at which a slider has its event, from both ends: one division for two formulas.

    For a free slider it is where the parabola of its positions and first velocity meets the stop, for a
    resting one where the chord of the forces that hold it changes its sign.

    Parameters
    ----------
    s, e, h : the slider, its stops, and the length of the step
    side, gap : side of the stop, and distance above it at which the slider starts, m
    """
    pull = s.active_stop * e.force
    push = maximum(-s.active_stop * e.start_force, 0.0)
    start = side * h * s.start_velocity
    bend = side * (s.position - s.start_position) - start
    outward = sqrt(maximum(start * start - 4.0 * bend * side * gap, 0.0))
    share = where(start > 0.0, -2.0 * side * gap, outward - start)
    return where(pull > 0.0, push, share) / where(
        pull > 0.0, push + pull, where(start > 0.0, start + outward, 2.0 * bend)
    )


def first_event(s: Slider, e: Encounter, h: Any, per_h: Any, smooth: bool) -> SliderEvent:
    """The first event of a slider in a trial step.

    Parameters
    ----------
    s, e : the slider, and its stops
    h, per_h : length of the step, s, and one over it
    smooth : whether the method is not Euler's, with which the end of a step is quadratic in its length
    """
    side = s.side_beyond
    gap = s.start_position - s.stop(side)
    share = chord_share(s, e, h, side, gap)
    # For a slider that begins at its stop and returns the formula fails: its event is near the end, if at
    # all.
    guess = where(share > 0.0, where(share < 1.0, share, 1.0), 1.0)
    impact = h * guess
    if smooth:
        impact = crossing_time(s, h, side, gap, guess, e.turning_time * per_h)
    # A slider that ends beyond the other stop has turned before.
    turns = (abs(e.crossing) == Crossing.TURNS_NEAR) & logical_not(e.cleared) & s.free
    time = where(side == 0.0, h + 1.0, impact)
    time = where(turns, e.turning_time, time)
    time = where(s.active_stop * e.force > 0.0, h * share, time)
    side = where(turns, 0.0, side)
    side = where(side == 0.0, where(e.crossing > 0.0, 1.0, -1.0), side)
    if s.passes:
        return SliderEvent(time, side, turns)
    near = arrival_nearby(s, h)
    soon = near.certain & logical_not(e.cleared)
    return SliderEvent(where(soon, near.time, time), where(soon, near.side, side), turns & logical_not(soon))


class Arrival(NamedTuple):
    """Arrival of a slider at a stop that is very near at the start of a step.

    Attributes
    ----------
    certain : whether it reaches the stop, and would pass it if nothing stopped it
    time : of the arrival, s
    side : of the stop
    """

    certain: Any
    time: Any
    side: Any


def arrival_nearby(s: Slider, h: Any) -> Arrival:
    """Arrival of a slider at a stop near which it starts, independent of the end of the step of ``h``.

    Which of two such sliders arrives first follows from their start. A slider that its acceleration turns
    before it is beyond the stop by more than rounding does not arrive.
    """
    side, speed = where(s.start_velocity > 0.0, 1.0, -1.0), abs(s.start_velocity)
    way, acceleration = side * (s.stop(side) - s.start_position), side * s.watched.first
    time = 2.0 * way / (speed + sqrt(maximum(speed * speed + 2.0 * acceleration * way, 0.0)))
    before = (way > 0.0) & (way <= maximum(s.closeness, TAYLOR_SHARE * h * speed))
    goes_beyond = speed * speed + 2.0 * acceleration * (way + s.closeness) > 0.0
    return Arrival(s.free & before & goes_beyond & (speed > 0.0) & (time <= 0.5 * h), time, side)


class Candidate(NamedTuple):
    """A slider that may have the next event.

    Attributes
    ----------
    number : of the slider
    slider, encounter : its motion in a trial step, and data of its stops there
    event : its first event there
    """

    number: float
    slider: Slider
    encounter: Encounter
    event: SliderEvent

    @property
    def pull(self) -> Any:
        """Force with which its stop would have to pull it at the end of the step, N."""
        return self.slider.active_stop * self.encounter.force

    @property
    def start_pull(self) -> Any:
        """Force with which its stop would have to pull it at the start of the step, N."""
        return self.slider.active_stop * self.encounter.start_force
