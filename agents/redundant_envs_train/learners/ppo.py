"""PPO whose policy is the average of its weights, with leaner loops.

The loops of stable-baselines3 are replaced: they collect without its modules, compute values once for a
rollout, have the gradients written out (:mod:`.networks`), and log nothing per minibatch. The loss may have a
term for smooth actions (Mysore et al. 2021, CAPS, its temporal part).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support.extras import needs

from ..rollout import each, stacked
from .networks import Adam, Averaging, Networks, goal_mixing, linear_layers

with needs("train"):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv
    from torch import Tensor

EPSILON = 1e-5  # Adam's, as in stable-baselines3's PPO
ROWS = 1024  # observations whose values are computed together


class AveragedPPO(Averaging, PPO):
    """PPO with averaged weights.

    ``average`` is the share of the average that an epoch keeps. ``smoothness`` is the weight of ``|a(s) -
    a(s')|^2`` in the actor's loss: mean actions at a state, and at the states before and after it in its
    episode, the latter from the policy of the rollout.
    """

    def __init__(
        self, *args: Any, activation: str = "silu", average: float = 0.9, smoothness: float = 0.0,
        **kwargs: Any,
    ) -> None:  # fmt: skip
        self.activation, self.average, self.smoothness = activation, average, smoothness
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
        self.mean_actions = np.zeros_like(self.rollout_buffer.actions)
        """Mean actions of the policy of the rollout, in -1 to 1, (n_steps, num_envs, A)."""

    @torch.no_grad()
    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer; values are computed once, for all steps together."""
        rollout_buffer.reset()
        callback.on_rollout_start()
        actor = self.networks["actor"]
        std = actor.extra.exp()
        noises = torch.empty(self.mean_actions.shape)
        ends: list[tuple[int, int, Any]] = []
        for step in range(n_rollout_steps):
            means = actor.outputs(self.inputs(each(torch.from_numpy, self._last_obs)))[0]
            actions = torch.addcmul(means, std, noises[step].normal_())
            seen: Any = self._last_obs
            for name in seen if isinstance(seen, dict) else (...,):
                rollout_buffer.observations[name][step] = seen[name]
            rollout_buffer.actions[step] = actions.numpy()
            self.mean_actions[step] = means.numpy()
            rollout_buffer.episode_starts[step] = self._last_episode_starts
            new_obs, rewards, dones, infos = env.step(actions.clamp(-1.0, 1.0).numpy())
            self._last_obs, self._last_episode_starts = new_obs, dones  # type: ignore[assignment]
            self.num_timesteps += env.num_envs
            rollout_buffer.rewards[step] = rewards
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, dones)
            for lane in np.flatnonzero(dones).tolist():
                if infos[lane]["TimeLimit.truncated"]:
                    ends.append((step, lane, infos[lane]["terminal_observation"]))
        np.clip(self.mean_actions, -1.0, 1.0, out=self.mean_actions)
        rollout_buffer.log_probs[:] = (-0.5 * noises.square().sum(2) - self._log_prob_offset()).numpy()
        self._add_values(rollout_buffer, ends)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _add_values(self, buffer: RolloutBuffer, ends: Sequence[tuple[int, int, Any]]) -> None:
        """Values of all observations; those after a time limit are added to the last rewards."""
        flat = each(lambda part: part.reshape(-1, part.shape[-1]), buffer.observations)
        buffer.values[:] = self._values(flat).view(buffer.values.shape).numpy()
        if ends:
            steps, lanes, last = zip(*ends, strict=True)
            buffer.rewards[list(steps), list(lanes)] += self.gamma * self._values(stacked(last)).numpy()
        buffer.pos, buffer.full = len(buffer.values), True
        starts = np.asarray(self._last_episode_starts)
        buffer.compute_returns_and_advantage(self._values(self._last_obs), starts)

    def _values(self, observations: Any) -> Tensor:
        """Values of observations of stable-baselines3, (n,)."""
        inputs = self.inputs(each(torch.from_numpy, observations))
        # in parts, whose layers stay in the cache
        values = [self.networks["values"].outputs(part)[0] for part in inputs.split(ROWS)]
        return torch.cat(values)[:, 0]

    def _log_prob_offset(self) -> Tensor:
        """Term of the log probability of a normal distribution beside the squares of deviations."""
        log_std = self.networks["actor"].extra
        return log_std.sum() + 0.5 * len(log_std) * math.log(2.0 * math.pi)

    @torch.no_grad()
    def train(self) -> None:
        rate = self.lr_schedule(self._current_progress_remaining)
        entropy = self.ent_coef * rate / self.lr_schedule(1.0)
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        buffer = self.rollout_buffer
        arrays = (
            buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns,
            *neighbouring_actions(self.mean_actions, buffer.episode_starts),
        )  # fmt: skip
        data = [self.inputs(each(_flat, buffer.observations)), *map(_flat, arrays)]
        rows = torch.cat(data, 1)
        widths = [part.shape[1] for part in data]
        for _ in range(self.n_epochs):
            order = torch.randperm(len(rows))  # of stable-baselines3's samples, environment by environment
            mixed = rows.index_select(0, order % self.n_steps * self.n_envs + order // self.n_steps)
            for minibatch in mixed.split(self.batch_size):
                self._set_gradients(minibatch.split(widths, 1), clip, entropy)
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

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "mean_actions"]

    def _set_gradients(self, columns: Sequence[Tensor], clip: float, entropy: float) -> None:
        """Gradients of the clipped surrogate, the value, entropy and smoothness losses of one minibatch,
        whose columns are those of :meth:`train`; ``entropy`` is the weight of the entropy."""
        observations, actions, log_prob, advantages, returns, sums, numbers = columns
        count = len(observations)
        actor, critic = self.networks["actor"], self.networks["values"]
        means, tape = actor.forward(observations)
        inverse = (-actor.extra).exp()
        deviation = (actions - means[0]) * inverse
        present = -0.5 * deviation.square().sum(1, keepdim=True) - self._log_prob_offset()
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        ratio = (present - log_prob).exp_()
        # where the smaller of the two surrogates is the clipped one, its derivative is 0
        inside = torch.where(advantages > 0.0, ratio <= 1.0 + clip, ratio >= 1.0 - clip)
        dlog_prob = advantages * ratio * inside * (-1.0 / count)
        torch.sum(dlog_prob * (deviation.square() - 1.0), 0, out=actor.dextra)
        actor.dextra.sub_(entropy)
        # beyond the bounds of actions, where |a - a'|^2 would have no slope, it continues as a straight line
        apart = numbers * means[0].clamp(-1.0, 1.0) - sums
        dmeans = torch.addcmul(apart * (2.0 * self.smoothness / count), dlog_prob * deviation, inverse)
        actor.backward(tape, dmeans[None])
        values, tape = critic.forward(observations)
        critic.backward(tape, (values - returns) * (2.0 * self.vf_coef / count))


def neighbouring_actions(
    mean_actions: NDArray[np.floating], episode_starts: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Sums, (steps, environments, A), of the mean actions at the steps before and after each one of a rollout
    that belong to its episode, and their numbers, 0 to 2, (steps, environments)."""
    joined = 1.0 - episode_starts[1:]  # a step and the next one
    sums, numbers = np.zeros_like(mean_actions), np.zeros_like(episode_starts)
    sums[:-1] += joined[..., None] * mean_actions[1:]
    sums[1:] += joined[..., None] * mean_actions[:-1]
    numbers[:-1] += joined
    numbers[1:] += joined
    return sums, numbers


def _flat(array: NDArray[np.floating]) -> Tensor:
    """Samples of a rollout, (samples, columns), step by step."""
    return torch.from_numpy(array).reshape(array.shape[0] * array.shape[1], -1)
