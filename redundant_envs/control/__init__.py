"""Model-based controllers, the baseline of every table, and the poses that motors can hold."""

from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.holding import holding_load, holding_poses, motor_efforts, static_efforts
from redundant_envs.control.poses import lightest_pose, pose_at

__all__ = [
    "ComputedTorque", "holding_load", "holding_poses", "lightest_pose", "motor_efforts", "pose_at",
    "static_efforts",
]  # fmt: skip
