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

from . import command
from .config import Config
from .evaluate import evaluate, summary
from .evidence.curves import curves
from .policies import load_policy
from .rollout import EVALUATION_SEED, Act, policy_act
from .run_folder import EPISODES, SELECTION, read_config, read_evaluation, read_table

CLIP_EPISODES = 4
MEASURES = (
    ("hold success", "hold_success", 100.0, 1, " %"),
    ("touch success", "touch_success", 100.0, 1, " %"),
    ("median final distance", "median_distance", 1000.0, 2, " mm"),
    ("median time to hold", "time_to_hold", 1.0, 2, " s"),
    ("effort", "effort", 1.0, 4, ""),
    ("smoothness", "smoothness", 1.0, 4, ""),
    ("mean return", "mean_return", 1.0, 1, ""),
)
"""Lines of the table: name, key, factor, digits, unit."""
CLIP_EVERY = 2
"""Control steps from frame to frame."""


def check_drawing() -> None:
    """Refuse, before anything long is begun, where the packages that draw a report are missing."""
    with needs("plot"):
        import matplotlib  # noqa: F401
        import PIL  # noqa: F401
    check_clip(Path("clip.gif"))


def plots(folder: Path, config: Config) -> list[Path]:
    """Learning curves and final distances as pictures."""
    with needs("plot"):
        import matplotlib.pyplot as plt
    plt.switch_backend("Agg")
    episodes = read_table(folder, "episodes.csv", EPISODES)
    target = folder / "plots"
    target.mkdir(exist_ok=True)
    pictures = [target / "final_distance.png"]
    if len(read_table(folder, "selection.csv", SELECTION)):
        curves([folder], target / "learning_curve.png", stopped=True)
        pictures.insert(0, target / "learning_curve.png")
    figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    for column, label in ((3, config.label), (6, "computed-torque expert")):
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
    return pictures


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
    # A training that was stopped has no evaluation, a published run no table of its episodes.
    if not all((folder / name).is_file() for name in ("evaluation.json", "episodes.csv")):
        evaluate(config, folder, trust)
    result = read_evaluation(folder)
    pictures = plots(folder, config)
    clip(clips, config.env, policy_act(policy), CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    target = folder / "report.md"
    target.write_text(page(folder, config, result, clips, pictures), encoding="utf-8")
    return target


def page(
    folder: Path, config: Config, result: dict[str, Any], clips: list[Path], pictures: list[Path]
) -> str:
    """The text of report.md."""
    learner = config.label
    rows = [
        f"| {name} | {number(result.get(key), scale, digits, unit)} "
        f"| {number(result.get(f'expert_{key}'), scale, digits, unit)} |"
        for name, key, scale, digits, unit in MEASURES
    ]
    origin = [f"{name} {version}" for name, version in result["versions"].items()]
    speed, steps, seconds = "", result["env_steps"], result["train_seconds"]
    if steps is not None and seconds:
        speed = (
            f"{steps / 1e6:.2f} million environment steps in {seconds:.0f} s of training, without "
            f"evaluations: {steps / seconds:,.0f} per second. "
        )
    same = "to the same bits with this machine and these versions"
    if config.max_seconds is not None:
        same = f"for {config.max_seconds:g} s, which are never the same number of steps"
    lines = [
        f"# {learner} on {config.env}, seed {config.seed}", "", summary(result), "",
        "![clip](clip.gif)", "", *(f"[{c.name}]({c.name})\n" for c in clips[1:]),
        *(f"![{p.stem}](plots/{p.name})" for p in pictures), "",
        f"| {result['episodes']} frozen goals | {learner} | computed torque |", "|---|---|---|", *rows, "",
        "Time to hold is the median over the goals that were held; effort is the mean square of the "
        "normalized motor efforts, smoothness their mean change from one control step to the next: less is "
        "better.", "",
        f"{speed}Evaluated on {result['date']}. Machine: {result['machine']}. {', '.join(origin)}.", "",
        "`config.yaml` is what was run, `scene.yaml` what was simulated, `policy.zip` the policy at "
        "the end, which stable-baselines3 loads, `selection.csv` the learning curve (on goals of its "
        "own), `monitor.csv` every training episode, `episodes.csv` the evaluation.", "",
        f"Again, {same}: `{command('train', folder / 'config.yaml')}`", "",
    ]  # fmt: skip
    return "\n".join(lines)


def number(value: float | None, scale: float, digits: int, unit: str) -> str:
    """A rounded number with its unit."""
    return "-" if value is None else f"{scale * value:.{digits}f}{unit}"
