"""Evaluation of a policy on the frozen goals beside the expert, and the report of a run folder."""

import platform
import sys
import time
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs import Numerics, __version__
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import MissingPackage
from redundant_envs.figures import bare, check_clip, new_figure, save_figure
from redundant_envs.machine import machine_name

from . import command, run_folder
from .config import Config
from .config.run import label
from .evidence.curves import EXPERT_COLOR, color_of, draw_curves
from .evidence.runs import group, read_run
from .pages import MEASURES, page, results_table
from .play import clip
from .policies import load_policy
from .rollout import EVALUATION_SEED, Outcome, expert_act, policy_act, run_episodes
from .statistics import Statistic, differs, wilson

PACKAGES = ("redundant-envs", "gymnasium", "stable-baselines3", "torch", "numpy", "llvmlite")
CLIP_EPISODES = 4


def versions() -> dict[str, str]:
    """Versions of the packages on which the figures depend."""
    others = {name: version(name) for name in PACKAGES[1:]}
    return {"python": platform.python_version(), PACKAGES[0]: __version__, **others}


class Evaluation(NamedTuple):
    """The content of evaluation.json, and the rows of episodes.csv."""

    result: dict[str, Any]
    episodes: NDArray[np.float64]


def evaluate(folder: Path, trust: bool = False) -> Evaluation:
    """Evaluate the policy of a folder in its own scene; nothing is written. ``trust``: see load_policy."""
    config = run_folder.own_config(folder)
    facts = run_folder.read_facts(folder)
    model = load_policy(folder, config, trust)
    n = config.evaluation_episodes
    policy = run_episodes(config.env, policy_act(model), n, EVALUATION_SEED, **config.env_kwargs)
    expert = run_episodes(config.env, expert_act(), n, EVALUATION_SEED, **config.env_kwargs)
    low, high = wilson(int(policy.hold.sum()), n)
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    at_goal = policy.distance <= core.task.goal_tolerance * core.reach
    missed = ~policy.hold & ~policy.ended
    ended = [Numerics(bits) for bits in policy.faults[~policy.hold & policy.ended].tolist()]
    result = {
        **{name: getattr(config, name) for name in ("env", "algo", "seed")}, "episodes": n,
        "hold_success": float(policy.hold.mean()), "interval": [low, high],
        "touch_success": float(policy.touch.mean()), "restless": int((missed & at_goal).sum()),
        "passed": int((missed & policy.touch & ~at_goal).sum()),
        "stopped": int((~policy.hold & policy.ended).sum()),
        "missed_by_both": int((~policy.hold & ~expert.hold).sum()),
        "faults": {fault.name: count for fault in Numerics if (count := sum(fault in e for e in ended))},
        "better": better(policy, expert),
        "expert_hold_success": float(expert.hold.mean()), "expert_touch_success": float(expert.touch.mean()),
        **{name: facts[name] for name in run_folder.FACTS},
        "mean_return": float(policy.returns.mean()), "expert_mean_return": float(expert.returns.mean()),
        "median_distance": float(np.median(policy.distance)),
        "expert_median_distance": float(np.median(expert.distance)),
        **measures("", policy), **measures("expert_", expert),
        "date": time.strftime("%Y-%m-%d"), "machine": machine_name(), "versions": versions(),
    }  # fmt: skip
    own = (EVALUATION_SEED + np.arange(n), policy.hold, policy.touch, policy.distance, policy.returns)
    return Evaluation(result, np.column_stack([*own, expert.hold, expert.distance]))


def write_evaluation(found: Evaluation, folder: Path) -> None:
    """Write evaluation.json and episodes.csv into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(
        folder / "episodes.csv", found.episodes, delimiter=",", comments="",
        header=",".join(run_folder.EPISODES), fmt=["%d", "%d", "%d", "%.9f", "%.4f", "%d", "%.9f"],
    )  # fmt: skip
    run_folder.write_json(folder / "evaluation.json", found.result)


def measures(who: str, outcome: Outcome) -> dict[str, float | None]:
    """Measures of holding: time (s, median of the held goals), effort and smoothness (means)."""
    times = outcome.time_to_hold[outcome.hold]
    return {
        f"{who}time_to_hold": float(np.median(times)) if len(times) else None,
        f"{who}effort": float(outcome.effort.mean()),
        f"{who}smoothness": float(outcome.smoothness.mean()),
    }


def better(policy: Outcome, expert: Outcome) -> dict[str, bool | None]:
    """For each measure, whether the policy is better than the expert at the same goals; None: no difference
    beyond chance. Times are compared by the medians over the goals that each has held."""
    compared: dict[str, tuple[str, Statistic, bool]] = {
        "hold_success": ("hold", np.mean, True), "touch_success": ("touch", np.mean, True),
        "median_distance": ("distance", np.median, False),
        "time_to_hold": ("time_to_hold", held_median, False), "effort": ("effort", np.mean, False),
        "smoothness": ("smoothness", np.mean, False),
        "mean_return": ("returns", np.mean, True),
    }  # fmt: skip
    found: dict[str, bool | None] = {}
    for name, (field, statistic, more) in compared.items():
        own, other = getattr(policy, field), getattr(expert, field)
        known = differs(own, other, statistic)
        found[name] = bool((statistic(own, axis=0) > statistic(other, axis=0)) == more) if known else None
    return found


def held_median(times: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Median over the goals that were held, whose times are numbers; NaN if there are none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(times, axis=axis))


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
    if result.get("better"):
        lines.append(comparison(result["better"]))
    if missed := round((1.0 - result["hold_success"]) * result["episodes"]):
        lines.append(misses(result, missed))
    return "\n".join(lines)


def comparison(better: Mapping[str, bool | None]) -> str:
    """Which measures are better or worse than those of computed torque, in a sentence."""
    words = {True: "better in", False: "worse in", None: "no difference beyond chance in"}
    names = {how: [label for label, key, *_ in MEASURES if better.get(key) is how] for how in words}
    parts = [f"{words[how]} {', '.join(labels)}" for how, labels in names.items() if labels]
    return f"Against computed torque on the same goals (95 %): {'; '.join(parts)}."


def misses(result: Mapping[str, Any], missed: int) -> str:
    """Why goals were missed, in a sentence."""
    head = f"Missed {missed} goal{'s' * (missed > 1)}"
    known = [result[name] for name in ("restless", "passed", "stopped") if result.get(name) is not None]
    if len(known) < 3:  # an evaluation of an older version
        return f"{head}."
    faults = ", ".join(f"{name}: {count}" for name, count in result.get("faults", {}).items())
    reasons = {
        "the tip arrived but was still moving": known[0], "the tip arrived and left": known[1],
        "the tip never got there": missed - sum(known), f"a fault ended the episode ({faults})": known[2],
    }  # fmt: skip
    found = [text if count == missed else f"in {count} {text}" for text, count in reasons.items() if count]
    both = result.get("missed_by_both")
    more = f" Computed torque missed {both} of them, too." if both else ""
    return f"{head}: {', '.join(found)}.{more}"


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
    lines = ((3, config.label, color_of(config.label), "-"), (6, "computed torque", EXPERT_COLOR, "--"))
    for column, who, color, style in lines:
        distance = np.sort(1000 * episodes[:, column])
        share = 100 * np.arange(1, len(distance) + 1) / len(distance)
        axes.plot(distance, share, style, color=color, label=who)
    axes.set(
        xscale="log", xlabel="final distance of the tip from the goal, mm",
        ylabel="share of episodes that end as near, %",
    )  # fmt: skip
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    tolerance = 1000 * core.task.goal_tolerance * core.reach
    axes.axvline(tolerance, color="0.6", linewidth=1, linestyle=":", label="goal tolerance")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    bare(axes)
    save_figure(figure, target / "final_distance.png", dpi=120)
    return pictures


def report(folder: Path, out: Path | None = None, trust: bool = False) -> Path:
    """Write plots, clips and report.md of a run or an exported policy, and its evaluation if it has none yet.

    All files go to ``out``, without it to the folder itself, and replace those of their names. ``trust`` is
    as in :func:`load_policy`.
    """
    config = run_folder.own_config(folder)
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
        measures=results_table(result, f"{result['episodes']} frozen goals", config.label),
    )  # fmt: skip
    target.write_text(text, encoding="utf-8")
    return target
