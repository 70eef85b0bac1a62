"""Evaluation of a policy on the frozen goals beside the expert, and the report of a run folder."""

import math
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
from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.support.disk import replacing, write_text
from redundant_envs.support.extras import MissingPackage
from redundant_envs.support.figures import bare, check_clip, new_figure, save_figure
from redundant_envs.support.machine import machine_name
from redundant_envs.support.tables import Markdown, escaped
from redundant_envs.support.values import say

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
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    expert = None
    if core.goal_fields:
        expert = run_episodes(config.env, expert_act(), n, EVALUATION_SEED, **config.env_kwargs)
    missed = np.ones(n, np.bool_) if policy.hold is None else ~policy.hold
    ended = [Numerics(bits) for bits in policy.faults[missed & policy.ended].tolist()]
    result = {
        **{name: getattr(config, name) for name in ("env", "algo", "seed")}, "episodes": n,
        "interval": None if policy.hold is None else [*wilson(int(policy.hold.sum()), n)],
        **measures("", policy), **measures("expert_", expert), **reasons(policy, expert, core),
        "stopped": int((missed & policy.ended).sum()),
        "faults": {fault.name: count for fault in Numerics if (count := sum(fault in e for e in ended))},
        "better": {} if expert is None else better(policy, expert),
        # success says more than these, where a task tells it
        "metrics": {} if policy.hold is not None else {k: float(v.mean()) for k, v in policy.metrics.items()},
        **{name: facts[name] for name in run_folder.FACTS},
        "date": time.strftime("%Y-%m-%d"), "machine": machine_name(), "versions": versions(),
    }  # fmt: skip
    columns = [policy.hold, policy.touch, policy.distance, policy.returns]
    columns += [None, None] if expert is None else [expert.hold, expert.distance]
    known = [np.full(n, np.nan) if column is None else column for column in columns]
    return Evaluation(result, np.column_stack([EVALUATION_SEED + np.arange(n), *known]))


def reasons(policy: Outcome, expert: Outcome | None, core: Core) -> dict[str, int | None]:
    """Counts of the goals that were missed without a fault, by what happened; None if it is unknown."""
    found: dict[str, int | None] = dict.fromkeys(("restless", "passed", "missed_by_both"))
    if policy.hold is None:
        return found
    if expert is not None and expert.hold is not None:
        found["missed_by_both"] = int((~policy.hold & ~expert.hold).sum())
    tolerance = tolerance_of(core)
    if policy.touch is not None and policy.distance is not None and tolerance is not None:
        missed, at_goal = ~policy.hold & ~policy.ended, policy.distance <= tolerance
        found["restless"] = int((missed & at_goal).sum())
        found["passed"] = int((missed & policy.touch & ~at_goal).sum())
    return found


def tolerance_of(core: Core) -> float | None:
    """Distance up to which the tip is at its goal, m; None if the task has none."""
    share = core.task.parameters().get("goal_tolerance")
    return None if share is None else share * core.reach


def write_evaluation(found: Evaluation, folder: Path) -> None:
    """Write evaluation.json and episodes.csv into a folder, which is made."""
    with replacing(folder / "episodes.csv") as part:
        np.savetxt(
            part, found.episodes, delimiter=",", comments="",
            header=",".join(run_folder.EPISODES), fmt=["%d", "%g", "%g", "%.9f", "%.4f", "%g", "%.9f"],
        )  # fmt: skip
    run_folder.write_json(folder / "evaluation.json", found.result)


def held_median(times: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Median over the goals that were held, whose times are numbers; NaN if there are none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(times, axis=axis))


COMPARED: dict[str, tuple[str, Statistic, bool]] = {
    "hold_success": ("hold", np.mean, True), "touch_success": ("touch", np.mean, True),
    "median_distance": ("distance", np.median, False), "time_to_hold": ("time_to_hold", held_median, False),
    "effort": ("effort", np.mean, False), "smoothness": ("smoothness", np.mean, False),
    "mean_return": ("returns", np.mean, True),
}  # fmt: skip
"""Measures of an evaluation: the field of an outcome, its statistic, and whether more is better."""


def measures(who: str, outcome: Outcome | None) -> dict[str, float | None]:
    """All measures of an outcome; None for those that are unknown."""
    found: dict[str, float | None] = {}
    for name, (field, statistic, _) in COMPARED.items():
        values = getattr(outcome, field, None)
        value = math.nan if values is None else float(statistic(values, axis=0))
        found[f"{who}{name}"] = None if math.isnan(value) else value
    return found


def better(policy: Outcome, expert: Outcome) -> dict[str, bool | None]:
    """For each measure that both have, whether the policy is better than the expert at the same goals; None:
    no difference beyond chance. Times are compared by the medians over the goals that each has held."""
    found: dict[str, bool | None] = {}
    for name, (field, statistic, more) in COMPARED.items():
        own, other = getattr(policy, field), getattr(expert, field)
        if own is None or other is None or np.isnan([statistic(x, axis=0) for x in (own, other)]).any():
            continue
        known = differs(own, other, statistic)
        found[name] = bool((statistic(own, axis=0) > statistic(other, axis=0)) == more) if known else None
    return found


def summary(result: dict[str, Any]) -> str:
    """The evaluation in a few sentences."""
    if result["hold_success"] is not None:
        low, high = (100 * end for end in result["interval"])
        held = f"hold success {100 * result['hold_success']:.1f} % of {result['episodes']} episodes"
        parts = [f"{held} (95 % interval {low:.1f} to {high:.1f} %)"]
    else:
        parts = [f"mean return {result['mean_return']:.1f} over {result['episodes']} episodes"]
        parts += [f"{name} {value:.3g} at their end" for name, value in result.get("metrics", {}).items()]
    if result["touch_success"] is not None:
        parts.append(f"touch {100 * result['touch_success']:.1f} %")
    if result["median_distance"] is not None:
        parts.append(f"median final distance {1000 * result['median_distance']:.1f} mm")
    who = f"{label(result['algo'])} on {result['env']}, seed {result['seed']}"
    lines = [f"{who}: {', '.join(parts)}."]
    others = [
        f"{scale * result[f'expert_{name}']:.1f} {unit}"
        for name, scale, unit in (("hold_success", 100, "%"), ("median_distance", 1000, "mm"))
        if result[f"expert_{name}"] is not None
    ]
    if others:
        lines.append(f"Computed torque on the same goals: {', '.join(others)}.")
    if result.get("better"):
        lines.append(comparison(result["better"]))
    if result["hold_success"] is None:
        lines.append(untold(result))
    elif missed := round((1.0 - result["hold_success"]) * result["episodes"]):
        lines.append(misses(result, missed))
    return "\n".join(lines)


def untold(result: Mapping[str, Any]) -> str:
    """What a task without success leaves unknown, and the faults, in sentences."""
    text = "The task tells no is_success, so whether an episode succeeded is unknown."
    if result["expert_mean_return"] is None:
        text += " It has no goal, which computed torque needs: the policy is compared with nothing."
    if result["stopped"]:
        faults = ", ".join(f"{name}: {count}" for name, count in result["faults"].items())
        text += f" A fault ended {result['stopped']} of {result['episodes']} episodes ({faults})."
    return text


def comparison(better: Mapping[str, bool | None]) -> str:
    """Which measures are better or worse than those of computed torque, in a sentence."""
    words = {True: "better in", False: "worse in", None: "no difference beyond chance in"}
    found = [(label, better[key]) for label, key, *_ in MEASURES if key in better]
    names = {how: [label for label, known in found if known is how] for how in words}
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
    pictures = []
    # an exported policy has no learning curve, and a run that was stopped may have none yet
    run = None if run_folder.is_exported(folder) else read_run(folder, stopped=True, evaluation=result)
    if run is not None and len(run.curve):
        pictures.append(target / "learning_curve.png")
        draw_curves(group([run]), pictures[0])
    if result["median_distance"] is not None:
        pictures.append(target / "final_distance.png")
        draw_distances(config, episodes, pictures[-1])
    return pictures


def draw_distances(config: Config, episodes: NDArray[np.float64], path: Path) -> None:
    """The shares of episodes that end as near to the goal as a distance."""
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
    lines = ((3, config.label, color_of(config.label), "-"), (6, "computed torque", EXPERT_COLOR, "--"))
    for column, who, color, style in lines:
        if np.isnan(episodes[:, column]).any():
            continue
        distance = np.sort(1000 * episodes[:, column])
        share = 100 * np.arange(1, len(distance) + 1) / len(distance)
        axes.plot(distance, share, style, color=color, label=who)
    axes.set(xscale="log", xlabel="final distance of the tip from the goal, mm")
    axes.set_ylabel("share of episodes that end as near, %")
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    if (tolerance := tolerance_of(core)) is not None:
        axes.axvline(1000 * tolerance, color="0.6", linewidth=1, linestyle=":", label="goal tolerance")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    bare(axes)
    save_figure(figure, path, dpi=120)


def report(folder: Path, out: Path | None = None, trust: bool = False) -> Path:
    """Write plots, clips and report.md of a run or an exported policy, and its evaluation if it has none yet,
    to ``out`` or its own folder; they replace files of their names."""
    config = run_folder.own_config(folder)
    out = folder if out is None else out
    clips = [out / "clip.gif", out / "clip.mp4"]
    try:
        check_clip(clips[1])
    except MissingPackage as error:
        say(f"{clips.pop()} is left out: {error}", file=sys.stderr)
    policy = load_policy(folder, config, trust)
    evaluated = folder
    if not all((folder / name).is_file() for name in run_folder.EVALUATED):
        evaluated = out
        write_evaluation(evaluate(folder, trust), out)
    result = run_folder.UNKNOWN | run_folder.read_evaluation(evaluated)
    pictures = plots(folder, config, result, evaluated, out)
    clip(clips, config.env, policy_act(policy), CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    target = out / "report.md"
    noun = "episodes" if result["hold_success"] is None else "goals"
    text = page(
        "report", folder=folder, config=config, result=result, clips=clips, pictures=pictures,
        summary=Markdown("\n".join(map(escaped, summary(result).splitlines()))),
        scene=run_folder.difference(folder),
        again=command("train", folder / "config.yaml"),
        measures=results_table(result, f"{result['episodes']} frozen {noun}", config.label),
    )  # fmt: skip
    write_text(target, text)
    return target
