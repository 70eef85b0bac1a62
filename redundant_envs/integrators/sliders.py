"""A slider between its two stops: its motion in a step, and the stop that it touches or is beyond.

A joint on which a force changes its law at two positions is treated in the same way, but may pass them. Sides
are 1 at the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import maximum, where
from redundant_envs.integrators.methods import Watched

ROUNDING = 8.881784197001252e-16
"""Relative distance of four ulps: positions and times that are nearer count as equal."""
NEGLIGIBLE_SPEED = 1e-13
"""m/s; such a speed of a slider at its stop is rounding: it neither strikes the stop nor leaves it."""
NO_STOP = 1e300
"""Larger limits count as absent: infinite ones must not make every position close to them."""
MARGIN = 1e-13
"""m or rad, relative above 1: if a force changes its law this much later, the error is below tolerances."""
SMALLEST_SCALE = 1e-280
"""Smallest scale of rounding, for positions and limits that are all 0."""


class Slider(NamedTuple):
    """A slider in a step.

    Attributes
    ----------
    position, velocity : at the end of the step, m and m/s
    start_position, start_velocity : at its start
    watched : accelerations at the stages, m/s^2; for a resting slider, pulling forces of its stop, N
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    passes : whether it may pass these positions, at which a force on it changes its law
    """

    position: Any
    velocity: Any
    start_position: Any
    start_velocity: Any
    watched: Watched
    active_stop: Any
    lower: Any
    upper: Any
    passes: bool = False

    @property
    def free(self) -> Any:
        """Whether it rests at no stop."""
        return self.active_stop == 0.0

    @property
    def closeness(self) -> Any:
        """Positions nearer than this to a stop are at it: four ulps, m, but never 0."""
        low = where(abs(self.lower) < NO_STOP, abs(self.lower), 0.0)
        high = where(abs(self.upper) < NO_STOP, abs(self.upper), 0.0)
        return ROUNDING * maximum(maximum(low, high), maximum(abs(self.start_position), SMALLEST_SCALE))

    @property
    def side_beyond(self) -> Any:
        """Side of the stop that it is beyond at the end of the step, if it is free."""
        return where(self.free, side_beyond(self.position, self.lower, self.upper), 0.0)

    def stop(self, side: Any) -> Any:
        """Position of the stop of a side, m."""
        return where(side > 0.0, self.upper, self.lower)


def side_beyond(position: Any, lower: Any, upper: Any) -> Any:
    """Side of the limit that a position is beyond."""
    return where(position > upper, 1.0, where(position < lower, -1.0, 0.0))


def limits_of_law(side: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """Positions between which a joint keeps the law of a side.

    Ranges overlap by twice a margin, so that rounding does not switch the law back and forth.

    Parameters
    ----------
    side : 1 above the upper position, -1 below the lower, 0 between
    lower, upper : positions at which the law changes, m or rad
    """
    low, high = MARGIN * maximum(abs(lower), 1.0), MARGIN * maximum(abs(upper), 1.0)
    return (
        where(side > 0.0, upper - high, where(side < 0.0, -math.inf, lower - low)),
        where(side < 0.0, lower + low, where(side > 0.0, math.inf, upper + high)),
    )


def law_behind(side: Any, crossed: Any) -> Any:
    """Side of the law that holds once a limit of the present one is crossed: upwards is 1, downwards -1."""
    return where(side == 0.0, crossed, 0.0)


def side_touched(position: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Side of the stop that a slider touches."""
    at = where(position >= upper, 1.0, where(position <= lower, -1.0, 0.0))
    return where(active_stop == 0.0, at, active_stop)


def starts_at_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free slider starts at a stop and does not move away from it.

    Parameters
    ----------
    position, velocity : of the slider, m and m/s
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    """
    up, down = (position >= upper) & (velocity >= 0.0), (position <= lower) & (velocity <= 0.0)
    return (active_stop == 0.0) & (up | down)


def leaves_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free slider starts at a stop and moves away from it.

    Such a slider does not come to rest there, however slow it is, unless its speed is rounding.

    Parameters
    ----------
    position, velocity : of the slider, m and m/s
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    """
    up = (position >= upper) & (velocity < -NEGLIGIBLE_SPEED)
    down = (position <= lower) & (velocity > NEGLIGIBLE_SPEED)
    return (active_stop == 0.0) & (up | down)


def pick(chosen: Sequence[Any], values: Sequence[Any]) -> Any:
    """The value of the chosen slider; that of the first one if none of the others is chosen."""
    value = values[0]
    for is_chosen, other in zip(chosen[1:], values[1:], strict=True):
        value = where(is_chosen, other, value)
    return value
