"""Lanes of many groups of blocks are those of one group."""

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.batch import blocks

ARM = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
GROUP = blocks.LANES * blocks.GROUP
"""Lanes that go through a step together."""


def scene(**kwargs):
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5))
    return rde.Scene(ARM, effects, **{"control_dt": 0.02, "tolerance": None, **kwargs})


def random_states(count, seed):
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@pytest.mark.parametrize(
    "kwargs", [{}, {"substeps": 3}, {"tolerance": 1e-6}, {"integrator": "dop853"}], ids=str
)
def test_lanes_of_many_groups_are_those_of_one(kwargs):
    count = 2 * GROUP + 77
    q, qd, efforts = random_states(count, 4)

    def run(index, threads=1):
        batch = rde.BatchSimulator(scene(**kwargs), len(index), threads=threads)
        batch.set_state(q[index], qd[index])
        seen = []
        for k in range(4):
            status = batch.advance(np.roll(efforts, k, axis=1)[index])
            seen.append(np.column_stack([batch.q, batch.qd, status.events, status.evaluations]))
        return np.stack(seen, axis=1)

    whole = run(np.arange(count))
    assert (whole[..., 8].sum(axis=1) > 0).mean() > 0.3
    order = np.random.default_rng(5).permutation(count)
    np.testing.assert_array_equal(run(order), whole[order])
    np.testing.assert_array_equal(run(np.arange(count), threads=2), whole)
    for part in np.array_split(np.arange(count), 9):
        np.testing.assert_array_equal(run(part), whole[part])


def test_lanes_go_on_beside_a_group_that_has_none_of_its_own():
    q, qd, efforts = random_states(GROUP, 7)
    calm = np.tile([-np.pi / 2, 0.15, -np.pi / 2, 0.15], (8, 1))
    ends = []
    for more in (0, 8):
        batch = rde.BatchSimulator(scene(), GROUP + more)
        batch.set_state(np.vstack([q, calm[:more]]), np.vstack([qd, 0.0 * calm[:more]]))
        status = batch.advance(np.vstack([efforts, 0.0 * calm[:more]]))
        assert (status.evaluations[GROUP:] == 12).all()
        ends.append(np.column_stack([batch.q, batch.qd, status.evaluations])[:GROUP])
    np.testing.assert_array_equal(*ends)


def test_environments_of_many_groups_are_those_of_few():
    count, last = GROUP + 21, GROUP - 64  # few are in one group, many are not
    make = {"max_episode_steps": 20}
    many = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=count, **make)
    few = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=count - last, **make)
    np.testing.assert_array_equal(many.reset(seed=3)[0][last:], few.reset(seed=3 + last)[0])
    rng = np.random.default_rng(6)
    for _ in range(45):
        actions = rng.uniform(-1, 1, (count, 4)).astype(np.float32)
        a, b = many.step(actions), few.step(actions[last:])
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x[last:], y)
        for name, values in b[4].items():
            np.testing.assert_array_equal(a[4][name][last:], values, err_msg=name)
