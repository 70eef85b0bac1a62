"""Algorithms of stable-baselines3 and sb3-contrib, for comparison with ours.

Only the methods that a training run needs of every learner are added; loops and losses are unchanged.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

with needs("train"):
    from sb3_contrib import TQC, CrossQ
    from stable_baselines3 import PPO, SAC, TD3
    from stable_baselines3.common.noise import VectorizedActionNoise


class Plain:
    """Mixin for an algorithm whose modules and optimisers hold everything that it learns."""

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """Leave the modules unchanged: these algorithms keep no average."""
        yield

    def read_networks(self) -> None:
        """Do nothing: only the modules learn."""

    def learner_state(self) -> dict[str, Any]:
        """Nothing beside the modules and optimisers."""
        return {}

    def set_learner_state(self, state: dict[str, Any]) -> None:
        """Do nothing: there is no further state."""


class PlainPPO(Plain, PPO):
    """PPO of stable-baselines3."""


class PlainSAC(Plain, SAC):
    """SAC of stable-baselines3."""


class PlainTD3(Plain, TD3):
    """TD3 of stable-baselines3."""


class PlainTQC(Plain, TQC):
    """TQC of sb3-contrib."""


class PlainCrossQ(Plain, CrossQ):
    """CrossQ of sb3-contrib."""


class NormalNoise(VectorizedActionNoise):
    """Independent normal noise on the actions of all environments, drawn at once.

    stable-baselines3 draws it environment by environment, which takes longer than stepping them.
    """

    def __init__(self, num_envs: int, num_actions: int, deviation: float) -> None:
        self.shape = (num_envs, num_actions)
        self.deviation = deviation

    def reset(self, indices: Iterable[int] | None = None) -> None:
        """Do nothing: no draw depends on another."""

    def __call__(self) -> NDArray[np.float64]:
        """Noise, (num_envs, num_actions), from NumPy's global generator as in stable-baselines3."""
        return np.random.normal(0.0, self.deviation, self.shape)
