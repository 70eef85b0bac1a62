"""Effects of a user whose laws change where a guard changes its sign."""

from dataclasses import dataclass

from redundant_envs.algebra import physics, where
from redundant_envs.effects import Actuation, Effect, Force, Link


@physics
def beyond_curve(command, rate, stall, free):
    """Effort above the line from stall to free speed, and above the opposite line."""
    return command - stall * (1.0 - rate / free), command + stall * (1.0 + rate / free)


@physics
def below_curve(command, rate, stall, free, side1, side2):
    upper, lower = stall * (1.0 - rate / free), -stall * (1.0 + rate / free)
    return where(side1 > 0.0, upper, where(side2 < 0.0, lower, command))


@dataclass(frozen=True)
class SpeedCurve(Effect):
    """A motor whose largest effort falls with its speed: two guards of each link."""

    stall: float = 10.0
    free: float = 8.0

    def hooks(self, arm):
        own = {"stall": ".stall", "free": ".free"}
        return tuple(
            Actuation(
                k, below_curve, {"command": f"command{k + 1}", "rate": f"phid{k + 1}", **own},
                Link.TORQUE_SPEED, guard=beyond_curve,
            )
            for k in range(len(arm.joints))
        )  # fmt: skip


@physics
def brake(rate, position, level, side):
    """Friction that is strong in one half of the travel: its force jumps."""
    return -where(side > 0.0, level, 0.1 * level) * rate


@physics
def in_bands(position):
    """Positive between the first and the second edge, and behind the third."""
    return (position + 0.05) * (position - 0.02) * (position - 0.06)


@physics
def banded(position, rate, level, side):
    return -where(side > 0.0, level, 0.0) * rate


@dataclass(frozen=True)
class BrakeInBands(Effect):
    """A brake on the first joint that acts in two ranges of its angle, and jumps at their edges."""

    level: float = 0.5

    def hooks(self, arm):
        return (Force(0, banded, {"position": "phi1", "rate": "phid1", "level": ".level"}, guard=in_bands),)


@physics
def itself(position):
    return position


@dataclass(frozen=True)
class HalfBrake(Effect):
    """A brake on the first joint that acts where its angle is positive."""

    level: float = 2.0

    def hooks(self, arm):
        bind = {"rate": "phid1", "position": "phi1", "level": ".level"}
        return (Force(0, brake, bind, guard=itself),)
