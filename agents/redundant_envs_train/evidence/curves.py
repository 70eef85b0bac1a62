"""Learning curves of many runs as one figure, with the numbers behind it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.figures import save_figure
from redundant_envs.tables import write_rows

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


def curves(places: Iterable[str | Path], path: str | Path) -> Path:
    """Draw learning curves of runs and write their numbers beside them, as CSV.

    For each environment and scene there are panels of hold success, touch success and mean return on the
    selection goals, over steps and over seconds. Pale lines are seeds, a thick line is their interquartile
    mean, and a band its 95 % interval by bootstrap. Dashed is computed torque on the evaluation goals.

    Parameters
    ----------
    places : iterable
        Run folders and tables of runs, as in :func:`read_runs`.
    path : str or Path
        Figure to write, .png or .svg; its folder is made.

    Returns
    -------
    Path
        The CSV file.

    Raises
    ------
    ValueError
        ``path`` has another ending, a run has no curve yet, or as in :func:`read_groups`.
    MissingPackage
        matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"path is {str(path)!r}; end its name in {' or '.join(ENDINGS)}")
    return draw_curves(read_groups(places), path)


def draw_curves(groups: Sequence[Group], path: Path) -> Path:
    """Draw the learning curves of groups, and write their numbers beside them; returns the CSV file."""
    save_figure(draw(groups, tuple(AXES)), path)
    rows = [row for same in groups for axis in AXES for row in _rows(same, axis)]
    write_rows(rows, TABLE, path.with_suffix(".csv"))
    return path.with_suffix(".csv")


def _rows(same: Group, axis: str) -> Iterable[dict[str, Any]]:
    """Rows of the CSV file."""
    curve = summarize(same, axis)
    head = [same.environment, same.scene, same.learner, len(same.runs), axis]
    experts = [expert(same, name) for name, entry in MEASURES.items() if entry]
    for x, *numbers in zip(curve.x, curve.middle, curve.low, curve.high, strict=True):
        values = np.stack(numbers, axis=1).ravel()
        known = ("" if np.isnan(v) else float(v) for v in values)
        yield dict(zip(TABLE, (*head, float(x), *known, *experts), strict=True))
