from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import physics


@physics
def force(rate, coefficients):
    """Opposes the rate of the joint, not that of the absolute angle."""
    return -coefficients * rate * abs(rate)


@physics
def slope(rate, coefficients):
    return 2.0 * coefficients * abs(rate)


@dataclass(frozen=True)
class QuadraticFriction(Effect):
    """Friction proportional to the square of the joint rates, as of a body that stirs a fluid.

    Parameters
    ----------
    coefficients : float or sequence of one for each joint
        N m s^2/rad^2 (revolute) or N s^2/m^2 (prismatic), not negative; one number serves all joints.
    """

    coefficients: float | Numbers = field(metadata=each_joint(not_negative, "N m s^2/rad^2", "N s^2/m^2"))

    example = Example({"coefficients": 0.1}, curve=Curve("force", "rate", 3.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Force(k, force, damping=slope)
