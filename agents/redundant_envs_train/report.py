"""Evaluation of a policy on the frozen goals beside the expert, and the report of a run folder."""

import math
import platform
import time
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs import Numerics, __version__
from redundant_envs.envs.arguments import without_mode
from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.disk import replacing, write_text
from redundant_envs.support.machine import machine_name
from redundant_envs.support.tables import Markdown
from redundant_envs.tasks import Task

from . import command, run_folder
from .config.run import LABELS
from .evidence.curves import draw_curves
from .evidence.outcomes import draw_outcomes
from .evidence.runs import group, read_run
from .pages import page, results_table
from .play import clip
from .policies import load_policy
from .rollout import (
    EVALUATION_SEED,
    EpisodeEnds,
    expert_act,
    expert_name,
    policy_act,
    run_episodes,
    task_of,
)
from .statistics import Statistic, differs, wilson

PACKAGES = ("redundant-envs", "gymnasium", "stable-baselines3", "torch", "numpy", "llvmlite")
CLIP_EPISODES = 4
OF_ACTIONS = ("action", "decide_every")
"""Arguments of an environment without which its episodes are equal, and an action is an effort for a step, as
experts give them."""


class EvaluationResult(NamedTuple):
    """The content of evaluation.json, and the rows of episodes.csv."""

    result: dict[str, Any]
    episodes: NDArray[np.float64]


def evaluate(folder: Path, trust: bool = False) -> EvaluationResult:
    """Evaluate the policy of a folder in its own scene; nothing is written. ``trust``: see load_policy."""
    config = run_folder.own_config(folder)
    facts = run_folder.read_facts(folder)
    model = load_policy(folder, config, trust)
    n = config.evaluation_episodes
    policy = run_episodes(config.env, policy_act(model), n, EVALUATION_SEED, **config.env_kwargs)
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    expert, refusal = None, None
    if core.goal_fields:
        kwargs = with_efforts(config.env_kwargs, core.scene)
        try:
            expert = run_episodes(config.env, expert_act(), n, EVALUATION_SEED, **kwargs)
        except ValueError as error:  # it knows no such scene; the policy is evaluated all the same
            refusal = " ".join(str(error).split())
    missed = np.ones(n, np.bool_) if policy.hold is None else ~policy.hold
    failures = failures_of(core.task, policy, missed)
    for failed in failures.values():
        missed = missed & ~failed
    ended = [Numerics(bits) for bits in policy.faults[missed & policy.ended].tolist()]
    others = {name: version(name) for name in PACKAGES[1:]}
    result = {
        **{name: getattr(config, name) for name in ("env", "algo", "seed")}, "episodes": n,
        "interval": None if policy.hold is None else [*wilson(int(policy.hold.sum()), n)],
        **measures("", policy), **measures("expert_", expert), **reasons(policy, expert, core, missed),
        "failures": {words: int(failed.sum()) for words, failed in failures.items()},
        "stopped": int((missed & policy.ended).sum()),
        "faults": {fault.name: count for fault in Numerics if (count := sum(fault in e for e in ended))},
        "better": {} if expert is None else better(policy, expert, not core.episode.controlled),
        "expert_refusal": refusal,
        # success says more than these, where a task tells it
        "metrics": {} if policy.hold is not None else {k: float(v.mean()) for k, v in policy.metrics.items()},
        **{name: facts[name] for name in ("env_steps", "train_seconds")},
        "date": time.strftime("%Y-%m-%d"), "machine": machine_name(),
        "versions": {"python": platform.python_version(), PACKAGES[0]: __version__, **others},
    }  # fmt: skip
    columns = [policy.hold, policy.touch, policy.distance, policy.returns]
    columns += [None, None] if expert is None else [expert.hold, expert.distance]
    known = [np.full(n, np.nan) if column is None else column for column in columns]
    return EvaluationResult(result, np.column_stack([EVALUATION_SEED + np.arange(n), *known]))


def with_efforts(env_kwargs: Mapping[str, Any], scene: Scene) -> dict[str, Any]:
    """Arguments of an environment with this scene in which the expert acts: by efforts, in every step."""
    kwargs = {name: value for name, value in env_kwargs.items() if name not in OF_ACTIONS}
    return {**kwargs, "scene": without_mode(scene)}


Mask = NDArray[np.bool_]


def failures_of(task: Task, policy: EpisodeEnds, missed: Mask) -> dict[str, Mask]:
    """The missed episodes that failed for a reason that the task tells, by its words: the first counts."""
    failures: dict[str, Mask] = {}
    for label, words in task.failures.items():
        failures[words] = missed & (policy.metrics[label] > 0.0)
        missed = missed & ~failures[words]
    return failures


def reasons(
    policy: EpisodeEnds, expert: EpisodeEnds | None, core: Core, missed: Mask
) -> dict[str, int | None]:
    """Counts of the goals that were missed for no reason that the task tells and without a fault, by what
    happened; None if it is unknown."""
    counts: dict[str, int | None] = dict.fromkeys(("restless", "passed", "missed_by_both"))
    if policy.hold is None:
        return counts
    if expert is not None and expert.hold is not None:
        counts["missed_by_both"] = int((~policy.hold & ~expert.hold).sum())
    near = near_enough(core)
    if policy.touch is not None and policy.distance is not None and near is not None:
        missed, at_goal = missed & ~policy.ended, policy.distance <= near
        counts["restless"] = int((missed & at_goal).sum())
        counts["passed"] = int((missed & policy.touch & ~at_goal).sum())
    return counts


def near_enough(core: Core) -> float | None:
    """Distance up to which the tip is at its goal, m; None if the task has no such number."""
    share = core.task.parameters().get("goal_tolerance")
    return None if share is None else float(share * core.reach)


def write_evaluation(evaluation: EvaluationResult, folder: Path) -> None:
    """Write evaluation.json and episodes.csv into a folder, which is made."""
    with replacing(folder / "episodes.csv") as part:
        np.savetxt(
            part, evaluation.episodes, delimiter=",", comments="",
            header=",".join(run_folder.EPISODES), fmt=["%d", "%g", "%g", "%.9f", "%.4f", "%g", "%.9f"],
        )  # fmt: skip
    run_folder.write_json(folder / "evaluation.json", evaluation.result)


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
OF_EFFORTS = ("effort", "smoothness")
"""Those of the actions."""


def measures(who: str, outcome: EpisodeEnds | None) -> dict[str, float | None]:
    """All measures of an outcome; None for those that are unknown."""
    results: dict[str, float | None] = {}
    for name, (field, statistic, _) in COMPARED.items():
        values = getattr(outcome, field, None)
        value = math.nan if values is None else float(statistic(values, axis=0))
        results[f"{who}{name}"] = None if math.isnan(value) else value
    return results


def better(policy: EpisodeEnds, expert: EpisodeEnds, with_efforts: bool = True) -> dict[str, bool | None]:
    """For each measure that both have, whether the policy is better than the expert at the same goals; None:
    no difference beyond chance. Times are compared by the medians over the goals that each has held, and
    actions only ``with_efforts``: if those of the policy are efforts, too."""
    verdicts: dict[str, bool | None] = {}
    for name, (field, statistic, more) in COMPARED.items():
        if name in OF_EFFORTS and not with_efforts:
            continue
        ours, other = getattr(policy, field), getattr(expert, field)
        if ours is None or other is None or np.isnan([statistic(x, axis=0) for x in (ours, other)]).any():
            continue
        known = differs(ours, other, statistic)
        verdicts[name] = bool((statistic(ours, axis=0) > statistic(other, axis=0)) == more) if known else None
    return verdicts


def table_of(result: Mapping[str, Any]) -> Markdown:
    noun = "episodes" if result["hold_success"] is None else task_of(result["env"]).successes[1]
    return results_table(result, f"{result['episodes']} frozen {noun}", LABELS[result["algo"]])


def summary(result: Mapping[str, Any]) -> str:
    return f"{LABELS[result['algo']]} on {result['env']}, seed {result['seed']}, {verdict(result)}"


def verdict(result: Mapping[str, Any]) -> str:
    """What a policy held or returned, beside the expert, and why it failed: sentences, the first one without
    its subject."""
    if result["hold_success"] is None:
        returned = f"returned {result['mean_return']:.1f} on average over {result['episodes']} episodes"
        texts = [f"{returned}.", untold(result)]
    else:
        (held, goals), n = task_of(result["env"]).successes, result["episodes"]
        low, high = (100 * end for end in result["interval"])
        count = round(result["hold_success"] * n)
        texts = [f"{held} {count} of {n} {goals} (95 % interval {low:.1f} to {high:.1f} %)."]
        if result["expert_hold_success"] is not None:
            texts.append(compared(result))
        if count < n:
            texts.append(misses(result, n - count))
    if refusal := result.get("expert_refusal"):
        expert = expert_name(result["env"])
        texts.append(f"The policy is compared with nothing, since {expert} refuses its scene: {refusal}.")
    return " ".join(texts)


def compared(result: Mapping[str, Any]) -> str:
    """How many goals the expert held, and whether that is more or fewer beyond chance, as a sentence."""
    held, _ = task_of(result["env"]).successes
    ours, other = (round(result[f"{who}hold_success"] * result["episodes"]) for who in ("", "expert_"))
    expert, better = expert_name(result["env"]), result["better"].get("hold_success", ...)
    text = f"{expert[0].upper()}{expert[1:]} {held} {other}"
    if better is ... or ours == other:
        return f"{text}{', too' * (ours == other)}."
    words = {True: ", fewer beyond chance", False: ", more beyond chance", None: "; chance may explain that"}
    return f"{text}{words[better]}."


def untold(result: Mapping[str, Any]) -> str:
    """What a task without success leaves unknown, and the faults, in sentences."""
    text = "The task tells no is_success, so whether an episode succeeded is unknown."
    if result["expert_mean_return"] is None and not result.get("expert_refusal"):
        text += " It has no goal, which computed torque needs: the policy is compared with nothing."
    if result["stopped"]:
        text += f" A fault ended {result['stopped']} of {result['episodes']} episodes ({faults(result)})."
    return text


def faults(result: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}: {count}" for name, count in result["faults"].items())


def misses(result: Mapping[str, Any], missed: int) -> str:
    _, goals = task_of(result["env"]).successes
    head = f"Missed {missed} {goals if missed > 1 else goals.removesuffix('s')}"
    if result["stopped"] is None:  # an evaluation of an older version
        return f"{head}."
    told = {
        "the tip arrived but was still moving": result["restless"],
        "the tip arrived and left": result["passed"],
        f"a fault ended the episode ({faults(result)})": result["stopped"], **result.get("failures", {}),
    }  # fmt: skip
    others = "the time ended before" if result["passed"] is None else "the tip never got there"
    reasons = {**told, others: missed - sum(filter(None, told.values()))}
    causes = [text if count == missed else f"in {count} {text}" for text, count in reasons.items() if count]
    both = result["missed_by_both"]
    expert = expert_name(result["env"])
    more = f" {expert[0].upper()}{expert[1:]} missed {both} of them, too." if both else ""
    return f"{head}: {', '.join(causes)}.{more}"


def report(folder: Path, out: Path | None = None, trust: bool = False) -> Path:
    """Write plots, a clip and report.md of a run or an exported policy, and its evaluation if it has none
    yet, to ``out`` or its own folder; they replace files of their names."""
    config = run_folder.own_config(folder)
    out = folder if out is None else out
    act = policy_act(load_policy(folder, config, trust))
    evaluated = folder
    if not all((folder / name).is_file() for name in run_folder.EVALUATED):
        evaluated = out
        write_evaluation(evaluate(folder, trust), out)
    result = run_folder.read_evaluation(evaluated)
    # an exported policy has no learning curve, and a run that was stopped may have none yet
    run = None if run_folder.is_exported(folder) else read_run(folder, stopped=True, evaluation=result)
    if picture := run is not None and len(run.curve):
        draw_curves(group([run]), out / "plots" / "learning_curve.png", ["steps"])
    core, episodes = make_sb3(config.env, 1, **config.env_kwargs).core, run_folder.read_episodes(evaluated)
    draw_outcomes(result, episodes, near_enough(core), out / "plots" / "evaluation.png")
    clip(out / "clip.gif", config.env, act, CLIP_EPISODES, EVALUATION_SEED, **config.env_kwargs)
    target = out / "report.md"
    text = page(
        "report", folder=folder, config=config, result=result, picture=picture,
        verdict=verdict(result), success=Markdown(core.task.success_note()),
        scene=run_folder.difference(folder), facts=run_folder.read_facts(folder),
        again=command("train", folder / "config.yaml"),
        measures=table_of(result),
    )  # fmt: skip
    write_text(target, text)
    return target
