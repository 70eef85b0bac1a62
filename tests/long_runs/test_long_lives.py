"""Long lives of processes: memory that does not grow."""

import gc
import multiprocessing
import os
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde

pytestmark = pytest.mark.long

ID = "redundant_envs/RPRPReach-v0"


def resident():
    """Resident memory of this process, bytes."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def episodes(env, lanes=128, warm_up=300, measured=1000):
    """Growth over ``measured`` episodes in all, after ``warm_up``, bytes; actions are random."""
    rng = np.random.default_rng(0)
    env.reset()
    ended, before = 0, None
    while ended < warm_up + measured:
        if before is None and ended >= warm_up:
            before = resident()
        _, _, over, *others = env.step(rng.uniform(-1.0, 1.0, (lanes, 4)).astype(np.float32))
        ended += int((over | others[0] if len(others) == 2 else over).sum())
    return resident() - before


def makes(warm_up=300, measured=50, windows=3):
    """The least growth of some windows of ``measured`` makes each, one after the other, after ``warm_up``.

    The system allocates memory by the megabyte: a step in one window means nothing, a leak shows in all.
    """
    found = []
    for n in range(warm_up + windows * measured + 1):
        if n >= warm_up and (n - warm_up) % measured == 0:
            found.append(resident())
        env = gym.make(ID) if n % 2 else gym.make_vec(ID, num_envs=16, threads=2)
        env.reset(seed=n)
        env.step(env.action_space.sample())
        env.close()
    return min(b - a for a, b in pairwise(found))


def growths():
    return [*(episodes(env) for env in (gym.make_vec(ID, num_envs=128), rde.make_sb3(ID, 128))), makes()]


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from Linux's /proc")
def test_memory_grows_neither_with_episodes_nor_with_makes():
    """A cache of data about functions reaches its 256 entries after 300 makes or so: 1 MB."""
    with multiprocessing.get_context("spawn").Pool(1) as alone:
        found = alone.apply(growths)
    assert (np.array(found) < np.array((1e6, 1e6, 3e5))).all(), found
