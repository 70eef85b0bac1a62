"""Tasks of the arms. A new task is one file here, with the name of the task."""

from collections.abc import Mapping
from typing import Any

from redundant_envs.support.modules import classes_in
from redundant_envs.support.values import check_keys, shown, truth
from redundant_envs.tasks.base import Task
from redundant_envs.tasks.goal_reach import GoalReachTask
from redundant_envs.tasks.reach import ReachTask

__all__ = ["GoalReachTask", "ReachTask", "Task"]

OWN: dict[str, type[Task]] = {task.name: task for task in classes_in(__name__, Task)}
"""The tasks of this package by their name in ids."""
REGISTRY = dict(OWN)
"""Tasks by their name in ids; users add theirs."""


TOUCH = "terminate_on_touch"


def make_task(task: Mapping[str, Any] | None, name: str, terminate_on_touch: bool | None = None) -> Task:
    """The task of a name, with the numbers of the keyword argument; a "type" in it must be the same name.
    ``terminate_on_touch`` sets the field of that name in a task that has it, unless it is None."""
    kind = REGISTRY[name]
    valid = kind.numbers()
    if terminate_on_touch is not None and truth(TOUCH, terminate_on_touch) and TOUCH not in valid:
        raise ValueError(f"{TOUCH} is True, and {name} has no obstacles that end it; leave it out")
    task = {} if task is None else task
    if not isinstance(task, Mapping):
        raise ValueError(f"task is {shown(task)}; give a mapping of {', '.join(valid)}")
    check_keys("task", task, ["type", *valid])
    if task.get("type", name) != name:
        raise ValueError(f"task.type is {shown(task['type'])} and this is {name}; make the id of that task")
    numbers = {key: value for key, value in task.items() if key != "type"}
    ends = {} if terminate_on_touch is None or TOUCH not in valid else {TOUCH: terminate_on_touch}
    if numbers.get(TOUCH, terminate_on_touch) != terminate_on_touch and ends:
        other = f"task[{TOUCH!r}] is {numbers[TOUCH]}"
        raise ValueError(f"{TOUCH} is {terminate_on_touch}, and {other}; give one of them")
    return kind(**{**numbers, **ends})
