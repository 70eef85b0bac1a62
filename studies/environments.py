"""Speed of the environments: vector steps per second, one step of a single one, and import to first step."""

from __future__ import annotations

import functools
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from redundant_envs.envs.registration import NAMESPACE, SCENES, full_id, ids, listed
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
from redundant_envs.support.timing import Times, by_turns, seconds
from redundant_envs.support.values import shown
from studies.speed import one_core

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "gymnasium", "env", "lanes",
    "vector_steps_per_s_best", "vector_steps_per_s_median", "vector_renewed_actions_best",
    "vector_one_rk8_step_best", "vector_one_rk8_step_renewed_actions_best", "single_us_per_step",
    "cartpole_us_per_step", "single_over_cartpole", "import_to_first_step_s", "single_info_read_us_per_step",
)  # fmt: skip
BASELINE = "CartPole-v1"
KINDS, REACH = tuple(SCENES), "Reach-v0"
IDS = tuple(f"{NAMESPACE}/{arm}{REACH}" for arm in KINDS)
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


VECTORS = {
    "controlled": (True, False), "renewed": (True, True),
    "one step": (False, False), "one step, renewed": (False, True),
}  # fmt: skip
"""How vectors are timed: with error control or not, with renewed actions or not."""
FIRST_STEPS = 3
"""Processes whose first step is timed."""


def vector_episode(env: Any, renewed: bool) -> Callable[[], float]:
    """A function that times a step of a vector environment, s, over an episode and its reset. Each keeps a
    random action, or has ``renewed`` ones: sliders of RPRP then reach and leave their stops more often."""
    count = env.spec.max_episode_steps + 1
    tables = count if renewed else 1
    shape = (tables, *np.shape(env.action_space.sample()))
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    env.reset(seed=0)
    env.step(drawn[0])

    def steps() -> None:
        for k in range(count):
            env.step(drawn[k % tables])

    return lambda: seconds(steps) / count


def single_steps(env: gym.Env[Any, Any], count: int, read: bool = False) -> Callable[[], float]:
    """A function that times a step of an environment without resets, s, and with ``read`` the reading of its
    info."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(count)]

    def sample() -> float:
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
        return (spent + time.process_time() - start) / count

    return sample


def first_step_seconds(name: str) -> float:
    """Seconds from before the imports to after the first step in a new process."""
    command = [sys.executable, "-c", FIRST_STEP.format(name=name)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(result.stdout.split()[-1])


def times_of(name: str, lanes: int, rounds: int, steps: int) -> dict[str, Times]:
    """Times of an environment and of CartPole, by turns."""
    env: Any = gym.make(name)
    scene = env.unwrapped.scene.to_dict()
    vectors: dict[str, Any] = {}
    for how, (controlled, _) in VECTORS.items():
        variant = scene if controlled else {**scene, "tolerance": None}  # one rk8 step for every control step
        vectors[how] = gym.make_vec(name, num_envs=lanes, scene=variant)
    samplers = {how: vector_episode(env, VECTORS[how][1]) for how, env in vectors.items()}
    names = {"single": name, "baseline": BASELINE, "read": name}
    singles: dict[str, Any] = {how: gym.make(one) for how, one in names.items()}
    samplers |= {how: single_steps(env, steps, how == "read") for how, env in singles.items()}
    first_step_seconds(name)  # puts the compiled module on disk
    samplers["first"] = functools.partial(first_step_seconds, name)
    times = by_turns(samplers, rounds, {"first": FIRST_STEPS})
    for env in (*vectors.values(), *singles.values()):
        env.close()
    return times


def run(
    names: Sequence[str] = IDS, lanes: int = 4096, rounds: int = 10, steps: int = 2000
) -> list[dict[str, Any]]:
    """Time environments, by default the reach environments of all arms; one row of ``COLUMNS`` for each."""
    names = [*map(full_id, names)]
    for name in names:
        if name not in ids():
            raise ValueError(f"the id is {shown(name)}; choose {listed()}")
    rows, about = [], versions()
    with one_core(), counted("environments", len(names)) as done:
        for name in names:
            times = times_of(name, lanes, rounds, steps)
            best = {how: float(of.best) for how, of in times.items()}
            rate = {how: round(lanes / best[how]) for how in VECTORS}
            rows.append({
                **about, "gymnasium": gym.__version__, "env": name, "lanes": lanes,
                "vector_steps_per_s_best": rate["controlled"],
                "vector_steps_per_s_median": round(lanes / float(times["controlled"].median)),
                "vector_renewed_actions_best": rate["renewed"], "vector_one_rk8_step_best": rate["one step"],
                "vector_one_rk8_step_renewed_actions_best": rate["one step, renewed"],
                "single_us_per_step": round(1e6 * best["single"], 2),
                "cartpole_us_per_step": round(1e6 * best["baseline"], 2),
                "single_over_cartpole": round(best["single"] / best["baseline"], 2),
                "import_to_first_step_s": round(best["first"], 3),
                "single_info_read_us_per_step": round(1e6 * best["read"], 2),
            })  # fmt: skip
            spread = 100 * times["controlled"].spread
            done(f"{name} {rate['controlled'] / 1e6:.2f} million steps/s, spread {spread:.0f} %")
    return rows


def tasks_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of :func:`run`, or of its CSV file, for tasks of all arms beside Reach: a line for each task, with
    the rate of each arm and its ratio to that of Reach."""
    rates = {row["env"]: float(row["vector_steps_per_s_best"]) for row in rows}
    tasks = dict.fromkeys(name.partition(KINDS[0])[2] for name in rates if KINDS[0] in name)
    lines = []
    for task in tasks:
        cells = []
        for arm in KINDS:
            rate, of_reach = (rates[f"{NAMESPACE}/{arm}{end}"] for end in (task, REACH))
            cells += [f"{rate / 1e6:.2f} M/s", f"{rate / of_reach:.2f}"]
        lines.append((f"`{task.removesuffix('-v0')}`", *cells))
    heads = (head for arm in KINDS for head in (arm, "ratio to Reach"))
    return markdown(("task", *heads), lines, formatted=True)
