"""The learning curve of a group of runs: interquartile mean over seeds and its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..run_folder import SELECTION
from .aggregate import bootstrap_interval, interquartile_mean
from .runs import Group, Run

AXES = {"steps": "env_steps", "seconds": "seconds"}
"""Name of an x axis -> its column of selection.csv."""
MEASURES = {"hold_success": "expert_hold_success", "touch_success": "", "return": "expert_mean_return"}
"""Column of selection.csv -> computed torque's entry in evaluation.json, if it has one."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Learning of a group.

    Attributes
    ----------
    x : ndarray (points,)
        Environment steps, or training time in seconds.
    middle, low, high : ndarray (points, len(MEASURES))
        Interquartile mean over seeds and its 95 % interval, which is NaN for one seed.
    """

    x: NDArray[np.float64]
    middle: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def summarize(same: Group, axis: str) -> Curve:
    """The curve of a group over an axis of AXES.

    Runs whose points differ are interpolated linearly to a common grid, from the latest first point to
    the earliest last one, with as many points as the longest run has.

    Raises
    ------
    ValueError
        A run has no points, or the runs have no stretch of the axis in common.
    """
    lines = [points(run, axis) for run in same.runs]
    grid = lines[0][0]
    if any(not np.array_equal(x, grid) for x, _ in lines):
        starts, ends = [x[0] for x, _ in lines], [x[-1] for x, _ in lines]
        first, last = int(np.argmax(starts)), int(np.argmin(ends))
        start, end = starts[first], ends[last]
        if start > end:
            raise ValueError(
                f"{same.runs[last].folder} ends at {end:g} and {same.runs[first].folder} starts at {start:g} "
                f"({AXES[axis]}); leave one of them out"
            )
        grid = np.linspace(start, end, max(len(x) for x, _ in lines))
    runs = np.stack(
        [np.stack([np.interp(grid, x, column) for column in values.T], axis=1) for x, values in lines]
    )  # (runs, points, measures)
    return Curve(grid, interquartile_mean(runs), *bootstrap_interval(runs))


def points(run: Run, axis: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x (points,) and measures (points, len(MEASURES)) of a run; of rows with equal x the last counts."""
    if not len(run.curve):
        raise ValueError(f"{run.folder} has no row in selection.csv; train longer, or leave it out")
    x = run.curve[:, SELECTION.index(AXES[axis])]
    last = np.append(np.diff(x) > 0, True)
    return x[last], run.curve[last][:, [SELECTION.index(name) for name in MEASURES]]


def expert(same: Group, measure: str) -> float | None:
    """Computed torque's number for a group, None if no run has it."""
    known = same.numbers(MEASURES[measure])
    return float(np.median(known)) if known else None
