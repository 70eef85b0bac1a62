"""Evaluate a policy on the frozen goals, and compare it with the expert."""

from __future__ import annotations

import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.machine import machine_name

from .config.run import label
from .policies import load_policy
from .rollout import EVALUATION_SEED, Outcome, expert_act, policy_act, run_episodes
from .run_folder import EPISODES, FACTS, own_config, read_facts, write_json
from .statistics import wilson

PACKAGES = ("redundant-envs", "gymnasium", "stable-baselines3", "torch", "numpy", "llvmlite")


def versions() -> dict[str, str]:
    """Versions of the packages on which the figures depend."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


class Evaluation(NamedTuple):
    """The content of evaluation.json, and the rows of episodes.csv."""

    result: dict[str, Any]
    episodes: NDArray[np.float64]


def evaluate(folder: Path, trust: bool = False) -> Evaluation:
    """Evaluate the policy of a folder in the scene that it was trained in; nothing is written.

    ``trust`` is as in :func:`load_policy`.
    """
    config = own_config(folder)
    facts = read_facts(folder)
    model = load_policy(folder, config, trust)
    n = config.evaluation_episodes
    policy = run_episodes(config.env, policy_act(model), n, EVALUATION_SEED, **config.env_kwargs)
    expert = run_episodes(config.env, expert_act(), n, EVALUATION_SEED, **config.env_kwargs)
    low, high = wilson(int(policy.hold.sum()), n)
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    at_goal = policy.distance <= core.task.goal_tolerance * core.reach
    result = {
        **{name: getattr(config, name) for name in ("env", "algo", "seed")},
        "episodes": n,
        "hold_success": float(policy.hold.mean()),
        "interval": [low, high],
        "touch_success": float(policy.touch.mean()),
        "restless": int((at_goal & ~policy.hold).sum()),
        "expert_hold_success": float(expert.hold.mean()),
        "expert_touch_success": float(expert.touch.mean()),
        **{name: facts[name] for name in FACTS},
        "mean_return": float(policy.returns.mean()),
        "expert_mean_return": float(expert.returns.mean()),
        "median_distance": float(np.median(policy.distance)),
        "expert_median_distance": float(np.median(expert.distance)),
        **measures("", policy),
        **measures("expert_", expert),
        "date": time.strftime("%Y-%m-%d"),
        "machine": machine_name(),
        "versions": versions(),
    }
    seeds = EVALUATION_SEED + np.arange(n)
    columns = (
        seeds,
        policy.hold,
        policy.touch,
        policy.distance,
        policy.returns,
        expert.hold,
        expert.distance,
    )
    return Evaluation(result, np.column_stack(columns))


def write_evaluation(found: Evaluation, folder: Path) -> None:
    """Write evaluation.json and episodes.csv into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(
        folder / "episodes.csv", found.episodes, delimiter=",", comments="", header=",".join(EPISODES),
        fmt=["%d", "%d", "%d", "%.9f", "%.4f", "%d", "%.9f"],
    )  # fmt: skip
    write_json(folder / "evaluation.json", found.result)


def measures(who: str, outcome: Outcome) -> dict[str, float | None]:
    """Measures of holding: time (s, median of the held goals), effort and smoothness (means)."""
    times = outcome.time_to_hold[outcome.hold]
    return {
        f"{who}time_to_hold": float(np.median(times)) if len(times) else None,
        f"{who}effort": float(outcome.effort.mean()),
        f"{who}smoothness": float(outcome.smoothness.mean()),
    }


def summary(result: dict[str, Any]) -> str:
    """The evaluation in a few sentences."""
    low, high = result["interval"]
    lines = [
        f"{label(result['algo'])} on {result['env']}, seed {result['seed']}: hold success "
        f"{100 * result['hold_success']:.1f} % of {result['episodes']} episodes (95 % interval "
        f"{100 * low:.1f} to {100 * high:.1f} %), touch {100 * result['touch_success']:.1f} %, median final "
        f"distance {1000 * result['median_distance']:.1f} mm.",
        f"Computed torque on the same goals: {100 * result['expert_hold_success']:.1f} %, "
        f"{1000 * result['expert_median_distance']:.1f} mm.",
    ]
    failed = round((1.0 - result["hold_success"]) * result["episodes"])
    if failed and result.get("restless") is not None:
        lines.append(
            f"Goals it did not hold: {failed}; at {result['restless']} of them the tip was there at the end, "
            "but had not been still for long enough."
        )
    difference = result["hold_success"] - result["expert_hold_success"]
    if difference:
        verb = "loses to" if difference < 0 else "holds more goals than"
        lines.append(f"The learner {verb} computed torque.")
    return "\n".join(lines)
