"""The classes behind the registered ids; their pages are written from the code."""

from __future__ import annotations

from typing import Any

from redundant_envs.envs.env import ReachEnv, ReachGoalEnv
from redundant_envs.envs.vector_env import ReachVectorEnv


class RPRPReachEnv(ReachEnv):
    pass


class FourRReachEnv(ReachEnv):
    pass


class RPRPGoalReachEnv(ReachGoalEnv):
    pass


class FourRGoalReachEnv(ReachGoalEnv):
    pass


class RPRPReachVectorEnv(ReachVectorEnv):
    pass


class FourRReachVectorEnv(ReachVectorEnv):
    pass


class GoalVectorEnv(ReachVectorEnv):
    """Native vector environment with Dict observations and the sparse goal reward."""

    def __init__(self, scene: Any, **kwargs: Any) -> None:
        super().__init__(scene, goal=True, **kwargs)


class RPRPGoalReachVectorEnv(GoalVectorEnv):
    pass


class FourRGoalReachVectorEnv(GoalVectorEnv):
    pass
