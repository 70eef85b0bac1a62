"""Numbers that differ from episode to episode: whether the ranges of a scene are drawn, and which numbers
observations show."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from redundant_envs.envs.arguments import check_of_reward
from redundant_envs.scenes.numbers import check_ranges, ends_of, entries_of, names_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown
from redundant_envs.tasks.base import Task


@dataclass(frozen=True)
class Variation:
    """Two arguments of all environments.

    Parameters
    ----------
    randomize : bool
        Whether every episode draws the numbers for which the scene has ranges, or has the scene's numbers.
    observed : tuple of str
        Names of numbers that observations show after all else.
    """

    randomize: bool = True
    observed: tuple[str, ...] = ()

    @classmethod
    def of(cls, randomize: Any, observe_parameters: Any) -> Variation:
        """From arguments of users, or a ValueError that says what to give."""
        if not isinstance(randomize, bool):
            fix = (
                "True draws the ranges of the scene, False keeps its numbers; the scene itself has the ranges"
            )
            raise ValueError(f"randomize is {shown(randomize)}; {fix}")
        names = observe_parameters
        if isinstance(names, str | bytes | Iterator | set | frozenset) or not isinstance(names, Iterable):
            raise ValueError(
                f"observe_parameters is {shown(names)}; give names of numbers, such as ('gravity.g',)"
            )
        return cls(randomize, tuple(names))

    def simulated(self, scene: Scene) -> Scene:
        """The scene as it is simulated: with its ranges if they are drawn."""
        return scene if self.randomize else dataclasses.replace(scene, randomize=None)

    def check(self, scene: Scene, task: Task) -> None:
        """ValueError unless a task allows what the ranges of a scene draw; the scene has checked its own."""
        drawn = entries_of(scene, scene.randomize, task.parameters())
        if task.goal_conditioned:
            check_of_reward(scene, task, [one.name for one in drawn])
        check_ranges(scene, drawn, task)

    def entries(self, scene: Scene, task: Task) -> list[str]:
        """The scalar parameters that observations show."""
        numbers, found = {**scene.parameters(), **task.parameters()}, []
        for name in self.observed:
            try:
                names = names_of(scene, name, task.parameters())
            except ValueError as error:
                raise ValueError(f"observe_parameters has an unknown name: {error}") from None
            for entry in names:
                if entry in found:
                    raise ValueError(f"observe_parameters has {entry} twice; name it once")
                if not math.isfinite(numbers[entry]):
                    raise ValueError(
                        f"observe_parameters has {name!r}, of which {entry} is {numbers[entry]}, as where "
                        "there is no stop; observe finite numbers"
                    )
            found += names
        return found

    def bounds(self, scene: Scene, task: Task) -> list[tuple[float, float]]:
        """The least and the largest value of each of these numbers: the ends of its range, also where ranges
        are not drawn. A number without a range has no bounds, because options of a reset may set it."""
        numbers = {**scene.parameters(), **task.parameters()}
        ends = ends_of(entries_of(scene, scene.randomize, task.parameters()), numbers)
        return [ends.get(name, (-math.inf, math.inf)) for name in self.entries(scene, task)]


AS_IN_THE_SCENE = Variation()
"""Without arguments of users."""
