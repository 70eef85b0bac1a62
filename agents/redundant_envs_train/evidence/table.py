"""Results of many runs as Markdown tables."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from redundant_envs.support.tables import markdown

from ..statistics import CHANCE, MIN_RUNS, interquartile_mean, run_interval, sign_test
from .runs import Group, read_groups

MEASURES = ("time_to_hold", "effort", "smoothness")
"""Compared with the expert of the task, whose entries have the prefix "expert_"."""
COMPARISON = (
    "environment", "learner", "time to hold, s", "... of the expert", "effort",
    "... of the expert", "smoothness", "... of the expert", "machine",
)  # fmt: skip
UNKNOWN = "-"


def results_table(places: Iterable[str | Path]) -> str:
    """Results of runs as two Markdown tables, a row for each group, and the notes needed to judge them."""
    from ..pages import page  # imports Jinja2

    groups, comparison, untold = read_groups(places), [], []
    for same in groups:
        numbers = [_number(same.numbers(f"{who}{name}")) for name in MEASURES for who in ("", "expert_")]
        comparison.append([same.title, same.learner, *numbers, _told([same], "machine")])
        if not same.numbers("hold_success"):
            mean = f"the mean return of {same.learner} is {_number(same.numbers('mean_return'))}."
            untold.append(f"The task of {same.title} tells no success: {mean}")
    rows, compared = [*map(results_of, groups)], markdown(COMPARISON, comparison)
    results = markdown([*rows[0]], [row.values() for row in rows])
    facts = {"least": MIN_RUNS, "untold": untold, "origin": _origin(groups)}
    return page("table", results=results, comparison=compared, **facts).rstrip("\n")


def results_of(same: Group) -> dict[str, str]:
    """A row of the first table, by its columns."""
    hold, steps = same.numbers("hold_success"), same.numbers("env_steps")
    low, high = map(float, run_interval(hold)) if hold else (math.nan, math.nan)
    middle = _percent(same, [float(interquartile_mean(hold))] if hold else [])
    interval = "unknown" if np.isnan(low) else f"{_percent(same, [low], '')} to {_percent(same, [high], '')}"
    taken = _number(steps, 1e-6)
    if steps and max(steps) > 1.01 * min(steps):
        taken = f"{_number([min(steps)], 1e-6)} to {_number([max(steps)], 1e-6)}"
    pairs = ([run.evaluation.get(name) for name in ("env_steps", "train_seconds")] for run in same.runs)
    speeds = [steps / seconds for steps, seconds in pairs if steps is not None and seconds]
    return {
        "environment": same.title, "learner": same.learner, "seeds": str(len(same.runs)),
        "hold, median": _percent(same, hold), "hold, worst seed": _percent(same, hold and [min(hold)]),
        "hold, IQM [95 % interval]": f"{middle} [{interval}]" if len(hold) > 1 else UNKNOWN,
        "hold of the expert": _percent(same, same.numbers("expert_hold_success")),
        "hold compared": _holds_more(same), "touch, median": _percent(same, same.numbers("touch_success")),
        "steps, millions": taken, "training, s": _number(same.numbers("train_seconds")),
        "steps per s": _number(speeds),
    }  # fmt: skip


def _holds_more(same: Group) -> str:
    """Which holds more goals of all seeds beyond chance; if it is the learner, in how many seeds it does not.
    The goals that only one of the two missed are unknown, and at most those that it missed."""
    hold, expert = (np.asarray(same.numbers(name)) for name in ("hold_success", "expert_hold_success"))
    if not (len(hold) and len(expert)):
        return UNKNOWN
    episodes = same.runs[0].evaluation["episodes"]
    missed, others = (round(float((1.0 - rates).sum()) * episodes) for rates in (hold, expert))
    if sign_test(missed, others) >= CHANCE:
        return "no difference beyond chance"
    if missed > others:
        return "the expert holds more"
    lost = int((hold < expert).sum())
    more = f" (the expert holds more in {lost} of {len(hold)} seeds)" if lost else ""
    return f"the learner holds more{more}"


def _origin(groups: Sequence[Group]) -> str:
    dates = sorted(run.evaluation["date"][:10] for same in groups for run in same.runs)
    days = f"on {dates[0]}" if dates[0] == dates[-1] else f"from {dates[0]} to {dates[-1]}"
    labels = {"episodes": "Goals of each seed", "machine": "Machine", "torch": "torch",
              "stable-baselines3": "stable-baselines3"}  # fmt: skip
    sentences = [f"{label}: {_told(groups, name)}." for name, label in labels.items()]
    return " ".join([*sentences, f"Evaluated {days}."])


def _told(groups: Iterable[Group], name: str) -> str:
    """What the evaluations of runs say as this entry, or as the version of this package."""
    evaluations = [{**run.evaluation["versions"], **run.evaluation} for same in groups for run in same.runs]
    return "; ".join(sorted({str(entries.get(name, UNKNOWN)) for entries in evaluations}))


def _percent(same: Group, rates: Sequence[float], unit: str = " %") -> str:
    """The median rate in percent, as exact as one goal; below 1 it is never rounded up to 100 %."""
    if not rates:
        return UNKNOWN
    digits = max(1, len(str(same.runs[0].evaluation["episodes"])) - 3)  # a goal of a thousand is 0.1 %
    rate = float(np.median(rates))
    largest = 100.0 if rate >= 1.0 else 100.0 - 10.0**-digits
    return f"{min(100.0 * rate, largest):.{digits}f}{unit}"


def _number(values: Sequence[float], scale: float = 1.0) -> str:
    """The median in three digits, or all before the point."""
    if not values:
        return UNKNOWN
    scaled = scale * float(np.median(values))
    return f"{scaled:.0f}" if abs(scaled) >= 100 else f"{scaled:.3g}"
