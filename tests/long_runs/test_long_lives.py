"""Long lives of processes: memory that does not grow, threads that neither differ nor hang."""

import gc
import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

pytestmark = pytest.mark.long

MEGABYTE = 1e6
ID = "redundant_envs/RPRPReach-v0"
LANES, THREADS, CORES, STEPS = 256, 4, 2, 500
ARM = rde.RPRP((1.0,) * 4, (0.5,) * 2)
SCENE = rde.Scene(ARM, (Gravity(), PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5)), tolerance=1e-6)


def alone(measure):
    """What a process of its own measures."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure)


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


@pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux's /proc"
)
def test_memory_grows_neither_with_episodes_nor_with_makes():
    """A cache of data about functions reaches its 256 entries after 300 makes or so: 1 MB."""
    found = alone(growths)
    assert (np.array(found) < np.array((1.0, 1.0, 0.3)) * MEGABYTE).all(), found


def simulator(threads):
    rng = np.random.default_rng(7)
    batch = rde.BatchSimulator(SCENE, LANES, threads=threads)
    q = rng.uniform(-3.0, 3.0, (LANES, 4))
    q[:, [1, 3]] = rng.uniform(0.0, 0.3, (LANES, 2))
    batch.set_state(q, rng.normal(0.0, 2.0, (LANES, 4)))
    return batch


def advanced(batch, efforts):
    batch.advance(efforts)
    return np.hstack([batch.q, batch.qd]).tobytes()


def stepped(env, actions):
    return b"".join(x.tobytes() for x in env.step(actions.astype(np.float32))[:4])


def all_compared():
    """In how many steps bits differed: of simulators and of environments of one thread and of four, and of
    four simulators in a thread of Python each."""
    batches, singles = [simulator(n) for n in (1, THREADS)], [simulator(1) for _ in range(THREADS)]
    envs = [gym.make_vec("redundant_envs/FourRReach-v0", num_envs=LANES, threads=n) for n in (1, THREADS)]
    for env in envs:
        env.reset(seed=3)
    rng, differing = np.random.default_rng(8), np.zeros(3, int)
    with ThreadPoolExecutor(THREADS) as pool:
        for _ in range(STEPS):
            x = rng.uniform(-1.0, 1.0, (LANES, 4))
            ends = (
                [advanced(batch, 5.0 * x) for batch in batches],
                [stepped(env, x) for env in envs],
                pool.map(advanced, singles, [5.0 * x] * THREADS),
            )
            differing += [len(set(found)) > 1 for found in ends]
    return differing.tolist()


def busy():
    """The comparisons while two processes keep two cores busy."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(CORES)]
    try:
        return all_compared()
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def test_four_threads_on_two_busy_cores_give_the_same_bits():
    assert alone(busy) == [0, 0, 0]
