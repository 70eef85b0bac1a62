from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import identity, physics


@physics
def force(rate, coefficients):
    """Opposes the rate of the joint, not that of the absolute angle."""
    return -coefficients * rate


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """Friction proportional to the joint rates.

    Parameters
    ----------
    coefficients : float or sequence of one for each joint
        N m s/rad (revolute) or N s/m (prismatic), not negative; one number serves all joints.
    """

    coefficients: float | Numbers = field(metadata=each_joint(not_negative, "N m s/rad", "N s/m"))

    example = Example({"coefficients": 0.2}, zero={"coefficients": 0.0}, curve=Curve("force", "rate", 3.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Force(k, force, damping=identity("coefficients"))
