"""Four threads on two busy cores, for so many seconds: as JSON, how many steps were compared and differed.

``python threads_under_load.py SECONDS``. Two processes keep the cores busy. A vector environment and a
simulator of hard stops with four threads each make the same steps as those with one; and four threads of
Python step simulators of their own at the same time. A process of its own, which its parent can end if it
hangs.
"""

import json
import os
import subprocess
import sys
import threading
import time

import gymnasium as gym
import numpy as np

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

LANES, THREADS, CORES = 256, 4, 2
BURN = "while True: pass"


def scene():
    arm = rde.RPRP((1.0,) * 4, (0.5,) * 2)
    return rde.Scene(arm, (Gravity(), PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5)), tolerance=1e-6)


def simulator(threads, seed):
    rng = np.random.default_rng(seed)
    batch = rde.BatchSimulator(scene(), LANES, threads=threads)
    q = rng.uniform(-3.0, 3.0, (LANES, 4))
    q[:, [1, 3]] = rng.uniform(0.0, 0.3, (LANES, 2))
    batch.set_state(q, rng.normal(0.0, 2.0, (LANES, 4)))
    return batch


def advanced(batch, efforts):
    batch.advance(efforts)
    return np.hstack([batch.q, batch.qd]).tobytes()


def own_simulators(seconds):
    """Four threads of Python, each with a simulator; how many steps, and how many differ among the four."""
    ends = [[] for _ in range(THREADS)]
    stop = time.monotonic() + seconds

    def run(n):
        batch, rng = simulator(1, 7), np.random.default_rng(8)
        while time.monotonic() < stop:
            ends[n].append(advanced(batch, rng.uniform(-5.0, 5.0, (LANES, 4))))

    threads = [threading.Thread(target=run, args=(n,)) for n in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    compared = min(len(found) for found in ends)
    return compared, sum(len({found[k] for found in ends}) > 1 for k in range(compared))


def teams(seconds):
    """Simulators and environments of four threads against those of one: steps, and how many differ."""
    batches = [simulator(n, 7) for n in (1, THREADS)]
    envs = [gym.make_vec("redundant_envs/FourRReach-v0", num_envs=LANES, threads=n) for n in (1, THREADS)]
    for env in envs:
        env.reset(seed=3)
    rng = np.random.default_rng(8)
    stop, compared, different = time.monotonic() + seconds, 0, 0
    while time.monotonic() < stop:
        efforts = rng.uniform(-5.0, 5.0, (LANES, 4))
        one, four = (advanced(batch, efforts) for batch in batches)
        actions = rng.uniform(-1.0, 1.0, (LANES, 4)).astype(np.float32)
        here, there = (env.step(actions) for env in envs)
        same = all(np.array_equal(a, b) for a, b in zip(here[:4], there[:4], strict=True))
        different += one != four or not same
        compared += 2
    return compared, different


if __name__ == "__main__":
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    seconds = 0.5 * float(sys.argv[1])
    burners = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(CORES)]
    try:
        found = {"teams": teams(seconds), "own simulators": own_simulators(seconds)}
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    print(json.dumps(found))
