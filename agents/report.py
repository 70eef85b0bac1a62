"""Pictures, clip and report.md of a run folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio.v2 as imageio
import matplotlib
import numpy as np

from agents.config import Config, build
from agents.evaluate import summary
from agents.rollout import EVALUATION_SEED, Act, policy_act
from agents.train import load_policy
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.files import explained, read_yaml

matplotlib.use("Agg")
CLIP_EPISODES = 4


def read_config(folder: Path) -> Config:
    """The configuration of a run folder."""
    path = folder / "config.yaml"
    if not path.is_file():
        raise ValueError(f"run folder {folder} has no config.yaml; give a folder that train wrote")
    data = read_yaml(path, "config")
    with explained(path):
        config: Config = build(Config, data, "")
    return config


def plots(folder: Path, config: Config) -> list[Path]:
    """Learning curve and final distances as pictures."""
    import matplotlib.pyplot as plt

    target = folder / "plots"
    target.mkdir(exist_ok=True)
    curve = np.loadtxt(folder / "selection.csv", delimiter=",", skiprows=1, ndmin=2)
    episodes = np.loadtxt(folder / "episodes.csv", delimiter=",", skiprows=1, ndmin=2)
    figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    axes.plot(curve[:, 1], 100 * curve[:, 2], marker="o", markersize=3)
    axes.axhline(98, color="0.7", linewidth=1, linestyle="--")
    axes.set(xlabel="training time, s", ylabel="hold success on selection goals, %", ylim=(0, 101))
    if len(curve) > 1:
        seconds, steps = curve[:, 1], curve[:, 0] / 1e6
        top = axes.secondary_xaxis(
            "top",
            functions=(
                lambda t: np.interp(np.asarray(t, float), seconds, steps),
                lambda s: np.interp(np.asarray(s, float), steps, seconds),
            ),
        )
        top.set_xlabel("environment steps, millions")
    figure.savefig(target / "learning_curve.png", dpi=120)
    plt.close(figure)

    figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    for column, label in ((3, config.algo.upper()), (6, "computed-torque expert")):
        distance = np.sort(1000 * episodes[:, column])
        axes.plot(distance, 100 * np.arange(1, len(distance) + 1) / len(distance), label=label)
    axes.set(
        xscale="log", xlabel="final distance of the tip from the goal, mm", ylabel="share of episodes, %"
    )
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    tolerance = 1000 * core.task.goal_tolerance * core.reach
    axes.axvline(tolerance, color="0.7", linewidth=1, linestyle="--")
    axes.text(tolerance, 2, " goal tolerance", color="0.4", fontsize=8)
    axes.legend(loc="center left")
    figure.savefig(target / "final_distance.png", dpi=120)
    plt.close(figure)
    return [target / "learning_curve.png", target / "final_distance.png"]


def clip(path: Path, env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> None:
    """A GIF of whole episodes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    env = gym.make(env_id, render_mode="rgb_array", **kwargs)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    frames = []
    for episode in range(episodes):
        obs, _ = env.reset(seed=seed + episode)
        done, step = False, 0
        while not done:
            obs, _, terminated, truncated, _ = env.step(act(batched(obs), core, step)[0])
            done = terminated or truncated
            step += 1
            if step % 2 == 0:
                frames.append(np.asarray(env.render()))
    env.close()
    imageio.mimsave(path, frames, duration=40, loop=0, palettesize=64)  # type: ignore[arg-type]


def batched(obs: Any) -> Any:
    """One observation as a batch of one."""
    if isinstance(obs, dict):
        return {k: v[None] for k, v in obs.items()}
    return obs[None]


def table(folders: list[Path]) -> str:
    """Markdown table of evaluated runs, one row per environment and algorithm."""
    results = []
    for folder in folders:
        path = folder / "evaluation.json"
        if not path.is_file():
            raise ValueError(f"run folder {folder} has no evaluation.json; evaluate it first")
        results.append(json.loads(path.read_text()))
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for result in results:
        groups.setdefault((result["env"], result["algo"]), []).append(result)
    lines = [
        "| environment | learner | seeds | hold success, median (worst) | 95 % interval, worst seed "
        "| touch, median | expert, hold | steps | train seconds, median |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for (env, algo), runs in sorted(groups.items()):
        runs.sort(key=lambda r: r["hold_success"])
        worst = runs[0]
        median = {k: float(np.median([r[k] for r in runs])) for k in
                  ("hold_success", "touch_success", "train_seconds", "env_steps")}  # fmt: skip
        low, high = worst["interval"]
        lines.append(
            f"| {env.split('/')[-1]} | {algo.upper()} | {len(runs)} "
            f"| {100 * median['hold_success']:.1f} % ({100 * worst['hold_success']:.1f} %) "
            f"| {100 * low:.1f} to {100 * high:.1f} % | {100 * median['touch_success']:.1f} % "
            f"| {100 * worst['expert_hold_success']:.1f} % | {median['env_steps'] / 1e6:.2f} M "
            f"| {median['train_seconds']:.0f} |"
        )
    machines = sorted({r["versions"]["machine"] for r in results})
    lines += ["", f"{results[0]['episodes']} frozen goals each. Machine: {', '.join(machines)}."]
    return "\n".join(lines)


def report(folder: Path) -> Path:
    """Write plots, clip and report.md of an evaluated run."""
    config = read_config(folder)
    path = folder / "evaluation.json"
    if not path.is_file():
        raise ValueError(
            f"run folder {folder} has no evaluation.json; run: python -m agents evaluate {folder}"
        )
    result = json.loads(path.read_text())
    pictures = plots(folder, config)
    act = policy_act(load_policy(folder, config.algo))
    clip(folder / "clip.gif", config.env, act, CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    rows = [(k, v) for k, v in result.items() if k != "versions"]
    rows += [(f"version of {k}", v) for k, v in result["versions"].items()]
    lines = [
        f"# {config.algo.upper()} on {config.env}, seed {config.seed}", "", summary(result), "",
        "![clip](clip.gif)", "", *(f"![{p.stem}](plots/{p.name})" for p in pictures), "",
        "| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows), "",
        "`config.yaml` is what was run, `scene.py` the whole simulator it ran on, `policy.zip` the "
        "policy (best on the selection goals), `monitor.csv` every training episode, "
        "`selection.csv` the learning curve, `episodes.csv` the evaluation.", "",
        f"Again: `python -m agents train {folder}/config.yaml`", "",
    ]  # fmt: skip
    target = folder / "report.md"
    target.write_text("\n".join(lines))
    return target
