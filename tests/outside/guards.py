"""Effects of a user whose laws change where a guard changes its sign."""

from dataclasses import dataclass

from redundant_envs.algebra import physics, where
from redundant_envs.effects import Effect, Force


@physics
def brake(rate, position, level, side):
    """Friction that is strong in one half of the travel: its force jumps."""
    return -where(side > 0.0, level, 0.1 * level) * rate


@physics
def in_bands(position):
    """Positive between the first and the second edge, and behind the third."""
    return (position + 0.05) * (position - 0.02) * (position - 0.06)


itself = physics(lambda position: position)
banded = physics(lambda position, rate, level, side: -where(side > 0.0, level, 0.0) * rate)


@dataclass(frozen=True)
class BrakeInBands(Effect):
    """A brake on the first joint that acts in two ranges of its angle, and jumps at their edges."""

    level: float = 0.5

    def hooks(self, arm):
        return (Force(0, banded, {"position": "phi1", "rate": "phid1", "level": ".level"}, guard=in_bands),)


@dataclass(frozen=True)
class HalfBrake(Effect):
    """A brake on the first joint that acts where its angle is positive."""

    level: float = 2.0

    def hooks(self, arm):
        bind = {"rate": "phid1", "position": "phi1", "level": ".level"}
        return (Force(0, brake, bind, guard=itself),)
