"""SAC whose policy is the average of its actor's weights, with leaner gradient steps.

Samples and, up to rounding, actions are those of stable-baselines3 in less time.
``train`` has its gradients written out (:mod:`.networks`), a term for smooth actions in the actor's loss
(Mysore et al. 2021, CAPS, its temporal part), and a delayed actor (Fujimoto et al. 2018, TD3); in goal
environments the networks receive the error of the tip at the scale of the task.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support.extras import needs

from .networks import ERROR_SCALE, Adam, Averaging, Layers, Networks, Tape, dtanh, goal_mixing, linear_layers
from .sampling import sample, sample_ahead, some_of

with needs("train"):
    import torch
    from stable_baselines3 import SAC, HerReplayBuffer
    from stable_baselines3.common.preprocessing import get_action_dim
    from stable_baselines3.common.type_aliases import DictReplayBufferSamples
    from torch import Tensor
    from torch.nn.functional import softplus

hardtanh_backward = torch.ops.aten.hardtanh_backward
LOG_STD = (-20.0, 2.0)  # bounds of the logarithm of the standard deviation, as in stable-baselines3
FIRST_UPDATES = 10
"""An average is at first the mean of about the last nine tenths of all weights: the first ones are poor."""


class SampledActions(NamedTuple):
    """Actions drawn at states, row by row, and the data that their derivatives need."""

    outputs: Tensor  # of the actor: means and logarithms of standard deviations, (rows, 2 A)
    tape: Tape
    actions: Tensor  # (rows, A), in -1 to 1
    log_prob: Tensor  # (rows, 1)
    noise: Tensor  # added before the tanh, (rows, A)


class AveragedSAC(Averaging, SAC):
    """SAC with an averaged, smoothed, delayed actor.

    ``policy_delay`` are the critic steps from one actor step to the next, ``average`` is the share of the
    average that an actor step keeps, and ``smoothness`` the weight of ``|a(s) - a(s')|^2`` in the actor's
    loss: mean actions at a state and at the next; ``smoothness_at_goal`` is that of steps whose reward is
    above the mean of the sample: those that reach their goal, if rewards have two values. Values are those
    of ``rewards_ahead`` rewards and the state after them; 1 with hindsight goals.
    """

    def __init__(
        self, *args: Any, activation: str = "silu", policy_delay: int = 2, smoothness: float = 0.1,
        smoothness_at_goal: float | None = None, average: float = 0.9995, error_scale: float = ERROR_SCALE,
        rewards_ahead: int = 1, **kwargs: Any,
    ) -> None:  # fmt: skip
        self.activation, self.error_scale = activation, error_scale
        self.policy_delay, self.average = policy_delay, average
        self.smoothness, self.smoothness_at_goal = smoothness, smoothness_at_goal
        self.rewards_ahead = rewards_ahead
        self.demonstrations: DictReplayBufferSamples | None = None
        self.demonstrated = 0
        super().__init__(*args, **kwargs)

    def learn_from(self, demonstrations: DictReplayBufferSamples, count: int) -> None:
        """Take so many samples of each gradient step from demonstrations, as in RLPD (Ball et al. 2023)."""
        self.demonstrations, self.demonstrated = demonstrations, count

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "demonstrations"]

    def _setup_model(self) -> None:
        super()._setup_model()
        width = get_action_dim(self.action_space)
        mixing = goal_mixing(self.observation_space, self.error_scale)
        with_actions = None if mixing is None else torch.block_diag(mixing, torch.eye(width))
        actor, critics, targets = self.actor, self.critic.q_networks, self.critic_target.q_networks
        layers: Layers = [*linear_layers(actor.latent_pi), (actor.mu, actor.log_std)]  # type: ignore[list-item]
        self.networks = {
            "actor": Networks([layers], self.activation, mixing),
            "critics": Networks([linear_layers(q) for q in critics], self.activation, with_actions),
            "targets": Networks([linear_layers(q) for q in targets], self.activation, with_actions),
        }
        self.adams = {name: Adam(self.networks[name]) for name in ("actor", "critics")}
        self.keep_means("actor")
        self.write_networks()

    def _sample_action(
        self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """As in stable-baselines3 up to rounding: random actions of all environments are one draw, and later
        ones come from the networks, without the modules."""
        space: Any = self.action_space
        if self.num_timesteps < learning_starts:
            drawn = space.np_random.uniform(space.low, space.high, (n_envs, *space.shape)).astype(space.dtype)
            scaled = self.policy.scale_action(drawn)
        elif isinstance(self._last_obs, dict):  # the modules have the error of the tip multiplied in
            return super()._sample_action(learning_starts, action_noise, n_envs)
        else:
            with torch.no_grad():
                outputs = self.networks["actor"].outputs(torch.from_numpy(self._last_obs))[0]
                scaled = torch.tanh(_noisy(outputs)[0]).numpy()
        return self.policy.unscale_action(scaled), scaled

    @torch.no_grad()
    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Gradient steps on one sample of the replay buffer."""
        rate = self.lr_schedule(self._current_progress_remaining)
        data = self._data(batch_size, gradient_steps)
        width = data[0].shape[1] - get_action_dim(self.action_space)
        batches = list(zip(*(part.split(batch_size) for part in data), strict=True))
        while batches:
            count = self.policy_delay - self._n_updates % self.policy_delay  # steps to the actor's next one
            group, batches = batches[:count], batches[count:]
            with_actor = len(group) == count
            pairs, _, _, _, smoothness, *soon = group[-1]
            chosen = torch.cat([*(nexts for _, nexts, *_ in group), *([*soon, pairs] if with_actor else [])])
            ahead = self._draw(chosen[:, :width])  # until its next step the actor stays as it is
            chosen[:, width:] = ahead.actions
            for k, (pairs, _, rewards, discounts, *_) in enumerate(group):
                rows = slice(k * batch_size, (k + 1) * batch_size)
                self._n_updates += 1
                self._update_critics(pairs, chosen[rows], rewards, discounts, ahead.log_prob[rows], rate)
                self.networks["targets"].vector.lerp_(self.networks["critics"].vector, self.tau)
            if with_actor:
                self._update_actor(chosen[-batch_size:], ahead, smoothness, rate)
        self.networks["actor"].write()  # the next actions are drawn by its modules
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/learning_rate", rate)
        self.logger.record("train/ent_coef", self._alpha())

    def _data(self, batch_size: int, gradient_steps: int) -> list[Tensor]:
        """Of the samples of all gradient steps, one after another: states with actions, next states with
        room for actions, rewards, discounts, and weights of the term for smooth actions. Where values are
        those after several steps, the states after one are added."""
        count = (batch_size - self.demonstrated) * gradient_steps
        if self.rewards_ahead == 1:
            data = self._columns(sample(self.replay_buffer, count))
        else:
            ahead = self.rewards_ahead
            data = self._columns(*sample_ahead(self.replay_buffer, count, ahead, self.gamma))
        if isinstance(self.replay_buffer, HerReplayBuffer):
            # A sample has all original goals first; every gradient step gets its share of them.
            order = torch.randperm(len(data[0]))
            data = [part.index_select(0, order) for part in data]
        if self.demonstrations is not None:
            given = some_of(self.demonstrations, self.demonstrated * gradient_steps)
            others = self._columns(given, None if self.rewards_ahead == 1 else given.next_observations)
            pairs = [
                [part.view(gradient_steps, -1, part.shape[1]) for part in pair]
                for pair in zip(data, others, strict=True)
            ]
            data = [torch.cat(pair, 1).flatten(0, 1) for pair in pairs]
        return [*data[:4], self._smoothness(data[2]), *data[4:]]

    def _columns(self, drawn: DictReplayBufferSamples, soon: Any = None) -> list[Tensor]:
        seen = [drawn.observations, drawn.next_observations, *([] if soon is None else [soon])]
        # next states have the same columns, where actions drawn there will be
        pairs, nexts, *others = (torch.cat([self.inputs(states), drawn.actions], 1) for states in seen)
        discounts = self.gamma if drawn.discounts is None else drawn.discounts
        return [pairs, nexts, drawn.rewards, discounts * (1.0 - drawn.dones), *others]

    def _alpha(self) -> float:
        log_alpha = self.log_ent_coef
        return float(self.ent_coef_tensor) if log_alpha is None else math.exp(float(log_alpha))

    def _smoothness(self, rewards: Tensor) -> Tensor:
        """Weight of the term for smooth actions at each step of a sample."""
        weights = torch.full_like(rewards, self.smoothness)
        if self.smoothness_at_goal is not None:
            weights[rewards > rewards.mean()] = self.smoothness_at_goal
        return weights

    def _draw(self, states: Tensor) -> SampledActions:
        outputs, tape = self.networks["actor"].forward(states)
        before, noise, log_std, normal = _noisy(outputs[0])
        # Half of the logarithm of the density, without its constant: that of the normal distribution minus
        # log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2 u)), which loses no digit.
        squash = torch.add(before, softplus(-before, beta=2.0), alpha=2.0)
        halves = squash.sub_(log_std.addcmul_(normal, normal, value=0.5), alpha=0.5)
        constant = before.shape[1] * (2.0 * math.log(2.0) + 0.5 * math.log(2.0 * math.pi))
        log_prob = halves.sum(1, keepdim=True).mul_(2.0).sub_(constant)
        return SampledActions(outputs[0], tape, torch.tanh(before), log_prob, noise)

    def _update_critics(
        self, pairs: Tensor, ahead: Tensor, rewards: Tensor, discounts: Tensor, log_prob: Tensor, rate: float
    ) -> None:
        """One step of both critics towards reward and discounted value of next states and drawn actions."""
        least = torch.minimum(*self.networks["targets"].outputs(ahead))
        goals = torch.addcmul(rewards, discounts, least.sub_(log_prob, alpha=self._alpha()))
        critics = self.networks["critics"]
        values, tape = critics.forward(pairs)
        critics.backward(tape, values.sub_(goals).mul_(1.0 / len(pairs)))
        self.adams["critics"].step(rate)

    def _update_actor(self, chosen: Tensor, drawn: SampledActions, smoothness: Tensor, rate: float) -> None:
        """One step of the actor at ``chosen`` states, with the last rows of ``drawn``, actions there."""
        count, width = len(chosen), drawn.actions.shape[1]
        action, noise, raw = drawn.actions[-count:], drawn.noise[-count:], drawn.outputs[-count:, width:]
        alpha = self._alpha() / count
        # the loss: mean of alpha log p - min Q + smoothness |tanh(mean(s)) - tanh(mean(s'))|^2
        critics = self.networks["critics"]
        values, tape = critics.forward(chosen)
        first = torch.le(*values)
        dvalues = torch.stack([first, ~first]) * (-1.0 / count)
        daction = critics.to_inputs(tape, dvalues, slice(-width, None))
        dbefore = dtanh(daction, action).add_(action, alpha=2.0 * alpha)
        after, here = torch.tanh(drawn.outputs[-2 * count :, :width]).split(count)
        apart = (here - after).mul_(smoothness)
        dmean = torch.add(dbefore, dtanh(apart, here), alpha=2.0 / count)
        dlog_std = hardtanh_backward((dbefore * noise).sub_(alpha), raw, *LOG_STD)  # 0 where it is clamped
        rows = [(x[:, -count:], saved[:, -count:]) for x, saved in drawn.tape]
        self.networks["actor"].backward(rows, torch.cat([dmean, dlog_std], 1)[None])
        self.adams["actor"].step(rate)
        self.take_means(self.average, FIRST_UPDATES / (FIRST_UPDATES + self._n_updates))
        if self.ent_coef_optimizer is not None and self.log_ent_coef is not None:
            self.log_ent_coef.grad = -(drawn.log_prob[-count:].mean() + float(self.target_entropy)).reshape(1)
            self.ent_coef_optimizer.step()


def _noisy(outputs: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """From outputs of the actor: actions before the tanh, their noise, the logarithms of its standard
    deviations, and the normal numbers from which it was made; each (rows, A)."""
    mean, log_std = outputs.chunk(2, 1)
    log_std = log_std.clamp(*LOG_STD)
    # in the order of stable-baselines3's draws, and then of the means in memory
    normal = torch.empty_like(mean).copy_(torch.randn(mean.shape))
    noise = log_std.exp().mul_(normal)
    return mean + noise, noise, log_std, normal
