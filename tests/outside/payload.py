"""A load in the gripper: a point mass that moves with the tip."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.effects import Effect, Point, PointMass
from redundant_envs.robots.parameters import not_negative


@dataclass(frozen=True)
class Payload(Effect):
    """A point mass at the tip.

    Parameters
    ----------
    mass : float
        kg, not negative.
    """

    mass: float

    def __post_init__(self):
        object.__setattr__(self, "mass", not_negative("Payload.mass", self.mass))

    def hooks(self, arm):
        return (PointMass(Point(arm.num_masses - 1), ".mass"),)


rde.register_effect(Payload)
