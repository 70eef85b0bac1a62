"""Learning curves of many runs as one figure, with the numbers behind it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .figure import draw
from .learning import AXES, MEASURES, expert, summarize
from .run_table import read_groups
from .runs import Group

ENDINGS = (".png", ".svg")
TABLE = (
    "environment", "scene", "learner", "seeds", "axis", "x",
    *(f"{name}{end}" for name in MEASURES for end in ("", "_low", "_high")),
    "expert_hold_success", "expert_mean_return",
)  # fmt: skip
"""Columns of the CSV file: x in steps or seconds, rates from 0 to 1."""


def curves(folders: Iterable[str | Path], path: str | Path, x: str = "both") -> Path:
    """Draw learning curves of runs and write their numbers beside them, as CSV.

    For each environment and scene there are panels of hold success, touch success and mean return on the
    selection goals. Pale lines are seeds, a thick line is their interquartile mean, and a band its
    95 % interval by stratified bootstrap. Dashed is computed torque on the evaluation goals.

    Parameters
    ----------
    folders : iterable
        Run folders, or tables of runs, as in :func:`read_runs`.
    path : str or Path
        Figure to write, .png or .svg; its folder is made.
    x : str
        "steps", "seconds", or "both" for a row of panels over each.

    Returns
    -------
    Path
        The CSV file.

    Raises
    ------
    ValueError
        ``path`` or ``x`` is none of these, a folder is not an evaluated run or has no curve yet, or two
        folders contradict each other.
    MissingPackage
        matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"path is {str(path)!r}; end its name in {' or '.join(ENDINGS)}")
    if x not in (*AXES, "both"):
        raise ValueError(f"x is {x!r}; choose {', '.join(AXES)} or both")
    axes = tuple(AXES) if x == "both" else (x,)
    groups = read_groups(folders)
    return draw_curves(groups, path, axes)


def draw_curves(groups: Sequence[Group], path: Path, axes: Sequence[str] = tuple(AXES)) -> Path:
    """Draw the learning curves of groups, and write their numbers beside them; returns the CSV file."""
    found = draw(groups, axes)
    path.parent.mkdir(parents=True, exist_ok=True)
    found.savefig(path)
    table = path.with_suffix(".csv")
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(TABLE)
        writer.writerows(row for same in groups for axis in axes for row in _rows(same, axis))
    return table


def _rows(same: Group, axis: str) -> Iterable[list[Any]]:
    """Rows of the CSV file."""
    curve = summarize(same, axis)
    head = [same.environment, same.scene, same.learner, len(same.runs), axis]
    experts = [expert(same, name) for name, entry in MEASURES.items() if entry]
    for x, *numbers in zip(curve.x, curve.middle, curve.low, curve.high, strict=True):
        values = np.stack(numbers, axis=1).ravel()
        yield [*head, float(x), *("" if np.isnan(v) else float(v) for v in values), *experts]
