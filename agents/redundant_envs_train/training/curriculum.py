"""Numbers of the environments that begin with other values, such as stronger motors, and then change."""

from typing import Any

import numpy as np

from redundant_envs.support.values import shown

from ..config import Config

CHANGES = 100
"""Changes over a whole training. An episode keeps the numbers with which it begins."""


class Course:
    """The way of a training's numbers; ValueError if its environments cannot have them."""

    def __init__(self, config: Config, env: Any) -> None:
        self._config, self._env, self._at = config, env, -1.0
        if (asked := config.curriculum) is None:
            return
        try:
            self._set(asked.parameters)  # the environments say what they cannot have
            self._ends = [self._of(name, first) for name, first in asked.parameters.items()]
            self._set(self._between(1.0 / 3.0))  # whole numbers cannot move
        except ValueError as error:
            raise ValueError(f"curriculum.parameters: {error}") from error

    def _of(self, name: str, first: Any) -> tuple[str, Any, Any]:
        """A name, and both ends of its way."""
        if name not in self._env.parameters:
            raise ValueError(f"{name} is a part; give {name.split('[')[0]} with all its entries")
        if name in {drawn.name.split("[")[0] for drawn in self._env.core.scene.randomize or ()}:
            raise ValueError(f"{name} is drawn for each episode; leave it out, or out of randomize")
        last = self._env.parameters[name].value[0]
        if np.ndim(first) > np.ndim(last):
            raise ValueError(f"{name} is {shown(first)}; give the same to all environments")
        return name, np.asarray(first, np.float64), last

    def move(self, steps: int) -> None:
        """Let the episodes that begin from now on, after so many environment steps, have their numbers."""
        if (asked := self._config.curriculum) is None:
            return
        share = CHANGES * steps // self._config.total_steps / CHANGES
        if (at := min(share / asked.until, 1.0)) != self._at:
            self._at = at
            self._set(self._between(at))

    def _between(self, at: float) -> dict[str, Any]:
        return {name: ((1.0 - at) * first + at * last).tolist() for name, first, last in self._ends}

    def _set(self, parameters: dict[str, Any]) -> None:
        self._env.set_options({"parameters": parameters})
