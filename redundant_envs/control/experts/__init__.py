"""The expert of a task: the controller of this package that knows best how its episodes end well."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.base import Task

Array = NDArray[np.float64]


class Expert(Protocol):
    """What every expert has; it is made from a scene, ``Kind(scene)``, and serves a batch of episodes."""

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        """Plan new episodes.

        Parameters
        ----------
        q : (n, joints) Array
            The start, at rest.
        goal : (n, 2) Array
            m.
        index : (n,) Array or None
            The lanes whose episodes begin; None is all.
        numbers : mapping of str to Array
            Those in force, by their names, the task's memory, ``limit``, the control steps of an episode (inf
            without a limit), and ``decide_every``, those of an action; (n,) or (n, entries) each.
        """

    def action(self, t: Array, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (lanes, joints) in [-1, 1] at times ``t`` [s] since each episode began."""


def expert_of(task: Task, scene: Scene) -> Expert:
    """The expert that a task names, for its episodes in a scene."""
    return _made(task, "expert", scene)


def baseline_of(task: Task, scene: Scene) -> Expert:
    """The classical controller from the nearest pose that a task names."""
    return _made(task, "baseline", scene)


def _made(task: Task, field: str, scene: Scene) -> Expert:
    place = getattr(task, field)
    module, _, name = place.partition(":")
    try:
        kind: Any = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"{type(task).__name__}.{field} is {place!r}, which cannot be imported ({error}); give it as "
            "'package.module:Class'"
        ) from error
    made: Expert = kind(scene)
    return made
