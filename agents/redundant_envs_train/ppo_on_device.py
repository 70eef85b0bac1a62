"""PPO wholly on one device, in one file: environments, policy, advantages and updates never leave it.

    python -m redundant_envs_train.ppo_on_device
    python -m redundant_envs_train.ppo_on_device --device cuda --num-envs 65536 --batch-size 131072

It has not been run on a GPU yet. In the form of CleanRL (Huang et al. 2022, JMLR 23(274), docs.cleanrl.dev),
every detail is visible: generalised advantages (Schulman et al. 2016, 2017), orthogonal initial weights,
normalised advantages, a learning rate and an entropy weight that fall to 0, and clipped gradients. On a GPU a
rollout is one graph. With --replay a CPU does the actions of the first rollout again, and the numbers that
differ are counted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor, nn

import redundant_envs as rde
from redundant_envs.support.values import say

SEEDS_PER_RUN = 10_000_000
EVALUATION_SEED = 1_000_000_000
"""The frozen goals of the evaluation: seeds from here on."""


@dataclass
class Args:
    """Arguments of the command line."""

    env_id: str = "redundant_envs/FourRReach-v0"
    device: str = "cpu"
    seed: int = 0
    total_steps: int = 8_000_000
    num_envs: int = 512
    num_steps: int = 32
    epochs: int = 2
    batch_size: int = 1024
    learning_rate: float = 2e-3
    gamma: float = 0.95
    gae_lambda: float = 0.9
    clip: float = 0.2
    ent_coef: float = 0.01
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    evaluation_episodes: int = 1000
    replay: bool = False
    save: str = ""


HELP = {
    "seed": "0 to 99", "total_steps": "of all environments together",
    "num_steps": "of every environment between two updates", "learning_rate": "at the beginning; linear to 0",
    "ent_coef": "weight of the entropy at the beginning; linear to 0", "save": "file for the weights",
    "replay": "do the first rollout again on a CPU",
}  # fmt: skip


def parse(given: list[str] | None = None) -> Args:
    """The arguments, one option for each field."""
    parser = argparse.ArgumentParser(formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    for field in fields(Args):
        option, default = "--" + field.name.replace("_", "-"), field.default
        how: Any = (
            {"action": "store_true"} if default is False else {"type": type(default), "default": default}
        )
        parser.add_argument(option, help=HELP.get(field.name, " "), **how)  # a blank one shows the default
    args = Args(**vars(parser.parse_args(given)))
    if not 0 <= args.seed <= 99:
        parser.error(f"--seed is {args.seed}; give one from 0 to 99: others would meet the frozen goals")
    if (args.num_envs * args.num_steps) % args.batch_size:
        parser.error(f"--batch-size is {args.batch_size}; it must divide num_envs * num_steps")
    if args.num_steps % 2:
        parser.error(
            f"--num-steps is {args.num_steps}; give an even number: steps use two sets of tensors in turn"
        )
    return args


def network(inputs: int, outputs: int, gain: float, width: int = 64) -> nn.Sequential:
    """Two hidden layers; orthogonal weights, the last ones ``gain`` long, and no biases yet."""
    layers = [nn.Linear(inputs, width), nn.Linear(width, width), nn.Linear(width, outputs)]
    for layer, length in zip(layers, (2.0**0.5, 2.0**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, length)
        nn.init.zeros_(layer.bias)
    first, second, last = layers
    return nn.Sequential(first, nn.SiLU(), second, nn.SiLU(), last)


class Agent(nn.Module):
    """A normal distribution of actions with one standard deviation for all states, and a value."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.mean = network(observations, actions, gain=0.01)
        self.value = network(observations, 1, gain=1.0)
        self.log_std = nn.Parameter(torch.full((actions,), -0.5))

    def log_prob(self, mean: Tensor, action: Tensor) -> Tensor:
        """Logarithm of the probability of actions, without the constant that cancels in ratios."""
        return (-0.5 * ((action - mean) / self.log_std.exp()).square() - self.log_std).sum(-1)


class Rollout:
    """Steps of all environments under a policy, in tensors that every rollout fills anew."""

    def __init__(self, env: Any, agent: Agent, num_steps: int) -> None:
        self.env, self.agent = env, agent
        shape, device = (num_steps, env.num_envs), env.device
        self.obs = torch.zeros(
            num_steps + 1, env.num_envs, *env.single_observation_space.shape, device=device
        )
        self.final_obs = torch.zeros_like(self.obs[1:])
        self.actions = torch.zeros(*shape, *env.single_action_space.shape, device=device)
        self.log_probs, self.rewards = (torch.zeros(shape, device=device) for _ in range(2))
        flags = (torch.zeros(shape, dtype=torch.bool, device=device) for _ in range(3))
        self.terminated, self.ended, self.held = flags
        self.run: Callable[[], None] = self._steps

    def begin(self, seed: int) -> None:
        """First episodes; on a GPU the steps become one graph."""
        self.obs[0] = self.env.reset(seed=seed)[0]
        if self.env.device.type == "cuda":
            aside = torch.cuda.Stream()
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):  # libraries prepare themselves before a capture
                self._steps()
            torch.cuda.current_stream().wait_stream(aside)
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):
                self._steps()
            self.run = graph.replay
            self.obs[0] = self.env.reset(seed=seed)[0]

    @torch.no_grad()
    def _steps(self) -> None:
        for t in range(len(self.rewards)):
            mean = self.agent.mean(self.obs[t])
            self.actions[t] = mean + self.agent.log_std.exp() * torch.randn_like(mean)
            self.log_probs[t] = self.agent.log_prob(mean, self.actions[t])
            obs, reward, terminated, truncated, info = self.env.step(self.actions[t].clamp(-1.0, 1.0))
            self.obs[t + 1], self.rewards[t], self.terminated[t] = obs, reward, terminated
            self.ended[t] = terminated | truncated
            self.final_obs[t] = info.get("final_obs", obs)  # on a CPU only where an episode has ended
            self.held[t] = info.get("final_info", info)["is_success"]

    def next(self) -> None:
        """Go on where the rollout before has ended."""
        self.obs[0] = self.obs[-1]
        self.run()

    @torch.no_grad()
    def advantages(self, gamma: float, gae_lambda: float) -> tuple[Tensor, Tensor]:
        """Generalised advantages and returns, (steps, envs). Where a time limit ends an episode, the value of
        its last state counts."""
        values, final = (self.agent.value(x)[..., 0] for x in (self.obs, self.final_obs))
        following = torch.where(self.ended, final * ~self.terminated, values[1:])
        deltas, advantages = self.rewards + gamma * following - values[:-1], torch.zeros_like(self.rewards)
        later = torch.zeros_like(deltas[0])
        for t in reversed(range(len(deltas))):
            later = advantages[t] = deltas[t] + gamma * gae_lambda * ~self.ended[t] * later
        return advantages, advantages + values[:-1]


def update(
    agent: Agent, optimizer: torch.optim.Optimizer, data: list[Tensor], entropy: float, args: Args
) -> None:
    """Epochs of minibatches over observations, actions, their log probabilities, advantages and returns."""
    for _ in range(args.epochs):
        for rows in torch.randperm(len(data[0]), device=data[0].device).split(args.batch_size):
            obs, action, old_log_prob, advantage, returns = (column[rows] for column in data)
            ratio = (agent.log_prob(agent.mean(obs), action) - old_log_prob).exp()
            clipped = ratio.clamp(1.0 - args.clip, 1.0 + args.clip)
            policy_loss = -torch.min(ratio * advantage, clipped * advantage).mean()
            value_loss = (agent.value(obs)[:, 0] - returns).square().mean()
            # the entropy of a normal distribution is the sum of log_std and a constant
            loss = policy_loss + args.vf_coef * value_loss - entropy * agent.log_std.sum()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
            optimizer.step()


def differences(rollout: Rollout, state: dict[str, Any], env: Any) -> int:
    """Numbers of a rollout that differ when other environments do its actions again from its first state."""
    env.set_state(state)
    different = 0
    for t, actions in enumerate(rollout.actions):
        obs, reward, terminated, truncated, _ = env.step(actions.clamp(-1.0, 1.0).to(env.device))
        pairs = [(rollout.obs[t + 1], obs), (rollout.rewards[t], reward.to(torch.float32))]
        pairs += [(rollout.terminated[t], terminated), (rollout.ended[t], terminated | truncated)]
        different += sum(int((a.to(b.device) != b).sum()) for a, b in pairs)
    return different


def train(args: Args, env: Any) -> Agent:
    """Train, printing what the exploring policy does."""
    torch.manual_seed(args.seed)
    agent = Agent(env.single_observation_space.shape[0], env.single_action_space.shape[0]).to(env.device)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5, fused=True)
    rollout = Rollout(env, agent, args.num_steps)
    rollout.begin(args.seed * SEEDS_PER_RUN)
    of_rollout = args.num_steps * args.num_envs
    updates, start = -(-args.total_steps // of_rollout), time.perf_counter()
    state = env.get_state() if args.replay else None
    rollout.run()
    if state is not None:
        other = rde.make_torch(args.env_id, args.num_envs, device="cpu", autoreset_mode="same_step")
        say(
            f"replayed on a CPU: {differences(rollout, state, other)} numbers of the rollout differ",
            flush=True,
        )
    ends, held = (torch.zeros((), dtype=torch.int64, device=env.device) for _ in range(2))
    for iteration in range(updates):
        remaining = 1.0 - iteration / updates
        optimizer.param_groups[0]["lr"] = remaining * args.learning_rate
        advantages, returns = rollout.advantages(args.gamma, args.gae_lambda)
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        columns = (rollout.obs[:-1], rollout.actions, rollout.log_probs, advantages, returns)
        update(agent, optimizer, [c.flatten(0, 1) for c in columns], remaining * args.ent_coef, args)
        ends += rollout.ended.sum()
        held += (rollout.ended & rollout.held).sum()
        if iteration % 50 == 0 or iteration == updates - 1:
            share = f"holds {100 * (held / ends).item():5.1f} % while exploring" if ends else "no end yet"
            steps, seconds = (iteration + 1) * of_rollout, time.perf_counter() - start
            say(f"{steps:>10} steps  {seconds:5.0f} s  {share}", flush=True)
            ends, held = torch.zeros_like(ends), torch.zeros_like(held)
        rollout.next()
    return agent


@torch.no_grad()
def evaluate(agent: Agent, args: Args) -> float:
    """Share of the frozen goals that the mean actions hold."""
    env = rde.make_torch(args.env_id, args.evaluation_episodes, args.device)
    obs, _ = env.reset(seed=EVALUATION_SEED)
    held, running = (torch.zeros(env.num_envs, dtype=torch.bool, device=env.device) for _ in range(2))
    running |= True
    while running.any():
        obs, _, terminated, truncated, info = env.step(agent.mean(obs).clamp(-1.0, 1.0))
        ended = running & (terminated | truncated)
        held |= ended & info["is_success"]
        running &= ~ended
    return held.float().mean().item()


def main(given: list[str] | None = None) -> None:
    """Train, evaluate, and save the weights where that is asked for."""
    args = parse(given)
    torch.set_num_threads(1)  # on a CPU these networks are too small to share
    env = rde.make_torch(args.env_id, args.num_envs, args.device, autoreset_mode="same_step")
    start = time.perf_counter()
    agent = train(args, env)
    say(f"trained {args.env_id} with seed {args.seed} in {time.perf_counter() - start:.0f} s")
    say(f"holds {100 * evaluate(agent, args):.1f} % of {args.evaluation_episodes} frozen goals")
    if args.save:
        torch.save(agent.state_dict(), args.save)


if __name__ == "__main__":
    main()
