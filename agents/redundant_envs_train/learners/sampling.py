"""Samples of stable-baselines3's replay buffers, the same in a third of the time: NumPy takes whole rows
several times as fast as elements at pairs of indices."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support.extras import needs

from ..rollout import each

with needs("train"):
    import torch
    from stable_baselines3 import HerReplayBuffer
    from stable_baselines3.common.type_aliases import DictReplayBufferSamples
    from stable_baselines3.her.goal_selection_strategy import GoalSelectionStrategy


def sample(buffer: Any, count: int) -> DictReplayBufferSamples:
    """What ``buffer.sample(count)`` gives for a ReplayBuffer, a DictReplayBuffer or a HerReplayBuffer."""
    hindsight = isinstance(buffer, HerReplayBuffer)
    if hindsight:
        whole = np.flatnonzero(buffer.ep_length > 0)  # transitions of episodes that are over
        index = whole[np.random.randint(0, len(whole), count)]
        index = np.roll(index, -int(buffer.her_ratio * count))  # those with their own goals come first
    else:
        steps = np.random.randint(0, buffer.buffer_size if buffer.full else buffer.pos, count)
        index = steps * buffer.n_envs + np.random.randint(0, buffer.n_envs, count)
    seen, after = _rows(buffer.observations, index), _rows(buffer.next_observations, index)
    rewards = _rows(buffer.rewards, index)
    if hindsight:
        reached = slice(count - int(buffer.her_ratio * count), count)
        goals = _hindsight_goals(buffer, index[reached])
        seen["desired_goal"][reached] = after["desired_goal"][reached] = goals
        tips = after["achieved_goal"][reached]
        rewards[reached] = buffer.env.env_method("compute_reward", tips, goals, {}, indices=[0])[0]
    ends = _rows(buffer.dones, index) * (1.0 - _rows(buffer.timeouts, index))
    numbers = _rows(buffer.actions, index), ends[:, None], rewards[:, None]
    actions, dones, rewards = map(torch.from_numpy, numbers)
    seen, after = each(torch.from_numpy, seen), each(torch.from_numpy, after)
    return DictReplayBufferSamples(seen, actions, after, dones, rewards)


def sample_ahead(buffer: Any, count: int, n_steps: int, gamma: float) -> tuple[DictReplayBufferSamples, Any]:
    """Transitions over ``n_steps`` steps, or to the end of an episode (Sutton 1988), of a ReplayBuffer: the
    discounted sum of the rewards, the observation after them, and the discount of its value. Beside them the
    observations after one step."""
    there = buffer.buffer_size if buffer.full else buffer.pos
    n_steps = min(n_steps, there)
    steps = np.random.randint(0, there - n_steps + 1, count) + (buffer.pos if buffer.full else 0)
    lanes = np.random.randint(0, buffer.n_envs, count)
    rewards, discounts, alive = np.zeros((3, count, 1), np.float32)
    discounts += 1.0
    alive += 1.0
    first = last = steps % buffer.buffer_size * buffer.n_envs + lanes
    for k in range(n_steps):
        index = (steps + k) % buffer.buffer_size * buffer.n_envs + lanes
        last = np.where(alive[:, 0] > 0.0, index, last)
        rewards += alive * discounts * _rows(buffer.rewards, index)[:, None]
        discounts *= np.where(alive > 0.0, np.float32(gamma), np.float32(1.0))
        alive *= 1.0 - _rows(buffer.dones, index)[:, None]
    ends = _rows(buffer.dones, last) * (1.0 - _rows(buffer.timeouts, last))
    seen, after, soon = (
        each(torch.from_numpy, _rows(part, index))
        for part, index in (
            (buffer.observations, first), (buffer.next_observations, last), (buffer.next_observations, first),
        )
    )  # fmt: skip
    numbers = map(torch.from_numpy, (_rows(buffer.actions, first), ends[:, None], rewards, discounts))
    actions, dones, sums, powers = numbers
    return DictReplayBufferSamples(seen, actions, after, dones, sums, powers), soon


def some_of(rows: DictReplayBufferSamples, count: int) -> DictReplayBufferSamples:
    """So many rows, drawn with replacement by NumPy's global generator as those of a buffer are."""
    index = torch.from_numpy(np.random.randint(0, len(rows.actions), count))
    drawn = (each(lambda part: part.index_select(0, index), part) for part in rows[:5])
    return DictReplayBufferSamples(*drawn)


def _hindsight_goals(buffer: HerReplayBuffer, index: NDArray[np.int64]) -> NDArray[np.floating]:
    """Goals that are reached in the episodes of these transitions, (rows, 2)."""
    steps, lanes = np.divmod(index, buffer.n_envs)
    starts, lengths = _rows(buffer.ep_start, index), _rows(buffer.ep_length, index)
    if buffer.goal_selection_strategy == GoalSelectionStrategy.FINAL:
        chosen = lengths - 1
    elif buffer.goal_selection_strategy == GoalSelectionStrategy.FUTURE:
        chosen = np.random.randint((steps - starts) % buffer.buffer_size, lengths)
    else:
        chosen = np.random.randint(0, lengths)
    chosen = (chosen + starts) % buffer.buffer_size
    return _rows(buffer.next_observations["achieved_goal"], chosen * buffer.n_envs + lanes)


def _rows(arrays: Any, index: NDArray[np.int64]) -> Any:
    """Rows of (steps, environments, ...), or of each array of a goal environment, at flat indices."""
    return each(lambda array: array.reshape(-1, *array.shape[2:]).take(index, 0), arrays)
