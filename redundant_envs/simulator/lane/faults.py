"""Faults of lanes, why they leave the common step, how their steps are chosen, and bounds of angles."""

import enum
from functools import reduce
from typing import Any

from redundant_envs.language.algebra import floor, maximum, total, where
from redundant_envs.robots.arm import Arm


class Fault(enum.IntFlag):
    """Faults of a lane, as ``info["numerics"]`` reports them."""

    NON_FINITE = 1  # a state is no finite number
    BAD_ACTION = 2  # the action was no finite number
    SPEED_BOUND = 4  # a rate has passed the bound of the task
    TOLERANCE_NOT_REACHED = 8  # the most steps that an interval may have did not suffice for its tolerance
    EVENT_BUDGET = 16  # the interval has more events than it may have, and was not crossed
    NO_STEP_FOUND = 32  # dop853 has found no step that is short enough
    LARGE_ANGLE = 64  # an angle is so large that its last digits are lost


def either(a: Any, b: Any) -> Any:
    """The faults of two numbers together."""

    def has(faults: Any, fault: Fault) -> Any:
        return floor(faults / fault) - 2.0 * floor(faults / (2.0 * fault)) > 0.0

    return total(where(has(a, fault) | has(b, fault), float(fault), 0.0) for fault in Fault)


GIVEN_UP = Fault.EVENT_BUDGET
"""From this fault on the interval was not crossed, and its lane has the state of its start again."""


class Reason(enum.IntEnum):
    """Reason why a lane leaves the common step."""

    NONE = 0  # it stays: the step serves it
    ACCURACY = 1  # the step is not accurate enough
    EVENT = 2  # the step meets a boundary
    NEAR_BOUNDARY = 3  # not decided yet, but near a boundary


class Control(enum.Enum):
    """How the steps of a lane are chosen."""

    FIXED = "fixed"  # each common step is one step
    EQUAL = "equal"  # 1, 2, 4, ... equal steps, until their errors pass
    ADAPTIVE = "adaptive"  # each as long as its error allows (dop853)


LARGEST_ANGLE = 1e6
"""rad: beyond it an angle is known to no more than 1e-10 rad, and rounding adds up."""
OBSERVED_ANGLE, OBSERVED_RATE = 1e14, 1e100
"""rad; rad/s and m/s: states beyond cannot be observed, since sines of larger angles are not computed."""


def largest_angle(arm: Arm, lane: Any) -> Any:
    """The largest of the coordinates of a lane that are angles, rad."""
    joints = zip(arm.coordinates, arm.prismatic, strict=True)
    return reduce(maximum, [abs(lane[q]) for q, slides in joints if not slides] or [0.0])


def is_observable(arm: Arm, lane: Any, fastest: Any) -> Any:
    """Whether the state of a lane can be observed, whose largest rate is ``fastest``."""
    return (largest_angle(arm, lane) <= OBSERVED_ANGLE) & (fastest <= OBSERVED_RATE)


def angle_fault(arm: Arm, lane: Any) -> Any:
    """A fault if an angle is so large that its last digits are lost."""
    return where(largest_angle(arm, lane) > LARGEST_ANGLE, float(Fault.LARGE_ANGLE), 0.0)
