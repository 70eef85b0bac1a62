import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from redundant_envs.effects.hooks import Arm, Hook
from redundant_envs.effects.inner_control import GAIN, InnerControl, Wanted, of_joints, usual_speeds
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, one, positive, strengths
from redundant_envs.language.algebra import numbered, sqrt


@functools.lru_cache(maxsize=64)
def approach(count: int) -> Callable[..., Any]:
    def rates(stiffness, *values):
        command, position, middle, speeds = (values[k * count : (k + 1) * count] for k in range(4))
        for_each = zip(command, position, middle, speeds, strict=True)
        return [_approach(stiffness * (m + c - p), speed) for c, p, m, speed in for_each]

    return rates


def _approach(rate: Any, speed: Any) -> Any:
    """A rate bent to less than the speed of its joint."""
    return speed * rate / sqrt(speed * speed + rate * rate)


@dataclass(frozen=True)
class JointPosition(InnerControl):
    """Actions are positions of the joints, in units of ``spans`` from ``middle``.

    A joint approaches its position p with the rate ``stiffness`` (p - position), bent to less than its speed;
    its damping is the ``gain`` of the rates, and a gain of four times the stiffness makes the approach
    critically damped. A joint angle counts its turns: it is not taken around the other way.

    Parameters
    ----------
    middle : float or sequence of one for each joint
        Position that an action of 0 commands, rad (revolute) or m (prismatic).
    spans : float or sequence of one for each joint
        Distance from there that an action of 1 commands, rad (revolute) or m (prismatic), positive.
    stiffness : float
        Rate of the approach per distance from the wanted position, 1/s, positive.
    speeds : float or sequence of one for each joint
        Most rates that it wants, rad/s (revolute) or m/s (prismatic), positive.
    """

    middle: float | Numbers = field(metadata=each_joint(strengths, "rad", "m"))
    spans: float | Numbers = field(metadata=each_joint(positive, "rad", "m"))
    stiffness: float = field(metadata=one(positive, "1/s"))
    speeds: float | Numbers = field(metadata=each_joint(positive, "rad/s", "m/s"))

    example = Example(
        {
            "gain": 25.0, "limits": (20.0, 12.0, 8.0, 4.0), "middle": 0.0, "spans": 3.0, "stiffness": 6.0,
            "speeds": 3.0,
        }, curve=Curve("position", "time", 1.5))  # fmt: skip

    @classmethod
    def defaults(cls, scene: Any) -> dict[str, Any]:
        values, count = scene.parameters(), len(scene.robot.joints)
        middle, spans = [0.0] * count, [math.pi] * count
        for k, (low, high) in scene.travel().items():
            ends = values[low], values[high]
            if all(map(math.isfinite, ends)):
                middle[k], spans[k] = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
        speeds = usual_speeds(scene.robot)
        return {"middle": tuple(middle), "spans": tuple(spans), "stiffness": GAIN / 4.0, "speeds": speeds}

    def wanted(self, arm: Arm) -> Wanted:
        n = len(arm.joints)
        numbers = (*of_joints("middle", n), *of_joints("speeds", n))
        motion = (*numbered("command{}", n), *numbered("phi{}", n))
        return Wanted(approach(n), ("stiffness", *motion, *(name for name, _ in numbers)), numbers)

    def takes(self, arm: Arm, joint: int) -> str:
        return "m" if arm.prismatic[joint] else "rad"

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return self.links(arm)

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return tuple(f"spans[{k}]" for k in range(len(arm.joints)))
