"""Keys of many lanes are those of the generators that Gymnasium gives for their seeds."""

import copy

import numpy as np
import pytest
from gymnasium.utils.seeding import np_random
from numpy.testing import assert_array_equal

from redundant_envs.envs import core
from redundant_envs.envs.core import MANY, EpisodeKeys
from redundant_envs.envs.words import LARGEST_SEED, first_words


def test_the_first_words_are_those_of_numpys_generators():
    rng = np.random.default_rng(0)
    edges = [0, 1, 2**31, 2**32 - 1, 2**32, 2**33 + 1, 2**63, LARGEST_SEED]
    seeds = [*edges, *rng.integers(0, LARGEST_SEED, 200, dtype=np.uint64, endpoint=True).tolist()]
    for seed, words in zip(seeds, first_words(seeds, 20), strict=True):
        assert_array_equal(words, np_random(seed)[0].bit_generator.random_raw(20))


@pytest.mark.parametrize("seed", [7, LARGEST_SEED - 3], ids=["small", "beyond 64 bits"])
def test_lanes_that_are_seeded_together_have_the_keys_of_those_that_are_seeded_alone(seed, monkeypatch):
    lanes = list(range(1, MANY + 8))
    seeds, count = [seed + lane for lane in lanes], MANY + 10
    together, alone = EpisodeKeys(count), EpisodeKeys(count)
    together.seed_all(lanes, seeds)
    for lane, own in zip(lanes, seeds, strict=True):
        alone.seed(lane, own)
    some = np.array(lanes[::3])
    for episode in range(2 * core.AHEAD + 1):
        chosen = some if episode % 3 else np.array(lanes)
        assert_array_equal(together.take(chosen), alone.take(chosen))
        if episode == core.AHEAD // 2:
            together = copy.deepcopy(together)
        if episode in (0, core.AHEAD - 1, core.AHEAD + 1):
            pairs = zip(copy.deepcopy(together).generators, copy.deepcopy(alone).generators, strict=True)
            for one, other in pairs:
                assert (one and one.bit_generator.state) == (other and other.bit_generator.state)
    assert together.seeds == alone.seeds


def test_many_lanes_without_a_seed_have_generators_of_the_seeds_that_they_tell():
    keys = EpisodeKeys(MANY + 2)
    first = keys.take(np.arange(MANY + 2))
    assert len(keys._unmade) == MANY + 2
    assert len({*keys.seeds}) == MANY + 2
    for lane, seed in enumerate(keys.seeds):
        again = np_random(seed)[0].bit_generator.random_raw(2)
        assert_array_equal(first[lane], again.astype("<u8").view("<u4"))
