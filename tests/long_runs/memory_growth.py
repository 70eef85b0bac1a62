"""Resident memory that this process gains over many episodes or makes, as one line of JSON, bytes.

``python memory_growth.py episodes FACE LANES WARM_UP MEASURED`` runs episodes in a vector
environment of Gymnasium or stable-baselines3; ``makes WARM_UP MEASURED WINDOWS`` makes single and vector
environments, uses and closes them. A process of its own: what other tests left to be freed does not count.
"""

import gc
import json
import os
import sys
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import numpy as np

import redundant_envs as rde

ID = "redundant_envs/RPRPReach-v0"


def resident():
    """Resident memory of this process, bytes."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def episodes(face, lanes, warm_up, measured):
    """Growth over ``measured`` episodes in all, after ``warm_up``; actions are random."""
    rng = np.random.default_rng(0)
    env = rde.make_sb3(ID, lanes) if face == "sb3" else gym.make_vec(ID, num_envs=lanes)
    env.reset()
    ended = 0
    before = None
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


if __name__ == "__main__":
    what, *rest = sys.argv[1:]
    if what == "episodes":
        print(json.dumps(episodes(rest[0], *(int(x) for x in rest[1:]))))
    else:
        print(json.dumps(makes(*(int(x) for x in rest))))
