from dataclasses import dataclass, field

from redundant_envs.effects.effort_limits import WITHIN
from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, at_each_joint, effort_unit
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative, positive
from redundant_envs.language.algebra import clamp, maximum, physics, where


@physics
def line(rate, stall, free):
    """The largest effort of a motor that drives: that at rest, and less the faster it turns."""
    return stall * (1.0 - rate / free)


@physics
def corners(command, rate, stall, free):
    """By how much a command is above the largest effort upwards, and above the largest downwards; the
    distance of the rate from the free speed; and that of the command from the stall effort.

    A command beyond the stall effort counts as that, so that the line is left where the motor begins to
    brake. A command of 0 is within both efforts, also where none is left.
    """
    most, share = clamp(command, -stall, stall), stall * WITHIN
    upper = most - maximum(line(rate, stall, free), 0.0) - share
    lower = most + maximum(line(-rate, stall, free), 0.0) + share
    return upper, lower, free * free - rate * rate, stall - abs(command)


@physics
def available(command, rate, stall, free, side1, side2, side3, side4):
    upper = where(side3 < 0.0, 0.0, line(rate, stall, free))
    lower = where(side3 < 0.0, 0.0, -line(-rate, stall, free))
    braking = where(side4 < 0.0, where(command > 0.0, stall, -stall), command)
    return where(side1 > 0.0, upper, where(side2 < 0.0, lower, braking))


@dataclass(frozen=True)
class TorqueSpeed(Effect):
    """The straight torque-speed line of a motor under a constant voltage limits its effort.

    A motor that drives at a rate w has at most the effort stall (1 - w / free), none beyond the free speed;
    one that brakes has at most the stall effort.

    Parameters
    ----------
    stall : float or sequence of one for each joint
        Largest effort at rest, N m (revolute) or N (prismatic), not negative; one number serves all joints.
    free : float or sequence of one for each joint
        Rate of the joint at which none is left, rad/s or m/s, positive.
    """

    stall: float | Numbers = field(metadata=each_joint(not_negative, "N m", "N"))
    free: float | Numbers = field(metadata=each_joint(positive, "rad/s", "m/s"))

    example = Example({"stall": 10.0, "free": 8.0}, curve=Curve("force", "rate", 12.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Actuation(k, available, link=Link.TORQUE_SPEED, takes=effort_unit(arm, k), guard=corners)
