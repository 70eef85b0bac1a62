"""Common parts of the learners: inputs of the networks, averages, and their state in a checkpoint."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from redundant_envs.extras import needs

from .networks import Adam, Networks

with needs("train"):
    import torch
    from gymnasium import spaces
    from torch import Tensor

ERROR_SCALE = 0.05  # distance from the goal that is the input 1 of the networks, in reaches


def goal_mixing(space: spaces.Space[Any], error_scale: float = ERROR_SCALE) -> Tensor | None:
    """The matrix that maps observations to inputs of the first layers of a goal environment's networks.

    The achieved goal becomes the error, desired minus achieved, in units of ``error_scale`` reaches; the
    desired goal is given in reaches. Without the matrix a network first has to learn the small difference of
    two large numbers. The matrix is multiplied into the first layers, so the saved policy has none.
    """
    if not isinstance(space, spaces.Dict):
        return None
    goal: Any = space["desired_goal"]
    width, reach = goal.shape[0], float(goal.high.max()) / 2.0
    # in the order of the space: achieved_goal, desired_goal, observation
    rest = spaces.flatdim(space) - 2 * width
    scaled = torch.eye(width) / (error_scale * reach)
    mixing = torch.block_diag(-scaled, torch.eye(width) / reach, torch.eye(rest))
    mixing[:width, width : 2 * width] = scaled
    return mixing


class Averaging:
    """Mixin for an algorithm of stable-baselines3, whose networks are trained as vectors.

    After an update the modules that act hold the present weights; inside :meth:`averaged` all modules are up
    to date, and those with averages hold them.
    """

    networks: dict[str, Networks]  # all trained vectors, and targets
    adams: dict[str, Adam]
    means: dict[str, Tensor]  # averages of the vectors of some networks

    def inputs(self, observations: Any) -> Tensor:
        """Inputs of the networks from observations, (rows, inputs)."""
        mixing = self.networks["actor"].mixing
        if mixing is None:
            return observations
        # In the order of stable-baselines3's CombinedExtractor; in double precision, because the tip and
        # its goal are close together.
        space: Any = self.observation_space  # type: ignore[attr-defined]
        parts = [observations[name] for name in space.spaces]
        return (torch.cat(parts, 1).double() @ mixing.T.double()).float()

    def keep_means(self, *names: str) -> None:
        """Begin averages of these networks at their present weights."""
        self.means = {name: self.networks[name].vector.clone() for name in names}

    def take_means(self, kept: float, weight: float) -> None:
        """Move the averages towards the present weights: by 1 - kept, or by ``weight`` while that is
        larger."""
        for name, mean in self.means.items():
            mean.lerp_(self.networks[name].vector, max(1.0 - kept, weight))

    def write_networks(self) -> None:
        """Copy the present weights into the modules."""
        for networks in self.networks.values():
            networks.write()

    def read_networks(self) -> None:
        """Continue from the modules' weights, those of a loaded policy; averages begin there."""
        for networks in self.networks.values():
            networks.read()
        for name, mean in self.means.items():
            mean.copy_(self.networks[name].vector)
        self.write_networks()

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """Within this context all modules hold the present weights, or their averages."""
        self.write_networks()
        for name, mean in self.means.items():
            self.networks[name].write(mean)
        try:
            yield
        finally:
            for name in self.means:
                self.networks[name].write()

    def learner_state(self) -> dict[str, Any]:
        """Everything beside the modules that an update changes; plain data and tensors."""
        return {
            "networks": {name: n.vector.clone() for name, n in self.networks.items()},
            "adams": {name: adam.state() for name, adam in self.adams.items()},
            "means": {name: mean.clone() for name, mean in self.means.items()},
        }

    def set_learner_state(self, state: dict[str, Any]) -> None:
        """Return to a state of :meth:`learner_state`."""
        for name, vector in state["networks"].items():
            self.networks[name].vector.copy_(vector)
        for name, adam in state["adams"].items():
            self.adams[name].set_state(adam)
        for name, mean in state["means"].items():
            self.means[name].copy_(mean)
        self.write_networks()

    def _excluded_save_params(self) -> list[str]:
        """Attributes excluded from policy.zip, which plain stable-baselines3 loads."""
        excluded: list[str] = super()._excluded_save_params()  # type: ignore[misc]
        return [*excluded, "networks", "adams", "means"]

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: Any = None) -> None:
        """Statistics of the finished episodes only; stable-baselines3 searches all environments."""
        over = np.flatnonzero(dones)
        super()._update_info_buffer([infos[i] for i in over], dones[over])  # type: ignore[misc]
