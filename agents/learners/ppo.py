"""PPO whose policy is the average of its weights, with an update of half the time.

Collection, advantages, networks, saving and loading are stable-baselines3's; ``train`` is replaced: the
same losses, with their gradients written out (:mod:`.networks`) and nothing logged per minibatch. The
average of the weights, policy and values, is what is evaluated and saved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

from .averaging import Averaging
from .goals import goal_mixing
from .networks import Adam, Networks, linear_layers

with needs("train"):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.buffers import RolloutBuffer
    from torch import Tensor


EPSILON = 1e-5
"""Adam's, as in stable-baselines3's PPO."""


class AveragedPPO(Averaging, PPO):
    """PPO with averaged weights.

    Parameters
    ----------
    activation : {"silu", "tanh", "relu"}
        That of ``policy_kwargs["activation_fn"]``.
    average : float
        Share of the average that an epoch keeps.
    """

    def __init__(self, *args: Any, activation: str = "silu", average: float = 0.9, **kwargs: Any) -> None:
        self.activation = activation
        self.average = average
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        policy, extractor = self.policy, self.policy.mlp_extractor
        actor = linear_layers(extractor.policy_net, policy.action_net)
        values = linear_layers(extractor.value_net, policy.value_net)
        mixing = goal_mixing(self.observation_space)
        self.networks = {
            "actor": Networks([actor], self.activation, mixing, policy.log_std),
            "values": Networks([values], self.activation, mixing),
        }
        self.adams = {name: Adam(networks, EPSILON) for name, networks in self.networks.items()}
        self.keep_means("actor", "values")
        self.write_networks()

    @torch.no_grad()
    def train(self) -> None:
        """Epochs of minibatches over the rollout."""
        rate = self.lr_schedule(self._current_progress_remaining)
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        buffer = self.rollout_buffer
        seen = buffer.observations
        observations = {k: _flat(v) for k, v in seen.items()} if isinstance(seen, dict) else _flat(seen)
        arrays = (buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns)
        data = [self.inputs(observations), *(_flat(array) for array in arrays)]
        rows = torch.cat(data, 1)
        widths = [part.shape[1] for part in data]
        for _ in range(self.n_epochs):
            mixed = rows.index_select(0, torch.randperm(len(rows)))
            for minibatch in mixed.split(self.batch_size):
                self._set_gradients(minibatch.split(widths, 1), clip)
                norms = [networks.gradient.norm() for networks in self.networks.values()]
                scale = (self.max_grad_norm / (torch.stack(norms).norm() + 1e-6)).clamp(max=1.0)
                for name, networks in self.networks.items():
                    networks.gradient.mul_(scale)
                    self.adams[name].step(rate)
            self._n_updates += 1
            self.take_means(self.average, 1.0 / (1.0 + self._n_updates))
        self.write_networks()
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/learning_rate", rate)
        self.logger.record("train/std", self.networks["actor"].extra.exp().mean().item())

    def _set_gradients(self, columns: Sequence[Tensor], clip: float) -> None:
        """Gradients of the clipped surrogate, the value and the entropy loss of one minibatch.

        ``columns``: what the networks are given, actions, log probabilities, advantages, returns.
        """
        observations, actions, log_prob, advantages, returns = columns
        count = len(observations)
        actor, critic = self.networks["actor"], self.networks["values"]
        means, tape = actor.forward(observations)
        log_std = actor.extra
        inverse = (-log_std).exp()
        deviation = (actions - means[0]) * inverse
        constant = log_std.sum() + 0.5 * len(log_std) * math.log(2.0 * math.pi)
        present = -0.5 * deviation.square().sum(1, keepdim=True) - constant
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        ratio = (present - log_prob).exp_()
        # where the smaller of the two surrogates is the clipped one, its derivative is 0
        inside = torch.where(advantages > 0.0, ratio <= 1.0 + clip, ratio >= 1.0 - clip)
        dlog_prob = advantages * ratio * inside * (-1.0 / count)
        torch.sum(dlog_prob * (deviation.square() - 1.0), 0, out=actor.dextra)
        actor.dextra.sub_(self.ent_coef)
        actor.backward(tape, (dlog_prob * deviation * inverse)[None])
        values, tape = critic.forward(observations)
        critic.backward(tape, (values - returns) * (2.0 * self.vf_coef / count))


def _flat(array: NDArray[np.floating]) -> Tensor:
    """Samples of a rollout, (samples, columns)."""
    return torch.from_numpy(RolloutBuffer.swap_and_flatten(array))
