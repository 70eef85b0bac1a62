"""Results of many runs as a Markdown table, and as rows for a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .aggregate import LEAST_RUNS, interquartile_mean, stratified_bootstrap
from .runs import Group, read_groups

MEASURES = ("time_to_hold", "effort", "smoothness")
"""Compared with computed torque, whose entries have the prefix "expert_"."""
RESULTS = (
    "environment", "learner", "seeds", "hold, median", "hold, worst seed", "hold, IQM [95 % interval]",
    "hold of computed torque", "hold compared", "touch, median", "steps, millions", "training, s",
    "steps per s",
)  # fmt: skip
COMPARISON = (
    "environment", "learner", "time to hold, s", "... of computed torque", "effort",
    "... of computed torque", "smoothness", "... of computed torque", "machine",
)  # fmt: skip
BRIEF = (
    "environment", "learner", "seeds", "goals held, median seed", "worst seed", "computed torque",
    "training on one core",
)  # fmt: skip
EXPLANATION = (
    "Computed torque acts on the same goals as the learners. IQM is the interquartile mean of the seeds, and "
    f"its interval a stratified bootstrap over seeds (unknown with fewer than {LEAST_RUNS}). Figures without "
    "another label are medians over seeds. Time to hold is the median over held episodes, of the seeds that "
    "held any. Effort is the mean squared normalised action, smoothness the mean change of the action from "
    "step to step; less is better for all three. Steps per second are those of the whole training."
)
UNKNOWN = "-"


def rows(folders: Iterable[str | Path]) -> list[dict[str, Any]]:
    """Results of run folders, one row per group of runs that differ in their seed only.

    Returns
    -------
    list of dict
        All rows have the same keys; None means unknown. Rates are from 0 to 1, times in
        seconds, effort in squared and smoothness in simple units of the normalised action.

    Raises
    ------
    ValueError
        A folder is not an evaluated run, or two folders contradict each other.
    """
    return [_row(same) for same in read_groups(folders)]


def table(folders: Iterable[str | Path]) -> str:
    """Results of run folders as two Markdown tables and the notes that a reader needs to judge them.

    The second table compares time to hold, effort and smoothness with computed torque.

    Raises
    ------
    ValueError
        As in :func:`rows`.
    """
    found = rows(folders)
    return "\n".join(
        [
            *_markdown(RESULTS, [_results(row) for row in found]),
            "",
            *_markdown(COMPARISON, [_comparison(row) for row in found]),
            "",
            EXPLANATION,
            "",
            _origin(found),
        ]
    )


def brief_table(folders: Iterable[str | Path]) -> str:
    """Hold success and training time of run folders as one small Markdown table, that of the README.

    Raises
    ------
    ValueError
        As in :func:`rows`.
    """
    return "\n".join(_markdown(BRIEF, [_brief(row) for row in rows(folders)]))


def write_rows(found: list[dict[str, Any]], path: Path) -> None:
    """Write :func:`rows` as a CSV file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(found[0]))
        writer.writeheader()
        writer.writerows(found)


def _row(same: Group) -> dict[str, Any]:
    """The numbers of a group."""
    hold = same.numbers("hold_success")
    low, high = (_known(end) for end in stratified_bootstrap([hold], interquartile_mean))
    speeds = [
        run.evaluation["env_steps"] / run.evaluation["train_seconds"]
        for run in same.runs
        if run.evaluation.get("env_steps") is not None and run.evaluation.get("train_seconds")
    ]
    steps = same.numbers("env_steps")
    compared = {
        f"{prefix}{name}": _median(same.numbers(f"{prefix}{name}"))
        for name in MEASURES
        for prefix in ("", "expert_")
    }
    dates = sorted(str(run.evaluation["date"]) for run in same.runs if "date" in run.evaluation)
    return {
        "environment": same.environment,
        "scene": same.scene,
        "learner": same.learner,
        "seeds": len(same.runs),
        "goals": same.runs[0].evaluation["episodes"],
        "hold_median": _median(hold),
        "hold_worst": min(hold),
        "hold_iqm": float(interquartile_mean(hold)),
        "hold_iqm_low": low,
        "hold_iqm_high": high,
        "expert_hold": _median(same.numbers("expert_hold_success")),
        "holds_more": _holds_more(same),
        "touch_median": _median(same.numbers("touch_success")),
        "env_steps": _median(steps),
        "env_steps_least": min(steps, default=None),
        "env_steps_most": max(steps, default=None),
        "train_seconds": _median(same.numbers("train_seconds")),
        "steps_per_second": _median(speeds),
        **compared,
        "machine": _joined(str(run.evaluation.get("machine", UNKNOWN)) for run in same.runs),
        "torch": _joined(_version(run.evaluation, "torch") for run in same.runs),
        "stable_baselines3": _joined(_version(run.evaluation, "stable-baselines3") for run in same.runs),
        "first_date": dates[0] if dates else None,
        "last_date": dates[-1] if dates else None,
    }


def _holds_more(same: Group) -> str:
    """Which holds more by the median, and in how many seeds computed torque holds more, if that differs."""
    hold, expert = (np.asarray(same.numbers(name)) for name in ("hold_success", "expert_hold_success"))
    difference = np.median(hold) - np.median(expert)
    lost = int((hold < expert).sum())
    if difference < 0:
        return "computed torque holds more"
    words = "the learner holds more" if difference > 0 else "equal"
    return f"{words} (computed torque holds more in {lost} of {len(hold)} seeds)" if lost else words


def _results(row: Mapping[str, Any]) -> list[str]:
    """A row of the first table, in the order of RESULTS."""
    digits = _digits(row)
    low, high = (_percent(row[name], digits, "") for name in ("hold_iqm_low", "hold_iqm_high"))
    interval = "unknown" if row["hold_iqm_low"] is None else f"{low} to {high}"
    steps = _number(row["env_steps"], 1e-6)
    if steps != UNKNOWN and row["env_steps_most"] > 1.01 * row["env_steps_least"]:
        steps = f"{_number(row['env_steps_least'], 1e-6)} to {_number(row['env_steps_most'], 1e-6)}"
    return [
        _title(row), row["learner"], str(row["seeds"]), _percent(row["hold_median"], digits),
        _percent(row["hold_worst"], digits), f"{_percent(row['hold_iqm'], digits)} [{interval}]",
        _percent(row["expert_hold"], digits), row["holds_more"], _percent(row["touch_median"], digits),
        steps, _number(row["train_seconds"]), _number(row["steps_per_second"]),
    ]  # fmt: skip


def _brief(row: Mapping[str, Any]) -> list[str]:
    """A row of the small table, in the order of BRIEF."""
    digits = _digits(row)
    held = (_percent(row[name], digits) for name in ("hold_median", "hold_worst", "expert_hold"))
    return [_title(row), row["learner"], str(row["seeds"]), *held, f"{_number(row['train_seconds'])} s"]


def _digits(row: Mapping[str, Any]) -> int:
    """Digits after the point of a rate in percent: one goal of a thousand is 0.1 %."""
    return max(1, len(str(row["goals"])) - 3)


def _comparison(row: Mapping[str, Any]) -> list[str]:
    """A row of the second table, in the order of COMPARISON."""
    numbers = [_number(row[f"{prefix}{name}"]) for name in MEASURES for prefix in ("", "expert_")]
    return [_title(row), row["learner"], *numbers, row["machine"]]


def _origin(found: list[dict[str, Any]]) -> str:
    """Goals, machines, versions and dates, in words."""
    goals = _joined(str(row["goals"]) for row in found)
    parts = [f"Goals of each seed: {goals}."]
    for label, name in (
        ("Machine", "machine"), ("torch", "torch"), ("stable-baselines3", "stable_baselines3")
    ):  # fmt: skip
        parts.append(f"{label}: {_joined(item for row in found for item in row[name].split('; '))}.")
    dates = [row[name][:10] for row in found for name in ("first_date", "last_date") if row[name]]
    if dates:
        first, last = min(dates), max(dates)
        parts.append(f"Evaluated on {first}." if first == last else f"Evaluated from {first} to {last}.")
    return " ".join(parts)


def _markdown(head: Iterable[str], lines: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a table; a bar inside a cell would begin another."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in (head, *lines)]
    cells.insert(1, ["---"] * len(cells[0]))
    return [f"| {' | '.join(line)} |" for line in cells]


def _title(row: Mapping[str, Any]) -> str:
    return f"{row['environment']} ({row['scene']})" if row["scene"] else str(row["environment"])


def _median(numbers: list[float]) -> float | None:
    return float(np.median(numbers)) if numbers else None


def _known(number: Any) -> float | None:
    return None if np.isnan(number) else float(number)


def _version(evaluation: Mapping[str, Any], package: str) -> str:
    return str(evaluation["versions"].get(package, UNKNOWN))


def _joined(words: Iterable[str]) -> str:
    return "; ".join(sorted(set(words)))


def _percent(rate: float | None, digits: int, unit: str = " %") -> str:
    """A rate in percent; one below 1 is never rounded up to 100 %."""
    if rate is None:
        return UNKNOWN
    largest = 100.0 if rate >= 1.0 else 100.0 - 10.0**-digits
    return f"{min(100.0 * rate, largest):.{digits}f}{unit}"


def _number(value: float | None, scale: float = 1.0) -> str:
    """Three digits, or all before the point."""
    if value is None:
        return UNKNOWN
    scaled = scale * value
    return f"{scaled:.0f}" if abs(scaled) >= 100 else f"{scaled:.3g}"
