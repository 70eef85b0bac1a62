"""PPO on the native vector environment, in one file: python docs/examples/cleanrl_ppo.py --seed 1

In the form of CleanRL (Huang et al. 2022, JMLR 23(274), docs.cleanrl.dev): one file, one algorithm, every
detail visible; nothing is imported from this repository but the environments. The algorithm is PPO with
generalised advantages (Schulman et al. 2016, 2017), orthogonal initial weights, normalised advantages, a
learning rate and an entropy weight that fall to 0, and clipped gradients (Huang et al. 2022, The 37
Implementation Details of Proximal Policy Optimization).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, fields

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

import redundant_envs  # noqa: F401 (registers the ids)

SEEDS_PER_RUN = 10_000
"""Environment seeds of a run: seed * 10 000 and up, one per environment."""
EVALUATION_SEED = 1_000_000
"""The frozen goals of the evaluation: seeds from here on."""


@dataclass
class Args:
    """Arguments of the command line."""

    env_id: str = "redundant_envs/RPRPReach-v0"
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
    save: str = ""


HELP = {
    "seed": "0 to 99", "total_steps": "of all environments together",
    "num_steps": "of every environment between two updates", "learning_rate": "at the beginning; linear to 0",
    "ent_coef": "weight of the entropy at the beginning; linear to 0", "save": "file for the weights",
}  # fmt: skip


def parse() -> Args:
    """The arguments, one option for each field."""
    parser = argparse.ArgumentParser(formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    for field in fields(Args):
        option = "--" + field.name.replace("_", "-")
        help = HELP.get(field.name, " ")  # a blank one shows the default
        parser.add_argument(option, type=type(field.default), default=field.default, help=help)
    args = Args(**vars(parser.parse_args()))
    if not 0 <= args.seed <= 99:
        parser.error(f"--seed is {args.seed}; give one from 0 to 99: others would meet the frozen goals")
    if (args.num_envs * args.num_steps) % args.batch_size:
        parser.error(f"--batch-size is {args.batch_size}; it must divide num_envs * num_steps")
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


def to_env(action: Tensor) -> NDArray[np.float32]:
    """Actions as the environment takes them."""
    return action.clamp(-1.0, 1.0).numpy()


@torch.no_grad()
def advantages_of(rewards: Tensor, values: Tensor, terminated: Tensor, ended: Tensor, args: Args) -> Tensor:
    """Generalised advantages, (steps, envs); ``values`` has one row more, after the last step.

    In the autoreset mode "next_step" the observation after a step that ends an episode is the last one of
    that episode. So its value counts where a time limit ended it, and does not where it terminated.
    """
    advantages = torch.zeros_like(rewards)
    following = torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        delta = rewards[t] + args.gamma * values[t + 1] * ~terminated[t] - values[t]
        following = delta + args.gamma * args.gae_lambda * ~ended[t] * following
        advantages[t] = following
    return advantages


def update(
    agent: Agent, optimizer: torch.optim.Optimizer, data: list[Tensor], entropy: float, args: Args
) -> None:
    """Epochs of minibatches over observations, actions, their log probabilities, advantages and returns."""
    for _ in range(args.epochs):
        for rows in torch.randperm(len(data[0])).split(args.batch_size):
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


def train(args: Args) -> Agent:
    """Train, printing what the exploring policy does."""
    torch.manual_seed(args.seed)
    env = gym.make_vec(args.env_id, num_envs=args.num_envs)
    assert isinstance(env.single_observation_space, gym.spaces.Box), "choose an id without Goal"
    agent = Agent(env.single_observation_space.shape[0], env.single_action_space.shape[0])
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5, fused=True)
    shape = (args.num_steps, args.num_envs)
    observations = torch.zeros(args.num_steps + 1, args.num_envs, *env.single_observation_space.shape)
    actions = torch.zeros(*shape, *env.single_action_space.shape)
    log_probs, rewards = torch.zeros(shape), torch.zeros(shape)
    terminated, ended, valid = (torch.zeros(shape, dtype=torch.bool) for _ in range(3))
    updates = -(-args.total_steps // (args.num_steps * args.num_envs))
    obs, _ = env.reset(seed=args.seed * SEEDS_PER_RUN)
    begins = np.zeros(args.num_envs, dtype=np.bool_)
    held: list[bool] = []
    start = time.perf_counter()
    for iteration in range(updates):
        remaining = 1.0 - iteration / updates
        optimizer.param_groups[0]["lr"] = remaining * args.learning_rate
        with torch.no_grad():
            for t in range(args.num_steps):
                observations[t] = torch.from_numpy(obs)
                mean = agent.mean(observations[t])
                actions[t] = mean + agent.log_std.exp() * torch.randn_like(mean)
                log_probs[t] = agent.log_prob(mean, actions[t])
                # the step after an episode's end begins the next one and ignores the action
                valid[t] = torch.from_numpy(~begins)
                obs, reward, ends, truncated, info = env.step(to_env(actions[t]))
                begins = ends | truncated
                rewards[t], terminated[t] = torch.from_numpy(reward), torch.from_numpy(ends)
                ended[t] = torch.from_numpy(begins)
                held += info["is_success"][begins].tolist()
            observations[-1] = torch.from_numpy(obs)
            values = agent.value(observations)[..., 0]
        advantages = advantages_of(rewards, values, terminated, ended, args)
        returns = advantages + values[:-1]
        advantages = (advantages - advantages[valid].mean()) / (advantages[valid].std() + 1e-8)
        columns = (observations[:-1], actions, log_probs, advantages, returns)
        update(agent, optimizer, [c[valid] for c in columns], remaining * args.ent_coef, args)
        if held and (iteration % 50 == 0 or iteration == updates - 1):
            steps, seconds = (iteration + 1) * args.num_steps * args.num_envs, time.perf_counter() - start
            print(
                f"{steps:>10} steps  {seconds:5.0f} s  holds {100 * np.mean(held):5.1f} % while exploring  "
                f"std {agent.log_std.exp().mean().item():.3f}",
                flush=True,
            )
            held.clear()
    env.close()
    return agent


@torch.no_grad()
def evaluate(agent: Agent, args: Args) -> float:
    """Share of the frozen goals that the mean actions hold."""
    env = gym.make_vec(args.env_id, num_envs=args.evaluation_episodes)
    obs, _ = env.reset(seed=EVALUATION_SEED)
    held, running = np.zeros(env.num_envs, dtype=np.bool_), np.ones(env.num_envs, dtype=np.bool_)
    while running.any():
        obs, _, terminated, truncated, info = env.step(to_env(agent.mean(torch.from_numpy(obs))))
        ended = running & (terminated | truncated)
        held[ended] = info["is_success"][ended]
        running &= ~ended
    env.close()
    return float(held.mean())


def main() -> None:
    """Train, evaluate, and save the weights where that is asked for."""
    args = parse()
    torch.set_num_threads(1)  # these networks are too small to share
    start = time.perf_counter()
    agent = train(args)
    print(f"trained {args.env_id} with seed {args.seed} in {time.perf_counter() - start:.0f} s")
    print(f"holds {100 * evaluate(agent, args):.1f} % of {args.evaluation_episodes} frozen goals")
    if args.save:
        torch.save(agent.state_dict(), args.save)


if __name__ == "__main__":
    main()
