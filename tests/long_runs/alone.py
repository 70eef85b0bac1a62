"""What a process of its own measures, as one line of JSON: memory it gains, bytes; steps under load.

``python alone.py episodes FACE LANES WARM_UP MEASURED`` runs episodes in a vector environment of Gymnasium or
stable-baselines3; ``makes WARM_UP MEASURED WINDOWS`` makes single and vector environments, uses and closes
them: what other tests left to be freed does not count. ``threads SECONDS`` keeps two cores busy with two
processes, while a vector environment and a simulator of hard stops with four threads each make the same steps
as those with one, and four threads of Python step simulators of their own: it says how many steps were
compared and differed, and its parent can end it if it hangs.
"""

import gc
import json
import os
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

ID = "redundant_envs/RPRPReach-v0"
LANES, THREADS, CORES = 256, 4, 2
ARM = rde.RPRP((1.0,) * 4, (0.5,) * 2)
SCENE = rde.Scene(ARM, (Gravity(), PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5)), tolerance=1e-6)


def resident():
    """Resident memory of this process, bytes."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def episodes(face, lanes, warm_up, measured):
    """Growth over ``measured`` episodes in all, after ``warm_up``; actions are random."""
    rng = np.random.default_rng(0)
    env = rde.make_sb3(ID, lanes) if face == "sb3" else gym.make_vec(ID, num_envs=lanes)
    env.reset()
    ended, before = 0, None
    while ended < warm_up + measured:
        if before is None and ended >= warm_up:
            before = resident()
        out = env.step(rng.uniform(-1.0, 1.0, (lanes, 4)).astype(np.float32))
        ended += int(out[2].sum() if face == "sb3" else (out[2] | out[3]).sum())
    return resident() - before


def makes(warm_up, measured, windows):
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


def simulator(threads, seed):
    rng = np.random.default_rng(seed)
    batch = rde.BatchSimulator(SCENE, LANES, threads=threads)
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
    for act in (threading.Thread.start, threading.Thread.join):
        for thread in threads:
            act(thread)
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


def threads(seconds):
    """Half of the seconds each."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(CORES)]
    try:
        return {"teams": teams(0.5 * seconds), "own simulators": own_simulators(0.5 * seconds)}
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


if __name__ == "__main__":
    what, *given = (json.loads(x) if x[0].isdigit() else x for x in sys.argv[1:])
    print(json.dumps({"episodes": episodes, "makes": makes, "threads": threads}[what](*given)))
