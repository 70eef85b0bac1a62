"""Model-based controllers, the baseline of every table, and the poses that motors can hold."""

from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.holding import holding_load, holding_poses, motor_efforts, static_efforts
from redundant_envs.control.ilqr import ilqr_plan
from redundant_envs.control.lqr import HoldingLQR
from redundant_envs.control.null_space import kinematic_mobility, null_basis, null_projector, posture_row
from redundant_envs.control.operational_space import OperationalSpace
from redundant_envs.control.poses import lightest_pose, pose_at
from redundant_envs.control.reach_cost import ReachCost
from redundant_envs.control.resolved_motion import (
    ResolvedMotion,
    centring_gradient,
    load_gradient,
    manipulability_gradient,
)

__all__ = [
    "ComputedTorque", "HoldingLQR", "OperationalSpace", "ReachCost", "ResolvedMotion", "centring_gradient",
    "holding_load", "holding_poses", "ilqr_plan", "kinematic_mobility", "lightest_pose", "load_gradient",
    "manipulability_gradient", "motor_efforts", "null_basis", "null_projector", "pose_at", "posture_row",
    "static_efforts",
]  # fmt: skip
