"""Numbers that differ from episode to episode: those that are drawn, and those that observations show."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from redundant_envs.envs.arguments import check_of_reward
from redundant_envs.scenes.numbers import check_ranges, ends_of, entries_of, names_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown
from redundant_envs.tasks.base import Task


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


def observed(scene: Scene, task: Task, observe_parameters: Any) -> list[str]:
    """The scalar parameters that observations show after all else, from names of users."""
    given = observe_parameters
    if isinstance(given, str | bytes | Iterator | set | frozenset) or not isinstance(given, Iterable):
        raise ValueError(
            f"observe_parameters is {shown(given)}; give names of numbers, such as ('gravity.g',)"
        )
    numbers: dict[str, float] = {**scene.parameters(), **task.parameters()}
    found: list[str] = []
    for name in given:
        try:
            entries = names_of(scene, name, task.parameters())
        except ValueError as error:
            raise ValueError(f"observe_parameters has an unknown name: {error}") from None
        for entry in entries:
            if entry in found:
                raise ValueError(f"observe_parameters has {entry} twice; name it once")
            if not math.isfinite(numbers[entry]):
                raise ValueError(
                    f"observe_parameters has {name!r}, of which {entry} is {numbers[entry]}, as where "
                    "there is no stop; observe finite numbers"
                )
        found += entries
    return found


def bounds(scene: Scene, task: Task, entries: Sequence[str]) -> list[tuple[float, float]]:
    """The least and the largest value of each of these numbers: the ends of its range, also where ranges
    are not drawn. A number without a range has no bounds, because options of a reset may set it."""
    numbers = {**scene.parameters(), **task.parameters()}
    ends = ends_of(entries_of(scene, scene.randomize, task.parameters()), numbers)
    return [ends.get(name, (-math.inf, math.inf)) for name in entries]
