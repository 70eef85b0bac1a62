"""The three kinds of an environment, in the middle of an episode, and the contents of their states."""

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde

ID = "redundant_envs/RPRPReach-v0"


def single(**kwargs):
    """An environment in the middle of an episode."""
    env = gym.make(kwargs.pop("id", ID), **kwargs).unwrapped
    env.action_space.seed(0)
    env.reset(seed=3)
    env.step(env.action_space.sample())
    return env


def vector(count=3, **kwargs):
    env = gym.make_vec(kwargs.pop("id", ID), num_envs=count, **kwargs)
    env.action_space.seed(0)
    env.reset(seed=3)
    env.step(env.action_space.sample())
    return env


def sb3(count=3, **kwargs):
    env = rde.make_sb3(kwargs.pop("id", ID), count, **kwargs)
    env.seed(3)
    env.reset()
    env.step(np.full((count, 4), 0.4, np.float32))
    return env


FACES = {"single": single, "vector": vector, "sb3": sb3}
every_face = pytest.mark.parametrize("make", FACES.values(), ids=FACES)


def plain(value):
    """The whole content of a state, in a comparable form."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    return plain(value.bit_generator.state) if isinstance(value, np.random.Generator) else value
