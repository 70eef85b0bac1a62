"""Cost of the modes of actions: time and evaluations of a control step, beside efforts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
from redundant_envs.support.timing import by_turns, seconds
from studies.environments import IDS
from studies.speed import one_core

MODES = "effort", "joint_velocity", "joint_position", "tip_velocity", "tip_and_posture"
STEPS = 12
"""Control steps of a turn, each with new actions."""
WARM = 36
"""Control steps from rest before the first turn."""
COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "lanes", "env", "action", "ns_per_step",
    "times_effort", "evaluations",
)  # fmt: skip


def steps(env: Any) -> Callable[..., float]:
    """A function that makes some steps under random actions, and returns their time, s."""
    rng, shape = np.random.default_rng(0), env.action_space.shape
    env.reset(seed=0)

    def sample(count: int = STEPS) -> float:
        actions = rng.uniform(-1.0, 1.0, (count, *shape)).astype(np.float32)
        return seconds(lambda: [env.step(action) for action in actions])

    sample(WARM)
    return sample


def run(lanes: int = 1024, rounds: int = 16) -> list[dict[str, Any]]:
    """Time the reach environments of all arms in all modes; one row of ``COLUMNS`` for each."""
    rows, about = [], versions()
    with one_core(), counted("modes", len(IDS)) as done:
        for name in IDS:
            redundant = "TwoR" not in name
            modes = MODES if redundant else MODES[:-1]  # an arm of two joints has no posture beside its tip
            envs = {mode: gym.make_vec(name, num_envs=lanes, action=mode) for mode in modes}
            times = by_turns({mode: steps(env) for mode, env in envs.items()}, rounds)
            for mode, env in envs.items():
                *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
                spent = info["evaluations"] / np.maximum(info["episode_steps"], 1)
                best, of_effort = (float(times[m].best) for m in (mode, "effort"))
                rows.append({
                    **about, "lanes": lanes, "env": name, "action": mode,
                    "ns_per_step": round(1e9 * best / (STEPS * lanes)),
                    "times_effort": round(best / of_effort, 2), "evaluations": round(float(spent.mean()), 1),
                })  # fmt: skip
                env.close()
            done(name)
    return rows


def modes_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of :func:`run`, or of its CSV file: a line for each mode, columns for each arm."""
    arms = {"4R": "FourR", "RPRP": "RPRP", "2R": "TwoR"}
    cells = {(r["env"].partition("/")[2].removesuffix("Reach-v0"), r["action"]): r for r in rows}
    shown = ("ns_per_step", "times_effort", "evaluations")
    heads = ("action", *(head for arm in arms for head in (f"{arm}, ns", "ratio to effort", "evaluations")))
    lines = []
    for mode in MODES:
        found = [cells.get((kind, mode)) for kind in arms.values()]
        lines.append((f'`"{mode}"`', *(str(r[c]) if r else "-" for r in found for c in shown)))
    return markdown(heads, lines, formatted=True)
