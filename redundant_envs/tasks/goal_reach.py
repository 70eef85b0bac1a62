"""Reach a goal as a goal environment: what was achieved, what is desired, and a reward of the two alone."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.language.algebra import physics
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.reach import ReachTask, posture_and_tip


@physics(gives="reached_term")
def reached_term(goal_reward):
    """1 if distance <= goal_tolerance reach, else 0"""
    return goal_reward


@dataclass(frozen=True)
class GoalReachTask(ReachTask):
    """The task with its goal beside the observation, and the reward of the two goals alone.

    A reward of 1 or 0 cannot cancel the earlier rewards of an episode, and an arm that whirls may touch its
    goal by luck. So beyond the speed bound the episode is flagged and goes on, and efforts cannot end
    an episode early.
    """

    name = "GoalReach"
    goal_conditioned = True
    speed_bound_ends = False

    def reward_note(self) -> str:
        return (
            "1 when the tip is within the goal tolerance, 0 otherwise: a function of the two goals "
            "alone, `compute_reward(achieved_goal, desired_goal, info)`, for hindsight replay."
        )

    def reward_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return (reached_term,)

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, with what they mean: none depends on the goal."""
        return posture_and_tip(scene.robot)
