"""Tasks of the arms. A new task is one file here and one line below."""

from redundant_envs.tasks.base import Task
from redundant_envs.tasks.reach import GoalReachTask, ReachTask

__all__ = ["GoalReachTask", "ReachTask", "Task"]

REGISTRY: dict[str, type[Task]] = {task.name: task for task in (ReachTask, GoalReachTask)}
"""Tasks by their name in ids."""
