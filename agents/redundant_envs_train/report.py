"""Pictures, clip and report.md of a run folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.envs.clips import check_clip
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import MissingPackage
from redundant_envs.figures import bare, new_figure, save_figure

from . import command, run_folder
from .config import Config
from .evaluate import evaluate, summary, write_evaluation
from .evidence.curves import draw_curves
from .evidence.runs import group, read_run
from .pages import measures, page
from .play import clip
from .policies import load_policy
from .rollout import EVALUATION_SEED, policy_act

CLIP_EPISODES = 4


def plots(folder: Path, config: Config, result: dict[str, Any], evaluated: Path, out: Path) -> list[Path]:
    """Learning curves and final distances as pictures in ``out``; ``evaluated`` has episodes.csv."""
    episodes = run_folder.read_table(evaluated, "episodes.csv", run_folder.EPISODES)
    target = out / "plots"
    target.mkdir(parents=True, exist_ok=True)
    pictures = [target / "final_distance.png"]
    # an exported policy has no learning curve, and a run that was stopped may have none yet
    run = None if run_folder.is_exported(folder) else read_run(folder, stopped=True, evaluation=result)
    if run is not None and len(run.curve):
        pictures.insert(0, target / "learning_curve.png")
        draw_curves(group([run]), pictures[0])
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
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
    bare(axes)
    save_figure(figure, target / "final_distance.png", dpi=120)
    return pictures


def report(folder: Path, out: Path | None = None, overwrite: bool = False, trust: bool = False) -> Path:
    """Write plots, clips and report.md of a run or an exported policy, and its evaluation if it has none yet.

    All files go to ``out``, without it to the folder itself; ValueError if some would be replaced, or the
    folder of a policy written to, without ``overwrite``. ``trust`` is as in :func:`load_policy`.
    """
    run_folder.check_target(folder, out, overwrite)
    config = run_folder.own_config(folder)
    run_folder.check_drawing()
    out = folder if out is None else out
    clips = [out / "clip.gif", out / "clip.mp4"]
    try:
        check_clip(clips[1])
    except MissingPackage as error:
        print(f"{clips.pop()} is left out: {error}", file=sys.stderr)
    policy = load_policy(folder, config, trust)
    evaluated = folder
    if not all((folder / name).is_file() for name in run_folder.EVALUATED):
        evaluated = out
        write_evaluation(evaluate(folder, trust), out)
    result = run_folder.read_evaluation(evaluated)
    pictures = plots(folder, config, result, evaluated, out)
    clip(clips, config.env, policy_act(policy), CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    target = out / "report.md"
    text = page(
        "report", folder=folder, config=config, result=result, clips=clips, pictures=pictures,
        summary=summary(result), scene=run_folder.difference(folder),
        again=command("train", folder / "config.yaml"),
        measures=measures(result, f"{result['episodes']} frozen goals", config.label),
    )  # fmt: skip
    target.write_text(text, encoding="utf-8")
    return target
