"""Boundaries of a motion: a coordinate between two limits, and what happens where it reaches one of them.

The coordinate is the travel of a joint, or any other function of the motion. A guard has no coordinate: it is
a value that must keep its sign as long as a law holds, as a stop must not have to pull. In all modules of
events, sides are 1 at the upper limit, -1 at the lower one, 0 at none.
"""

import math
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import maximum, where
from redundant_envs.language.limits import ROUNDING, side_beyond
from redundant_envs.simulator.numerics.methods import Watched

NEGLIGIBLE_SPEED = 1e-13
"""m/s; such a speed at a stop is rounding: the coordinate neither strikes the stop nor leaves it."""
NO_LIMIT = 1e300
"""Larger limits count as absent: infinite ones must not make every position close to them."""
MARGIN = 1e-13
"""m or rad, relative above 1: if a force changes its law this much later, the error is below tolerances."""
SMALLEST_SCALE = 1e-280
"""Smallest scale of rounding, for positions and limits that are all 0."""


class BoundedCoordinate(NamedTuple):
    """A coordinate with a boundary in a step; m and m/s, or rad and rad/s."""

    position: Any  # at the end of the step
    velocity: Any
    start_position: Any
    start_velocity: Any
    watched: Watched  # accelerations at the stages; while it rests, pulling forces of its stop, N
    active_stop: Any  # side of the stop it rests at
    lower: Any
    upper: Any
    bounces: bool = True  # whether its limits are stops; otherwise it passes them
    scale: Any = 0.0  # size of the numbers from which it is computed, if these are larger than its own
    guards: bool = False  # whether it is no coordinate, but a guard whose value is watched as a pull is
    sticks: bool = False  # whether that guard is of a joint that sticks

    @property
    def free(self) -> Any:
        """Whether it rests at no stop."""
        return self.active_stop == 0.0

    @property
    def closeness(self) -> Any:
        """Positions nearer than this to a limit are at it: four ulps, but never 0."""
        largest = maximum(size_of(self.lower), size_of(self.upper))
        if not isinstance(self.scale, float):
            largest = maximum(largest, self.scale)
        return ROUNDING * maximum(largest, maximum(abs(self.start_position), SMALLEST_SCALE))

    @property
    def side_beyond(self) -> Any:
        """Side of the limit that it is beyond at the end of the step, if it is free."""
        return where(self.free, side_beyond(self.position, self.lower, self.upper), 0.0)

    def limit(self, side: Any) -> Any:
        """The limit of a side."""
        return where(side > 0.0, self.upper, self.lower)


def guarded(watched: Watched, sticks: bool = False) -> BoundedCoordinate:
    """A guard in a step: like a coordinate that always rests, so that only its pull counts."""
    return BoundedCoordinate(
        0.0, 0.0, 0.0, 0.0, watched, 1.0, -math.inf, math.inf, bounces=False, guards=True, sticks=sticks
    )


@branches
def size_of(limit: Any) -> Any:
    """Size of a limit; 0 if there is none."""
    return abs(limit) if abs(limit) < NO_LIMIT else 0.0


@branches
def direction(x: Any) -> Any:
    """The side towards which a velocity points, or the sign of a number; -1 for 0."""
    return 1.0 if x > 0.0 else -1.0


@branches
def inside(guess: Any, low: Any, high: Any, otherwise: Any) -> Any:
    """A guess if it is between the ends of a bracket and at none of them."""
    return guess if guess > low and guess < high else otherwise


@branches
def limits_of_law(side: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """Positions between which a joint keeps the law of a side, 1 above ``upper``, -1 below ``lower``: ranges
    overlap by two margins, so that rounding does not switch the law back and forth."""
    low, high = MARGIN * maximum(abs(lower), 1.0), MARGIN * maximum(abs(upper), 1.0)
    if side > 0.0:
        return upper - high, math.inf
    if side < 0.0:
        return -math.inf, lower + low
    return lower - low, upper + high


@branches
def law_behind(side: Any, crossed: Any) -> Any:
    """Side of the law that holds once a limit of the present one is crossed: upwards is 1, downwards -1."""
    return crossed if side == 0.0 else 0.0


@branches
def side_touched(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Side of the stop that a coordinate touches, whatever its velocity."""
    if active_stop != 0.0:
        return active_stop
    return 1.0 if position >= upper else -1.0 if position <= lower else 0.0


def starts_at_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free coordinate starts at a stop and does not move away from it."""
    up, down = (position >= upper) & (velocity >= 0.0), (position <= lower) & (velocity <= 0.0)
    return (active_stop == 0.0) & (up | down)


def leaves_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free coordinate starts at a stop and moves away, at any speed that is not rounding: it does
    not rest there."""
    up = (position >= upper) & (velocity < -NEGLIGIBLE_SPEED)
    down = (position <= lower) & (velocity > NEGLIGIBLE_SPEED)
    return (active_stop == 0.0) & (up | down)
