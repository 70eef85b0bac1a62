"""Checks of arguments that users pass to environments: seeds, actions, limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.language.algebra import arguments_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown
from redundant_envs.tasks.base import Task, full_reach, hard_stops

LARGEST_WHOLE = 2**53  # largest number of control steps: floats count exactly up to it


def reach_of(scene: Scene, values: Mapping[str, Any]) -> Any:
    """Reach of the stretched arm, m, from all parameters of the scene."""
    reach = full_reach(scene.robot)
    ends = {f"high{joint + 1}": high for joint, (_, high) in scene.travel().items()}
    return reach(*(values[ends.get(name, name)] for name in arguments_of(reach)))


def numbers_of_reward(task: Task) -> list[str]:
    """Numbers of a task on which the reward of goals depends: no reset of a goal environment changes them."""
    if not task.goal_conditioned:
        return []
    taken = {name for f in task.goal_functions for name in arguments_of(f)}
    return [name for name in task.parameters() if name in taken]


def check_of_reward(scene: Scene, task: Task, given: Iterable[Any]) -> None:
    """Refuse parameters of a goal environment on which its reward depends."""
    fixed = {n for ends in (*scene.travel().values(), *(x[1:] for x in hard_stops(scene))) for n in ends}
    of_reward = numbers_of_reward(task)
    for name in (n for n in given if isinstance(n, str)):
        entries = {p for p in scene.parameters() if p == name or p.startswith(f"{name}[")}
        if name in ("lengths", *of_reward) or fixed & entries:
            kept, fix = "lengths and travel", ""
            if name in of_reward:
                kept, fix = name, f": make one with task={{{name!r}: ...}}"
            raise ValueError(
                f"parameter is {name!r}; goal environments keep {kept}, because compute_reward is a "
                f"function of the two goals alone{fix}"
            )


def checked_seed(name: str, seed: Any) -> int | None:
    """A seed as Gymnasium takes it; a ValueError if it is neither a whole number from 0 on nor None."""
    if seed is None:
        return None
    if isinstance(seed, bool | np.bool_) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"{name} is {shown(seed)}; give a whole number of at least 0, or None")
    return int(seed)


def check_action(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Actions as float32, or a ValueError about their shape or dtype."""
    of_floats = type(actions) is np.ndarray and actions.dtype == np.float32
    if of_floats and actions.shape == shape and actions.flags.carray:
        return actions  # type: ignore[no-any-return]
    array = np.asarray(actions)
    if array.dtype.kind == "f" and array.dtype.itemsize > 4:  # finite actions must stay finite as float32
        array = np.where(np.isfinite(array), np.clip(array, -1e30, 1e30), array)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"action has dtype {array.dtype}; give numbers")
    if array.shape != shape:
        raise ValueError(f"action has shape {array.shape}; give {shape}")
    return np.require(array, np.float32, ["C", "A", "W"])


def refuse_bad_action(actions: NDArray[np.float32]) -> None:
    """Raise for actions that are not finite."""
    if not np.isfinite(actions).all():
        raise ValueError(
            f"action has non-finite entries: {actions.tolist()}; give finite numbers, or make the "
            "environment with on_bad_action='terminate'"
        )


def episode_limit(max_episode_steps: Any) -> float:
    """Control steps until truncation; None and -1 mean never."""
    given = max_episode_steps
    if given is None or (isinstance(given, int | np.integer) and given == -1):
        return float("inf")
    number = isinstance(given, int | float | np.integer | np.floating) and not isinstance(given, bool)
    if not number or not 1 <= given <= LARGEST_WHOLE or given != int(given):
        raise ValueError(
            f"max_episode_steps is {shown(given)}; give a whole number of at least 1, or -1 for no limit"
        )
    return float(given)
