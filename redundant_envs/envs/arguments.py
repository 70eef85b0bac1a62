"""Checks of arguments that users pass to environments: seeds, actions, limits, numbers that are drawn."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import REGISTRY as EFFECTS
from redundant_envs.effects.hooks import snake_case
from redundant_envs.effects.inner_control import InnerControl
from redundant_envs.envs.registration import check_motors
from redundant_envs.language.algebra import arguments_of
from redundant_envs.scenes.numbers import check_ranges, ends_of, entries_of, names_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import check_between, shown, whole_number
from redundant_envs.tasks.base import Task, full_reach, hard_stops

MOST_STEPS = 1000
"""Most control steps of a decision: a call of all of them takes as long as so many steps, and cannot be
shorter."""
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


def check_of_reward(scene: Scene, task: Task, names: Iterable[Any]) -> None:
    """Refuse parameters of a goal environment on which its reward depends."""
    fixed = {n for ends in (*scene.travel().values(), *(x[1:] for x in hard_stops(scene))) for n in ends}
    frozen = ("lengths", *numbers_of_reward(task))
    for name in (n for n in names if isinstance(n, str)):
        if name in frozen or fixed & {p for p in scene.parameters() if p == name or p.startswith(f"{name}[")}:
            raise ValueError(
                f"parameter is {name!r}; goal environments keep travel, {', '.join(frozen)}: their reward "
                "is a function of the two goals alone; make one with another scene= or task="
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
    if not np.isfinite(actions).all():
        raise ValueError(
            f"action has non-finite entries: {actions.tolist()}; give finite numbers, or make the "
            "environment with on_bad_action='terminate'"
        )


def episode_limit(max_steps: Any) -> float:
    """Control steps until truncation, from ``max_episode_steps``; None and -1 mean never."""
    if max_steps is None or (isinstance(max_steps, Integral) and max_steps == -1):
        return math.inf
    number = isinstance(max_steps, Real) and not isinstance(max_steps, bool)
    if not number or not 1 <= max_steps <= LARGEST_WHOLE or max_steps != int(max_steps):
        raise ValueError(
            f"max_episode_steps is {shown(max_steps)}; give a whole number of at least 1, or -1 for no limit"
        )
    return float(max_steps)


def decision(decide_every: Any) -> int:
    """Control steps of a decision, from ``decide_every``."""
    steps = whole_number("decide_every", decide_every)
    check_between("decide_every", steps, 1, MOST_STEPS)
    return steps


def modes() -> dict[str, type[InnerControl]]:
    """Modes of actions by their names, of effects that are registered."""
    found = {snake_case(n): kind for n, kind in EFFECTS.items() if issubclass(kind, InnerControl)}
    return dict(sorted(found.items()))


def with_mode(scene: Scene, action: Any) -> Scene:
    """The scene with the mode of actions that ``action`` names, unless it has this one; None is its own.
    ValueError if it has another one, or the mode does not fit it."""
    if action is not None and (not isinstance(action, str) or action not in ("effort", *modes())):
        valid = ", ".join(("effort", *modes()))
        raise ValueError(f"action is {shown(action)}; choose {valid}, or None for that of the scene")
    there = next(
        (snake_case(type(e).__name__) for e in scene.effects if e.effort_units(scene.robot)), "effort"
    )
    if action is None or action == there:
        return scene
    if there != "effort":
        raise ValueError(
            f"action is {action!r}, and the scene has an effect whose actions are {there!r}; leave action "
            "out, or the effect"
        )
    check_motors(scene)
    return dataclasses.replace(scene, effects=(*scene.effects, modes()[action].for_scene(scene)))


def without_mode(scene: Scene) -> Scene:
    """The scene whose actions are efforts: without the effect of its mode of actions, if it has one."""
    others = tuple(effect for effect in scene.effects if not effect.effort_units(scene.robot))
    return scene if len(others) == len(scene.effects) else dataclasses.replace(scene, effects=others)


def simulated(scene: Scene, task: Task, randomize: Any) -> Scene:
    """The scene as it is simulated: every episode draws the numbers for which it has ranges if ``randomize``;
    ValueError unless the task allows what they draw."""
    if not isinstance(randomize, bool):
        raise ValueError(
            f"randomize is {shown(randomize)}; True draws the ranges of the scene, False keeps its numbers; "
            "the scene itself has the ranges"
        )
    drawn = entries_of(scene, scene.randomize, task.parameters())
    if task.goal_conditioned:
        check_of_reward(scene, task, [one.name for one in drawn])
    check_ranges(scene, drawn, task)
    return scene if randomize else dataclasses.replace(scene, randomize=None)


def observed(scene: Scene, task: Task, names: Any) -> list[str]:
    """The scalar parameters that observations show after all else, from ``observe_parameters``."""
    if isinstance(names, str | bytes | Iterator | set | frozenset) or not isinstance(names, Iterable):
        raise ValueError(
            f"observe_parameters is {shown(names)}; give names of numbers, such as ('gravity.g',)"
        )
    numbers: dict[str, float] = {**scene.parameters(), **task.parameters()}
    scalars: list[str] = []
    for name in names:
        try:
            entries = names_of(scene, name, task.parameters())
        except ValueError as error:
            raise ValueError(f"observe_parameters has an unknown name: {error}") from None
        for entry in entries:
            if entry in scalars:
                raise ValueError(f"observe_parameters has {entry} twice; name it once")
            if not math.isfinite(numbers[entry]):
                raise ValueError(
                    f"observe_parameters has {name!r}, of which {entry} is {numbers[entry]}, as where "
                    "there is no stop; observe finite numbers"
                )
        scalars += entries
    return scalars


def bounds(scene: Scene, task: Task, entries: Sequence[str]) -> list[tuple[float, float]]:
    """The least and the largest value of each of these numbers: the ends of its range, also where ranges
    are not drawn. A number without a range has no bounds, because options of a reset may set it."""
    numbers = {**scene.parameters(), **task.parameters()}
    ends = ends_of(entries_of(scene, scene.randomize, task.parameters()), numbers)
    return [ends.get(name, (-math.inf, math.inf)) for name in entries]
