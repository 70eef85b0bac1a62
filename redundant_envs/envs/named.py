"""The classes behind the registered ids; their pages are written from the code."""

from __future__ import annotations

from typing import Any

from redundant_envs.envs.env import ReachEnv, ReachGoalEnv
from redundant_envs.envs.vector_env import ReachVectorEnv


class _Page:
    """A docstring written when it is read: building a page costs nothing at import."""

    def __init__(self, arm: str, scene: str) -> None:
        self.arm, self.scene = arm, scene

    def __get__(self, instance: Any, owner: type[Any]) -> str:
        from redundant_envs.envs.pages import page

        return page(owner, self.arm, self.scene)


class RPRPReachEnv(ReachEnv):
    __doc__ = _Page("RPRP", "rprp_reach")  # type: ignore[assignment]
    env_id = "redundant_envs/RPRPReach-v0"


class FourRReachEnv(ReachEnv):
    __doc__ = _Page("FourR", "four_r_reach")  # type: ignore[assignment]
    env_id = "redundant_envs/FourRReach-v0"


class RPRPGoalReachEnv(ReachGoalEnv):
    __doc__ = _Page("RPRP", "rprp_reach")  # type: ignore[assignment]
    env_id = "redundant_envs/RPRPGoalReach-v0"


class FourRGoalReachEnv(ReachGoalEnv):
    __doc__ = _Page("FourR", "four_r_reach")  # type: ignore[assignment]
    env_id = "redundant_envs/FourRGoalReach-v0"


class RPRPReachVectorEnv(ReachVectorEnv):
    """Native vector form of RPRPReach."""

    env_id = "redundant_envs/RPRPReach-v0"


class FourRReachVectorEnv(ReachVectorEnv):
    """Native vector form of FourRReach."""

    env_id = "redundant_envs/FourRReach-v0"


class GoalVectorEnv(ReachVectorEnv):
    """Native vector environment with Dict observations and the sparse goal reward."""

    goal_conditioned = True


class RPRPGoalReachVectorEnv(GoalVectorEnv):
    """Native vector form of RPRPGoalReach."""

    env_id = "redundant_envs/RPRPGoalReach-v0"


class FourRGoalReachVectorEnv(GoalVectorEnv):
    """Native vector form of FourRGoalReach."""

    env_id = "redundant_envs/FourRGoalReach-v0"
