"""Lanes of many groups of blocks are those of one group."""

import gymnasium as gym
import numpy as np
import pytest
from catalogue import GRAVITY, RPRP, assert_same_bits, stops

import redundant_envs as rde
from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.simulator.batch import blocks
from redundant_envs.verify.checks import random_states

pytestmark = pytest.mark.long

GROUP = LANES * blocks.GROUP
"""Lanes that go through a step together."""
COUNT = 2 * GROUP + 77
SCENE = rde.Scene(RPRP, (GRAVITY, stops(RPRP)), tolerance=1e-6)


def run(q, qd, efforts, intervals=4, threads=1):
    """States, events and evaluations after each interval, (lanes, intervals, 10)."""
    batch = rde.BatchSimulator(SCENE, len(q), threads)
    batch.set_state(q, qd)
    seen = []
    for k in range(intervals):
        status = batch.advance(np.roll(efforts, k, axis=1))
        seen.append(np.column_stack([batch.q, batch.qd, status.events, status.evaluations]))
    return np.stack(seen, axis=1)


def test_lanes_of_many_groups_are_those_of_one():
    states = random_states(SCENE, COUNT, 4)
    whole, order = run(*states), np.random.default_rng(5).permutation(COUNT)
    assert (whole[..., 8].sum(axis=1) > 0).mean() > 0.3
    for part, threads in (
        (order, 1), (np.arange(COUNT), 2), *((p, 1) for p in np.array_split(np.arange(COUNT), 9))
    ):  # fmt: skip
        assert_same_bits([run(*(x[part] for x in states), threads=threads)], [whole[part]])


def test_lanes_go_on_beside_a_group_that_has_none_of_its_own():
    states, calm = random_states(SCENE, GROUP, 7), np.tile([-np.pi / 2, 0.15] * 2, (8, 1))
    more = (np.vstack([x, y]) for x, y in zip(states, (calm, 0.0 * calm, 0.0 * calm), strict=True))
    alone, beside = run(*states, 1), run(*more, 1)
    assert (beside[GROUP:, 0, 9] == 12).all()
    assert_same_bits([beside[:GROUP]], [alone])


def test_environments_of_many_groups_are_those_of_few():
    count, last = GROUP + 21, GROUP - 64  # few are in one group, many are not
    many, few = (
        gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=n, max_episode_steps=20)
        for n in (count, count - last)
    )
    assert_same_bits([many.reset(seed=3)[0][last:]], [few.reset(seed=3 + last)[0]])
    rng = np.random.default_rng(6)
    for _ in range(45):
        actions = rng.uniform(-1, 1, (count, 4)).astype(np.float32)
        a, b = many.step(actions), few.step(actions[last:])
        assert_same_bits([x[last:] for x in a[:4]], b[:4])
        assert_same_bits([a[4][name][last:] for name in b[4]], b[4].values())
