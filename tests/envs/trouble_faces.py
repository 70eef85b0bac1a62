"""All kinds of environments with one interface: the first environment is faulty, its neighbour is not."""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import redundant_envs as rde


@dataclass
class Seen:
    """Outputs of the faulty environment after a step."""

    observation: Any
    terminated: bool
    ended: bool
    info: dict[str, Any]


class Single:
    def __init__(self, env_id, **kwargs):
        self.env = gym.make(env_id, **kwargs)
        self.core = self.env.unwrapped.core

    def start(self):
        self.reset_info = self.env.reset(seed=0)[1]

    def reset(self, options):
        self.reset_info = self.env.reset(options=options)[1]

    def step(self, action):
        observation, _, terminated, truncated, info = self.env.step(action)
        return Seen(observation, terminated, terminated or truncated, info)


class Vector:
    def __init__(self, env_id, **kwargs):
        self.env = gym.make_vec(env_id, num_envs=2, **kwargs)
        self.core = self.env.core

    def start(self):
        self.reset_info = self._first(self.env.reset(seed=0)[1])

    def reset(self, options):
        mask = {"reset_mask": np.array([True, False])}
        self.reset_info = self._first(self.env.reset(options={**options, **mask})[1])

    def step(self, action):
        self.last = self.env.step(np.stack([action, np.zeros_like(action)]))
        observation, _, terminated, truncated, infos = self.last
        ended = bool(terminated[0] or truncated[0])
        return Seen(self._first(observation), bool(terminated[0]), ended, self._first(infos))

    def neighbour(self):
        """Outputs of the other environment."""
        observation, reward, terminated, truncated, infos = self.last
        rows = observation if isinstance(observation, dict) else {"": observation}
        return [*(v[1] for v in rows.values()), reward[1], terminated[1], truncated[1], infos["numerics"][1]]

    @staticmethod
    def _first(batch):
        return {k: v[0] for k, v in batch.items()} if isinstance(batch, dict) else batch[0]


class SB3:
    def __init__(self, env_id, **kwargs):
        self.env = rde.make_sb3(env_id, 2, **kwargs)
        self.core = self.env.core

    def start(self):
        self.env.seed(0)
        self.env.reset()

    def reset(self, options):
        self.env.set_options([options, {}])
        self.env.reset()
        self.reset_info = self.env.reset_infos[0]

    def step(self, action):
        self.last = self.env.step(np.stack([action, np.zeros_like(action)]))
        observation, _, dones, infos = self.last
        info = infos[0]
        first = {k: v[0] for k, v in observation.items()} if isinstance(observation, dict) else observation[0]
        seen = info["terminal_observation"] if dones[0] else first
        return Seen(seen, bool(dones[0] and not info["TimeLimit.truncated"]), bool(dones[0]), info)

    def neighbour(self):
        observation, reward, dones, infos = self.last
        rows = observation if isinstance(observation, dict) else {"": observation}
        return [*(v[1] for v in rows.values()), reward[1], dones[1], infos[1]["is_success"]]
