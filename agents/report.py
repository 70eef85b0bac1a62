"""Pictures, clip and report.md of a run folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import MissingPackage, needs
from redundant_envs.studies.clips import check_clip, write_clip

from . import COMMAND
from .config import Config
from .evaluate import evaluate, summary
from .policies import load_policy
from .rollout import EVALUATION_SEED, Act, policy_act
from .run_folder import EPISODES, SELECTION, read_config, read_evaluation, read_table

CLIP_EPISODES = 4
CLIP_EVERY = 2
"""Control steps from frame to frame."""


def check_drawing() -> None:
    """Refuse, before anything long is begun, where the packages that draw a report are missing."""
    with needs("plot"):
        import matplotlib  # noqa: F401
        import PIL  # noqa: F401
    check_clip(Path("clip.gif"))


def plots(folder: Path, config: Config) -> list[Path]:
    """Learning curve and final distances as pictures."""
    with needs("plot"):
        import matplotlib.pyplot as plt
    plt.switch_backend("Agg")
    curve = read_table(folder, "selection.csv", SELECTION)
    episodes = read_table(folder, "episodes.csv", EPISODES)
    target = folder / "plots"
    target.mkdir(exist_ok=True)
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


def clip(paths: list[Path], env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> None:
    """Whole episodes as clips, one for each path: GIF or MP4 by its ending."""
    for path in paths:
        check_clip(path)
    env = gym.make(env_id, render_mode="rgb_array", **kwargs)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    frames: list[NDArray[np.uint8]] = []
    for episode in range(episodes):
        obs, _ = env.reset(seed=seed + episode)
        done, step = False, 0
        while not done:
            obs, _, terminated, truncated, _ = env.step(act(batched(obs), core, step)[0])
            done = terminated or truncated
            step += 1
            if step % CLIP_EVERY == 0:
                frames.append(np.asarray(env.render()))
    env.close()
    for path in paths:
        write_clip(path, frames, round(1.0 / (CLIP_EVERY * core.scene.control_dt)))


def batched(obs: Any) -> Any:
    """One observation as a batch of one."""
    if isinstance(obs, dict):
        return {k: v[None] for k, v in obs.items()}
    return obs[None]


def table(folders: list[Path]) -> str:
    """Markdown table of evaluated runs, one row per environment and algorithm."""
    results = [read_evaluation(folder) for folder in folders]
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
        touch = float(np.median([r["touch_success"] for r in runs]))
        hold = float(np.median([r["hold_success"] for r in runs]))
        steps, seconds = (
            f"{np.median(known) / size:.{digits}f}{unit}" if known else "unknown"
            for name, size, digits, unit in (("env_steps", 1e6, 2, " M"), ("train_seconds", 1, 0, ""))
            for known in [[r[name] for r in runs if r.get(name) is not None]]
        )
        low, high = worst["interval"]
        lines.append(
            f"| {env.split('/')[-1]} | {algo.upper()} | {len(runs)} "
            f"| {100 * hold:.1f} % ({100 * worst['hold_success']:.1f} %) "
            f"| {100 * low:.1f} to {100 * high:.1f} % | {100 * touch:.1f} % "
            f"| {100 * worst['expert_hold_success']:.1f} % | {steps} | {seconds} |"
        )
    machines = sorted({r["versions"]["machine"] for r in results})
    lines += ["", f"{results[0]['episodes']} frozen goals each. Machine: {', '.join(machines)}."]
    return "\n".join(lines)


def report(folder: Path, trust: bool = False) -> Path:
    """Write plots, clips and report.md of a run, and its evaluation if it has none yet.

    ``trust`` is that of :func:`load_policy`.
    """
    config = read_config(folder)
    check_drawing()
    clips = [folder / "clip.gif", folder / "clip.mp4"]
    try:
        check_clip(clips[1])
    except MissingPackage as error:
        print(f"{clips.pop()} is left out: {error}", file=sys.stderr)
    policy = load_policy(folder, config, trust)
    if not (folder / "evaluation.json").is_file():  # a training that was stopped
        evaluate(config, folder, trust)
    result = read_evaluation(folder)
    pictures = plots(folder, config)
    clip(clips, config.env, policy_act(policy), CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    rows = [(k, v) for k, v in result.items() if k != "versions"]
    rows += [(f"version of {k}", v) for k, v in result["versions"].items()]
    lines = [
        f"# {config.algo.upper()} on {config.env}, seed {config.seed}", "", summary(result), "",
        "![clip](clip.gif)", "", *(f"[{c.name}]({c.name})\n" for c in clips[1:]),
        *(f"![{p.stem}](plots/{p.name})" for p in pictures), "",
        "| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows), "",
        "`config.yaml` is what was run, `scene.py` the whole simulator it ran on, `policy.zip` the "
        "policy (best on the selection goals), `monitor.csv` every training episode, "
        "`selection.csv` the learning curve, `episodes.csv` the evaluation.", "",
        f"Again: `{COMMAND} train {folder}/config.yaml`", "",
    ]  # fmt: skip
    target = folder / "report.md"
    target.write_text("\n".join(lines))
    return target
