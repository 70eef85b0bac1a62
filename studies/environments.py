"""Speed of the environments: vector steps per second, one step of a single one, and import to first step."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from typing import Any

import gymnasium as gym
import numpy as np

from redundant_envs.envs.registration import NAMESPACE, SCENES
from redundant_envs.machine import versions
from redundant_envs.progress import counted
from redundant_envs.scene import load_scene
from studies.timing import one_core

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "gymnasium", "env", "lanes",
    "vector_steps_per_s_best", "vector_steps_per_s_median", "vector_renewed_actions_best",
    "vector_one_rk8_step_best", "vector_one_rk8_step_renewed_actions_best", "single_us_per_step",
    "cartpole_us_per_step", "single_over_cartpole", "import_to_first_step_s", "single_info_read_us_per_step",
)  # fmt: skip
BASELINE = "CartPole-v1"
IDS = tuple(f"{NAMESPACE}/{arm}Reach-v0" for arm in SCENES)
VECTOR_STEPS = 101
"""Steps per round: one whole episode and its reset, so that resets are included in proportion."""
FIRST_STEP = """
import time
start = time.process_time()
import gymnasium as gym
import redundant_envs
env = gym.make({name!r})
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.process_time() - start)
"""


def vector_rates(
    name: str, lanes: int, rounds: int, controlled: bool = True, renewed: bool = False
) -> list[float]:
    """Environment steps per second of the native vector environment, one number per round.

    With error control, the default, or with one rk8 step for every control step; with random actions
    that each environment keeps, or with ``renewed`` ones at every step, with which the sliders of RPRP
    reach and leave their stops more often.
    """
    scene = load_scene(SCENES[name.split("/")[1].removesuffix("Reach-v0")]).to_dict()
    env = gym.make_vec(name, num_envs=lanes, scene=scene if controlled else {**scene, "tolerance": None})
    env.reset(seed=0)
    tables = VECTOR_STEPS if renewed else 1
    shape = (tables, *np.shape(env.action_space.sample()))
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    env.step(drawn[0])
    rates = []
    for _ in range(rounds):
        start = time.process_time()
        for k in range(VECTOR_STEPS):
            env.step(drawn[k % tables])
        rates.append(lanes * VECTOR_STEPS / (time.process_time() - start))
    env.close()
    return rates


def step_seconds(env: gym.Env[Any, Any], actions: list[Any], read: bool = False) -> float:
    """Mean time of one step, s, and with ``read`` of reading its info; resets are not counted."""
    env.reset(seed=0)
    spent, start = 0.0, time.process_time()
    for action in actions:
        _, _, terminated, truncated, info = env.step(action)
        if read:
            info["numerics"]
        if terminated or truncated:
            spent += time.process_time() - start
            env.reset()
            start = time.process_time()
    return (spent + time.process_time() - start) / len(actions)


def single_against_baseline(name: str, rounds: int, steps: int) -> tuple[float, float, float]:
    """Microseconds per step of an environment, of CartPole, and of the first with its info read; the best of
    alternating rounds."""
    timed = []
    for key, read in ((name, False), (BASELINE, False), (name, True)):
        env = gym.make(key)
        env.action_space.seed(0)
        timed.append((env, [env.action_space.sample() for _ in range(steps)], read))
    best = [np.inf] * len(timed)
    for _ in range(rounds):
        best = [min(b, 1e6 * step_seconds(*one)) for b, one in zip(best, timed, strict=True)]
    for env, *_ in timed:
        env.close()
    return best[0], best[1], best[2]


def first_step_seconds(name: str, tries: int = 3) -> float:
    """Seconds from before the imports to after the first step in a new process, the best of a few.

    One process runs first, unmeasured, so that the compiled module is on disk.
    """
    command = [sys.executable, "-c", FIRST_STEP.format(name=name)]
    times = []
    for _ in range(1 + tries):
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        times.append(float(result.stdout.split()[-1]))
    return min(times[1:])


def run(lanes: int = 4096, rounds: int = 10, steps: int = 2000) -> list[dict[str, Any]]:
    """Time the reach environments of all registered arms; one row of ``COLUMNS`` for each."""
    for field, value in (("lanes", lanes), ("rounds", rounds), ("steps", steps)):
        if value < 1:
            raise ValueError(f"{field} is {value}; give a whole number of at least 1")
    rows, about = [], versions()
    with one_core(), counted("environments", len(IDS)) as done:
        for name in IDS:
            rates = vector_rates(name, lanes, rounds)
            lively = vector_rates(name, lanes, rounds, renewed=True)
            fixed = vector_rates(name, lanes, rounds, controlled=False)
            fixed_lively = vector_rates(name, lanes, rounds, controlled=False, renewed=True)
            single, baseline, info_read = single_against_baseline(name, rounds, steps)
            rows.append(
                {
                    **about,
                    "gymnasium": gym.__version__,
                    "env": name,
                    "lanes": lanes,
                    "vector_steps_per_s_best": round(max(rates)),
                    "vector_steps_per_s_median": round(statistics.median(rates)),
                    "vector_renewed_actions_best": round(max(lively)),
                    "vector_one_rk8_step_best": round(max(fixed)),
                    "vector_one_rk8_step_renewed_actions_best": round(max(fixed_lively)),
                    "single_us_per_step": round(single, 2),
                    "cartpole_us_per_step": round(baseline, 2),
                    "single_over_cartpole": round(single / baseline, 2),
                    "import_to_first_step_s": round(first_step_seconds(name), 3),
                    "single_info_read_us_per_step": round(info_read, 2),
                }
            )
            done(f"{name} {max(rates) / 1e6:.2f} million steps/s, single {single:.1f} us")
    return rows
