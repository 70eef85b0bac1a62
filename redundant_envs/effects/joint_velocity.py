from dataclasses import dataclass, field
from typing import Any

from redundant_envs.effects.hooks import Arm, Hook
from redundant_envs.effects.inner_control import InnerControl, Wanted, usual_speeds
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, positive
from redundant_envs.language.algebra import numbered


def commanded(*commands):
    return commands


@dataclass(frozen=True)
class JointVelocity(InnerControl):
    """Actions are rates of the joints, in units of ``speeds``.

    Parameters
    ----------
    speeds : float or sequence of one for each joint
        Rates that an action of 1 commands, rad/s (revolute) or m/s (prismatic), positive.
    """

    speeds: float | Numbers = field(metadata=each_joint(positive, "rad/s", "m/s"))

    example = Example(
        {"gain": 25.0, "limits": (20.0, 12.0, 8.0, 4.0), "speeds": 3.0}, curve=Curve("rate", "time", 0.3)
    )

    @classmethod
    def defaults(cls, scene: Any) -> dict[str, Any]:
        return {"speeds": usual_speeds(scene.robot)}

    def wanted(self, arm: Arm) -> Wanted:
        return Wanted(commanded, tuple(numbered("command{}", len(arm.joints))))

    def takes(self, arm: Arm, joint: int) -> str:
        return "m/s" if arm.prismatic[joint] else "rad/s"

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return self.links(arm)

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return tuple(f"speeds[{k}]" for k in range(len(arm.joints)))
