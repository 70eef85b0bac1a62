"""States with impossible numbers, and episodes that never began or have ended."""

import gymnasium as gym
import numpy as np
import pytest
from faces import FACES, ID, every_face, plain
from gymnasium.error import ResetNeeded

import redundant_envs as rde
from redundant_envs.lane.memory import PARAMETER


def tampered(env, name, value):
    """A state of an environment in which the first lane has another number."""
    state, memory = env.get_state(), env.core.memory
    space, row = memory.layout.row_of(name)
    key = "parameters" if space == str(PARAMETER) else "states"
    numbers = state[key].copy()
    block = numbers[: memory.arrays[space].size].reshape(memory.arrays[space].shape)
    block[0, row, 0] = value
    return {**state, key: numbers}


IMPOSSIBLE = {
    "r1": (0.3, "r1 is 0.3 m; its stops are at"),
    "r2": (-1e-9, "r2 is -1e-09 m; its stops are at"),
    "m1": (-1.0, "masses has the entry -1.0; it must be positive"),
    "l1": (0.0, "lengths has the entry 0.0; it must be positive"),
    "viscous_friction.coefficients[0]": (-0.1, "must not be negative"),
    "steps": (np.nan, "has a steps that is not finite"),
    "theta1": (np.inf, "has a theta1 that is not finite"),
}


@every_face
@pytest.mark.parametrize(("name", "change"), IMPOSSIBLE.items(), ids=IMPOSSIBLE)
def test_numbers_that_no_motion_has_are_refused_and_change_nothing(make, name, change):
    env = make()
    before = plain(env.get_state())
    with pytest.raises(ValueError, match=change[1]):
        env.set_state(tampered(env, name, change[0]))
    assert plain(env.get_state()) == before


NEVER_BEGUN = {
    "single": lambda: gym.make(ID).unwrapped,
    "vector": lambda: gym.make_vec(ID, num_envs=3),
    "sb3": lambda: rde.make_sb3(ID, 3),
}


@pytest.mark.parametrize("face", FACES)
def test_a_state_of_before_the_first_reset_is_no_episode(face):
    env = FACES[face]()
    env.set_state(NEVER_BEGUN[face]().get_state())
    with pytest.raises(ResetNeeded, match="before reset"):
        env.step(np.zeros(4 if face == "single" else (3, 4), np.float32))
    env.reset()
    env.step(np.zeros(4 if face == "single" else (3, 4), np.float32))


def test_an_ended_episode_does_not_go_on_where_episodes_begin_anew():
    ended = gym.make(ID, on_bad_action="terminate", max_episode_steps=-1).unwrapped
    ended.reset(seed=0)
    assert ended.step(np.full(4, np.nan, np.float32))[2]
    other = rde.make_sb3(ID, 1, max_episode_steps=-1)
    other.reset()
    before = plain(other.get_state())
    with pytest.raises(ValueError, match=r"episodes have ended, \[0\]"):
        other.set_state(ended.get_state())
    assert plain(other.get_state()) == before
