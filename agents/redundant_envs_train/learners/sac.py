"""SAC whose policy is the average of its actor's weights, with leaner gradient steps.

Collection, replay buffers, networks, saving and loading are stable-baselines3's; ``train`` is replaced, and
samples and actions are the same in less time. Differences from it:

* the policy that is evaluated and saved is the running average of the actor's weights;
* the actor's loss has a term for smooth actions (Mysore et al. 2021, CAPS, its temporal part);
* the actor is updated at every second step of the critics (Fujimoto et al. 2018, TD3);
* the gradients are written out (:mod:`.networks`);
* in goal environments the networks receive the error of the tip at the scale of the task.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

from .networks import ERROR_SCALE, Adam, Averaging, Layers, Networks, Tape, goal_mixing, linear_layers
from .sampling import sample

with needs("train"):
    import torch
    from stable_baselines3 import SAC
    from stable_baselines3.common.preprocessing import get_action_dim
    from torch import Tensor
    from torch.nn.functional import softplus

LOG_STD = (-20.0, 2.0)  # bounds of the logarithm of the standard deviation, as in stable-baselines3
FIRST_UPDATES = 10
"""An average is at first the mean of about the last nine tenths of all weights: the first ones are poor."""


class Draw(NamedTuple):
    """Actions drawn at states, row by row, and the data that their derivatives need."""

    outputs: Tensor  # of the actor: means and logarithms of standard deviations, (rows, 2 A)
    tape: Tape
    actions: Tensor  # (rows, A), in -1 to 1
    log_prob: Tensor  # (rows, 1)
    noise: Tensor  # added before the tanh, (rows, A)


class AveragedSAC(Averaging, SAC):
    """SAC with an averaged, smoothed, delayed actor.

    ``activation`` is that of ``policy_kwargs["activation_fn"]``: silu, tanh or relu. ``policy_delay`` are the
    critic steps from one actor step to the next, and ``average`` is the share of the average that an actor
    step keeps. ``smoothness`` is the weight of ``|a(s) - a(s')|^2`` in the actor's loss: mean actions at a
    state and at the next; ``smoothness_at_goal`` the same for steps whose reward is above the mean of the
    sample: those that reach their goal, if rewards have two values.
    """

    def __init__(
        self, *args: Any, activation: str = "silu", policy_delay: int = 2, smoothness: float = 0.1,
        smoothness_at_goal: float | None = None, average: float = 0.9995, error_scale: float = ERROR_SCALE,
        **kwargs: Any,
    ) -> None:  # fmt: skip
        self.activation, self.error_scale = activation, error_scale
        self.policy_delay, self.average = policy_delay, average
        self.smoothness, self.smoothness_at_goal = smoothness, smoothness_at_goal
        super().__init__(*args, **kwargs)

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
        """As in stable-baselines3, the same numbers in less time: before learning starts, the actions of all
        environments are one draw, and later those of the networks, without the modules."""
        space: Any = self.action_space
        if self.num_timesteps < learning_starts:
            drawn = space.np_random.uniform(space.low, space.high, (n_envs, *space.shape)).astype(space.dtype)
        elif isinstance(self._last_obs, dict):  # the modules have the error of the tip multiplied in
            return super()._sample_action(learning_starts, action_noise, n_envs)
        else:
            with torch.no_grad():
                bounded = self._draw(torch.from_numpy(self._last_obs)).actions.numpy()
            drawn = self.policy.unscale_action(bounded)
        scaled = self.policy.scale_action(drawn)
        return self.policy.unscale_action(scaled), scaled

    @torch.no_grad()
    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Gradient steps on one sample of the replay buffer."""
        rate = self.lr_schedule(self._current_progress_remaining)
        drawn = sample(self.replay_buffer, batch_size * gradient_steps)
        now, after = self.inputs(drawn.observations), self.inputs(drawn.next_observations)
        discounts, smoothness = self.gamma * (1.0 - drawn.dones), self._smoothness(drawn.rewards)
        # A sample with hindsight goals has all original goals first; every gradient step gets its share of
        # them.
        order = torch.randperm(len(now))
        data = torch.cat([now, drawn.actions], 1), after, drawn.rewards, discounts, now, smoothness
        batches = list(zip(*(part.index_select(0, order).split(batch_size) for part in data), strict=True))
        while batches:
            count = self.policy_delay - self._n_updates % self.policy_delay  # steps to the actor's next one
            group, batches = batches[:count], batches[count:]
            states, (now, smoothness) = [after for _, after, *_ in group], group[-1][-2:]
            if len(group) == count:
                states.append(now)
            ahead = self._draw(torch.cat(states))  # until then the actor stays as it is
            for k, (pairs, after, rewards, discounts, *_) in enumerate(group):
                rows = slice(k * batch_size, (k + 1) * batch_size)
                self._n_updates += 1
                self._update_critics(
                    pairs, after, rewards, discounts, ahead.actions[rows], ahead.log_prob[rows], rate
                )
                self.networks["targets"].vector.lerp_(self.networks["critics"].vector, self.tau)
            if len(group) == count:
                self._update_actor(now, ahead, smoothness, rate)
        self.networks["actor"].write()  # the next actions are drawn by its modules
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/learning_rate", rate)
        self.logger.record("train/ent_coef", self._alpha())

    def _alpha(self) -> float:
        """Weight of the entropy."""
        if self.log_ent_coef is not None:
            return math.exp(float(self.log_ent_coef))
        return float(self.ent_coef_tensor)

    def _smoothness(self, rewards: Tensor) -> Tensor:
        """Weight of the term for smooth actions at each step of a sample."""
        weights = torch.full_like(rewards, self.smoothness)
        if self.smoothness_at_goal is not None:
            weights[rewards > rewards.mean()] = self.smoothness_at_goal
        return weights

    def _draw(self, states: Tensor) -> Draw:
        """Actions of the present actor."""
        outputs, tape = self.networks["actor"].forward(states)
        mean, log_std = outputs[0].chunk(2, 1)
        log_std = log_std.clamp(*LOG_STD)
        normal = torch.randn_like(mean)
        noise = log_std.exp().mul_(normal)
        before = mean + noise
        # log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2 u)), which loses no digit
        terms = (
            normal.square().mul_(-0.5) - log_std - 2.0 * (math.log(2.0) - before - softplus(-2.0 * before))
        )
        constant = 0.5 * mean.shape[1] * math.log(2.0 * math.pi)
        return Draw(outputs[0], tape, torch.tanh(before), terms.sum(1, keepdim=True) - constant, noise)

    def _update_critics(
        self, pairs: Tensor, after: Tensor, rewards: Tensor, discounts: Tensor, actions: Tensor,
        log_prob: Tensor, rate: float,
    ) -> None:  # fmt: skip
        """One step of both critics towards reward and discounted value of ``actions`` drawn at ``after``."""
        values = self.networks["targets"].outputs(torch.cat([after, actions], 1))
        least = torch.minimum(values[0], values[1])
        goals = torch.addcmul(rewards, discounts, least - self._alpha() * log_prob)
        critics = self.networks["critics"]
        found, tape = critics.forward(pairs)
        critics.backward(tape, (found - goals).div_(len(after)))
        self.adams["critics"].step(rate)

    def _update_actor(self, now: Tensor, drawn: Draw, smoothness: Tensor, rate: float) -> None:
        """One step of the actor; the last rows of ``drawn`` are those of the next states, then of ``now``."""
        count, width = len(now), drawn.actions.shape[1]
        action, noise, raw = drawn.actions[-count:], drawn.noise[-count:], drawn.outputs[-count:, width:]
        alpha = self._alpha() / count
        # the loss: mean of alpha log p - min Q + smoothness |tanh(mean(s)) - tanh(mean(s'))|^2
        critics = self.networks["critics"]
        values, tape = critics.forward(torch.cat([now, action], 1))
        first = values[0] <= values[1]
        dvalues = torch.stack([first, ~first]) * (-1.0 / count)
        daction = critics.to_inputs(tape, dvalues, slice(now.shape[1], None))
        dbefore = daction * (1.0 - action * action) + (2.0 * alpha) * action
        after, here = torch.tanh(drawn.outputs[-2 * count :, :width]).split(count)
        dmean = dbefore + (2.0 / count) * smoothness * (here - after) * (1.0 - here * here)
        inside = (raw > LOG_STD[0]) & (raw < LOG_STD[1])
        dlog_std = (dbefore * noise - alpha) * inside
        rows = [(x[:, -count:], z[:, -count:]) for x, z in drawn.tape]
        self.networks["actor"].backward(rows, torch.cat([dmean, dlog_std], 1)[None])
        self.adams["actor"].step(rate)
        self.take_means(self.average, FIRST_UPDATES / (FIRST_UPDATES + self._n_updates))
        if self.ent_coef_optimizer is not None and self.log_ent_coef is not None:
            target = float(self.target_entropy)
            self.log_ent_coef.grad = -(drawn.log_prob[-count:].mean() + target).reshape(1)
            self.ent_coef_optimizer.step()
