"""A load in the gripper."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.effects.hooks import Effect, Hook, Point, PointMass
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import not_negative, number


@dataclass(frozen=True)
class Payload(Effect):
    """A point mass that is carried at the tip, from the start to the end of a motion.

    The arm moves as one whose last mass is heavier by it, to the bit; :class:`PickUp` is a load that comes
    later.

    Parameters
    ----------
    mass : float
        kg, not negative.
    """

    mass: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", not_negative("Payload.mass", number("Payload.mass", self.mass)))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return (PointMass(Point(arm.num_masses - 1), ".mass"),)
