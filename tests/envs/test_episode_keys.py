"""Keys of episodes are the successive words of the generators, however many were drawn ahead."""

import copy
import pickle

import numpy as np
import pytest

from redundant_envs.envs.episode_keys import AHEAD, EpisodeKeys

LANES = np.arange(3)


def seeded(count=3):
    keys = EpisodeKeys(count)
    for lane in range(count):
        keys.seed(lane, 10 + lane)
    return keys


def words(lane, first, count):
    bits = np.random.PCG64(np.random.SeedSequence(10 + lane))
    return bits.random_raw(2 * (first + count))[2 * first :].view("<u4").reshape(count, 4)


def test_keys_are_the_words_of_each_generator_in_order():
    keys = seeded()
    for k in range(2 * AHEAD + 3):
        lanes = LANES if k % 2 == 0 else LANES[:2]
        taken = keys.take(lanes)
        for row, lane in enumerate(lanes):
            place = k if lane < 2 else k // 2
            np.testing.assert_array_equal(taken[row], words(lane, place, 1)[0])


@pytest.mark.parametrize("taken", [0, 1, AHEAD - 1, AHEAD, AHEAD + 2])
def test_generators_stand_where_the_taken_keys_have_left_them(taken):
    keys = seeded()
    for _ in range(taken):
        keys.take(LANES[1:])
    lanes = [g.bit_generator.random_raw(2).view("<u4") for g in copy.deepcopy(keys.generators)]
    np.testing.assert_array_equal(lanes, [words(k, taken if k else 0, 1)[0] for k in range(3)])
    for other in (copy.deepcopy(keys), pickle.loads(pickle.dumps(keys))):
        np.testing.assert_array_equal(
            other.take(LANES), [words(k, taken if k else 0, 1)[0] for k in range(3)]
        )


def test_a_new_seed_and_another_generator_forget_what_was_drawn_ahead():
    keys = seeded()
    keys.take(LANES)
    keys.seed(0, 12)
    np.testing.assert_array_equal(keys.take(LANES[:1])[0], words(2, 0, 1)[0])
    other = np.random.Generator(np.random.MT19937(5))
    keys.generators[1] = copy.deepcopy(other)
    for _ in range(3):
        expected = other.integers(0, 2**32, size=4, dtype=np.uint32)
        np.testing.assert_array_equal(keys.take(LANES[1:2])[0], expected)
    assert keys.generators[1].bit_generator.state["state"]["pos"] == other.bit_generator.state["state"]["pos"]


def test_a_single_lane_draws_nothing_ahead():
    keys = seeded(1)
    keys.take(LANES[:1])
    generator = keys._generators[0]
    np.testing.assert_array_equal(generator.bit_generator.random_raw(2).view("<u4"), words(0, 1, 1)[0])


def test_lanes_without_a_seed_have_keys_of_their_own():
    taken = EpisodeKeys(3).take(LANES)
    assert len({tuple(key) for key in taken.tolist()}) == 3
