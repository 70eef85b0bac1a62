"""Motors whose largest effort falls with their speed."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.algebra import clamp, physics, where
from redundant_envs.effects.hooks import Actuation, Effect, Hook, Link, effort_unit, units_of_joints
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import not_negative, positive


@physics
def largest(rate, stall, free):
    """Largest effort along a rate: that at rest if the motor brakes, and less the faster it drives."""
    return stall * clamp(1.0 - rate / free, 0.0, 1.0)


@physics
def corners(command, rate, stall, free):
    """By how much a command is above the largest and the least effort; whether the motor brakes under a
    command beyond its stall effort, if negative; and the distance from the free speed."""
    braking = where(command > stall, rate, where(command < -stall, -rate, 1.0))
    beyond = command - largest(rate, stall, free), command + largest(-rate, stall, free)
    return *beyond, braking, free * free - rate * rate


@physics
def on_line(rate, stall, free, side3, side4):
    """The largest effort on its present piece, which continues smoothly beyond its ends."""
    line = stall * (1.0 - rate / free)
    return where(side3 < 0.0, stall, where(side4 < 0.0, where(rate > 0.0, 0.0, stall), line))


@physics
def available(command, rate, stall, free, side1, side2, side3, side4):
    lower = -on_line(-rate, stall, free, side3, side4)
    return where(side1 > 0.0, on_line(rate, stall, free, side3, side4), where(side2 < 0.0, lower, command))


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

    stall: float | tuple[float, ...]
    free: float | tuple[float, ...]

    of_joints = ("stall", "free")

    def __post_init__(self) -> None:
        object.__setattr__(self, "stall", not_negative("TorqueSpeed.stall", self.stall))
        object.__setattr__(self, "free", positive("TorqueSpeed.free", self.free))

    def units(self, arm: Arm) -> dict[str, str]:
        return units_of_joints("stall", arm, "N m", "N") | units_of_joints("free", arm, "rad/s", "m/s")

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(self._link(k, effort_unit(arm, k)) for k in range(len(arm.joints)))

    def _link(self, k: int, unit: str) -> Actuation:
        bind = {"command": f"command{k + 1}", "rate": f"phid{k + 1}"}
        bind |= {"stall": f".stall[{k}]", "free": f".free[{k}]"}
        return Actuation(k, available, bind, Link.TORQUE_SPEED, takes=unit, guard=corners)
