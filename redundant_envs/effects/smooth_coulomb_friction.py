from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative, positive
from redundant_envs.language.algebra import physics, sqrt


@physics
def force(rate, levels, speed):
    return -levels * rate / sqrt(rate * rate + speed * speed)


@physics
def steepest(levels, speed):
    """Slope of the friction at rest."""
    return levels / speed


@physics
def bends(rate, speed):
    """0 at the rates at which the friction bends most: a step across one may contain its whole change, which
    estimates do not see."""
    return rate - 0.5 * speed, rate + 0.5 * speed


@dataclass(frozen=True)
class SmoothCoulombFriction(Effect):
    """Friction of a constant level, which falls to zero below a speed.

    A joint never sticks: under a constant load below the level it creeps.

    Parameters
    ----------
    levels : float or sequence of one for each joint
        Level c, N m (revolute) or N (prismatic), not negative; one number serves all joints.
    speed : float or sequence of one for each joint
        Speed e, rad/s or m/s, positive: at this rate the friction is 1/sqrt(2) of its level.
    """

    levels: float | Numbers = field(metadata=each_joint(not_negative, "N m", "N"))
    speed: float | Numbers = field(default=0.01, metadata=each_joint(positive, "rad/s", "m/s"))

    example = Example({"levels": 0.5, "speed": 0.1}, curve=Curve("force", "rate", 1.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Force(k, force, damping=steepest, kink=bends)
