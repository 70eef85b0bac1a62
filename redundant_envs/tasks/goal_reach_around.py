"""Reach a goal among obstacles as a goal environment."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.goal_reach import GoalReachTask
from redundant_envs.tasks.reach import GOAL
from redundant_envs.tasks.reach_around import ReachAroundTask


@dataclass(frozen=True)
class GoalReachAroundTask(ReachAroundTask):
    """The task among obstacles with its goal beside the observation, and the reward of the two goals alone.

    Such a reward cannot tell a touch, so a touch ends the episode, and with it what could be earned.
    """

    terminate_on_touch: bool = True

    unused = (*ReachAroundTask.unused, "clear_margin")
    name = "GoalReachAround"
    steps = 150
    goal_conditioned = True
    speed_bound_ends = False

    def reward_note(self) -> str:
        return GoalReachTask.reward_note(self)  # type: ignore[arg-type]

    def reward_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return GoalReachTask.reward_functions(self, scene)  # type: ignore[arg-type]

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, with what they mean: none depends on the goal."""
        return {name: text for name, text in super().observation(scene).items() if name not in GOAL}
