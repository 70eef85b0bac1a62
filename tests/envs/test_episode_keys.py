"""Keys of episodes are the successive words of the generators, however many were drawn ahead."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, made

from redundant_envs.envs.core import AHEAD, EpisodeKeys

LANES = np.arange(3)


def seeded(count=3):
    keys = EpisodeKeys(count)
    for lane in range(count):
        keys.seed(lane, 10 + lane)
    return keys


def word(lane, place):
    """The key of a lane after some others."""
    bits = np.random.PCG64(np.random.SeedSequence(10 + lane))
    return bits.random_raw(2 * place + 2)[-2:].view("<u4")


def test_keys_are_the_words_of_each_generator_in_order():
    keys = seeded()
    for k in range(2 * AHEAD + 3):
        lanes = LANES if k % 2 == 0 else LANES[:2]
        expected = [word(lane, k if lane < 2 else k // 2) for lane in lanes]
        np.testing.assert_array_equal(keys.take(lanes), expected)


@pytest.mark.parametrize("taken", [0, 1, AHEAD - 1, AHEAD, AHEAD + 2])
def test_generators_stand_where_the_taken_keys_have_left_them(taken):
    keys = seeded()
    for _ in range(taken):
        keys.take(LANES[1:])
    expected = [word(k, taken if k else 0) for k in range(3)]
    lanes = [g.bit_generator.random_raw(2).view("<u4") for g in copy.deepcopy(keys.generators)]
    np.testing.assert_array_equal(lanes, expected)
    for other in (copy.deepcopy(keys), pickle.loads(pickle.dumps(keys))):
        np.testing.assert_array_equal(other.take(LANES), expected)


def test_a_new_seed_and_another_generator_forget_what_was_drawn_ahead():
    keys = seeded()
    keys.take(LANES)
    keys.seed(0, 12)
    np.testing.assert_array_equal(keys.take(LANES[:1])[0], word(2, 0))
    other = np.random.Generator(np.random.MT19937(5))
    keys.generators[1] = copy.deepcopy(other)
    for _ in range(3):
        expected = other.integers(0, 2**32, size=4, dtype=np.uint32)
        np.testing.assert_array_equal(keys.take(LANES[1:2])[0], expected)
    assert keys.generators[1].bit_generator.state["state"]["pos"] == other.bit_generator.state["state"]["pos"]


def test_a_single_lane_draws_nothing_ahead_and_lanes_without_a_seed_have_keys_of_their_own():
    keys = seeded(1)
    keys.take(LANES[:1])
    generator = keys._generators[0]
    np.testing.assert_array_equal(generator.bit_generator.random_raw(2).view("<u4"), word(0, 1))
    assert len({tuple(key) for key in EpisodeKeys(3).take(LANES).tolist()}) == 3


def test_environments_draw_them_when_they_are_needed():
    core = made("next_step", FOUR_R).core
    for lane in range(3):
        core.seed(lane, 20 + lane)
    core.provide_keys(LANES[[0, 2]])
    assert core.waiting.tolist() == [True, False, True]
    for lane in (0, 2):
        generator, _ = gym.utils.seeding.np_random(20 + lane)
        np.testing.assert_array_equal(core.keys[lane], generator.integers(0, 2**32, size=4, dtype=np.uint32))
        assert core.generators[lane].integers(2**32) == generator.integers(2**32)  # both go on alike
