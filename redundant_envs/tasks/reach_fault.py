"""Reach a goal and hold it although a motor fails."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.language.algebra import maximum, numbered, physics, where
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.reach import ReachTask


def failures(scene: Scene) -> list[tuple[str, str]]:
    """For each fault of the scene the fields of its joint and of whether it has happened."""
    keys = [effect.key for effect in scene.effects if isinstance(effect, MotorFault)]
    return [(f"{key}.joint", f"{key}.active") for key in keys]


def failed_joints(scene: Scene) -> Callable[..., Any]:
    """It gives ``failed<k>_obs``, whether motor k has failed, and ``failed``, whether one has."""
    joints, faults = len(scene.robot.joints), failures(scene)

    @physics(
        gives=(*numbered("failed{}_obs", joints), "failed"),
        takes=[name for fault in faults for name in fault],
    )
    def failed_joints(*values: Any) -> Any:
        pairs = [*zip(values[::2], values[1::2], strict=True)]
        each = [
            functools.reduce(maximum, [where(joint == float(k), active, 0.0) for joint, active in pairs])
            for k in range(joints)
        ]
        return (*each, functools.reduce(maximum, values[1::2]))

    return failed_joints


@dataclass(frozen=True)
class ReachFaultTask(ReachTask):
    """Bring the tip to a goal and hold it there, although a motor, drawn in every episode, fails.

    Parameters
    ----------
    outer : float
        Outer radius of the annulus in which goals are drawn.
    hold_steps : int
        Control steps in a row, at the goal and slow, for hold success.
    """

    outer: float = 0.7
    hold_steps: int = 25

    name = "ReachFault"
    summary = "brings its tip to a goal and holds it there although a motor fails"
    expert = "redundant_envs.control.experts.reach_fault:ReachFault"
    steps = 200
    metrics: ClassVar[tuple[str, ...]] = (*ReachTask.metrics, "failed")
    flags: ClassVar[tuple[str, ...]] = (*ReachTask.flags, "failed")

    def functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        if not failures(scene):
            raise ValueError(
                f"the task {self.name} needs a fault; add MotorBrake(joint, at) or MotorLoss to the scene's "
                "effects"
            )
        return (*super().functions(scene), failed_joints(scene))

    def observation(self, scene: Scene) -> dict[str, str]:
        joints = enumerate(scene.robot.joints, start=1)
        failed = {f"failed{k}_obs": f"1 once the motor of {joint} has failed, else 0" for k, joint in joints}
        return {**super().observation(scene), **failed}
