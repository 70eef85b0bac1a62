"""Evaluate a policy on the frozen goals, beside the expert, and write evaluation.json."""

from __future__ import annotations

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from agents.config import Config
from agents.rollout import EVALUATION_SEED, Outcome, expert_act, policy_act, run_episodes
from agents.statistics import wilson
from agents.train import load_policy

PACKAGES = ("redundant-envs", "gymnasium", "stable-baselines3", "torch", "numpy", "numba")


def versions() -> dict[str, str]:
    """Versions of what the figures depend on, and the machine."""
    found = {"python": platform.python_version(), "machine": processor()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def evaluate(config: Config, folder: Path, facts: dict[str, Any] | None = None) -> dict[str, Any]:
    """Evaluate the policy of a run folder; writes and returns evaluation.json."""
    path = folder / "evaluation.json"
    if facts is None:
        old = json.loads(path.read_text()) if path.is_file() else {}
        facts = {k: old.get(k) for k in ("env_steps", "train_seconds")}
    model = load_policy(folder, config.algo)
    n = config.evaluation_episodes
    policy = run_episodes(config.env, policy_act(model), n, EVALUATION_SEED, **config.env_kwargs)
    expert = run_episodes(config.env, expert_act(), n, EVALUATION_SEED, **config.env_kwargs)
    low, high = wilson(int(policy.hold.sum()), n)
    result = {
        "env": config.env,
        "algo": config.algo,
        "seed": config.seed,
        "episodes": n,
        "hold_success": float(policy.hold.mean()),
        "interval": [low, high],
        "touch_success": float(policy.touch.mean()),
        "expert_hold_success": float(expert.hold.mean()),
        **{k: facts[k] for k in ("env_steps", "train_seconds")},
        "mean_return": float(policy.returns.mean()),
        "expert_mean_return": float(expert.returns.mean()),
        "median_distance": float(np.median(policy.distance)),
        "expert_median_distance": float(np.median(expert.distance)),
        "versions": versions(),
    }
    path.write_text(json.dumps(result, indent=2) + "\n")
    np.savetxt(
        folder / "episodes.csv", episode_table(policy, expert), delimiter=",", comments="",
        header="seed,hold,touch,distance,return,expert_hold,expert_distance",
        fmt=["%d", "%d", "%d", "%.9f", "%.4f", "%d", "%.9f"],
    )  # fmt: skip
    return result


def episode_table(policy: Outcome, expert: Outcome) -> np.ndarray:
    """One row per episode."""
    seeds = EVALUATION_SEED + np.arange(len(policy.hold))
    return np.column_stack(
        [seeds, policy.hold, policy.touch, policy.distance, policy.returns, expert.hold, expert.distance]
    )


def summary(result: dict[str, Any]) -> str:
    """The evaluation in a few sentences."""
    low, high = result["interval"]
    lines = [
        f"{result['algo'].upper()} on {result['env']}, seed {result['seed']}: hold success "
        f"{100 * result['hold_success']:.1f} % of {result['episodes']} episodes "
        f"(95 % interval {100 * low:.1f} to {100 * high:.1f} %), touch "
        f"{100 * result['touch_success']:.1f} %, median final distance "
        f"{1000 * result['median_distance']:.1f} mm.",
        f"Computed-torque expert on the same goals: {100 * result['expert_hold_success']:.1f} %, "
        f"{1000 * result['expert_median_distance']:.1f} mm.",
    ]
    if result["hold_success"] < result["expert_hold_success"]:
        lines.append("The learner loses to the expert.")
    return "\n".join(lines)
