"""Learning curves of many runs: their interquartile means over seeds, as one figure and as numbers."""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support import palette
from redundant_envs.support.extras import needs
from redundant_envs.support.figures import bare, literal, new_figure, save_figure
from redundant_envs.support.tables import write_rows

from ..run_folder import SELECTION
from ..statistics import MIN_RUNS, interquartile_mean, run_interval
from .runs import Group, Run, read_groups

AXES = {
    "steps": ("env_steps", 1e-6, "environment steps, millions"),
    "seconds": ("seconds", 1.0, "training time, s"),
}
"""Name of an x axis -> its column of selection.csv, the factor with which it is drawn, and its label."""
MEASURES = {
    "hold_success": ("hold success, %", "expert_hold_success"), "touch_success": ("touch success, %", ""),
    "return": ("mean return", "expert_mean_return"),
}  # fmt: skip
"""Column of selection.csv -> title of its panels, and the expert's entry in evaluation.json, if any."""
TICKS = (1.0, 0.0, 0.9, 0.99, 0.5, 0.999, 0.98, 0.95, 0.8, 0.998)  # labelled rates, most important first
CLOSEST = 0.075  # least distance of two labels, as a fraction of the axis
SPREAD = 3.0  # a panel's x axis is logarithmic if its longest curve is more than this many times its shortest
ENDINGS = (".png", ".svg")
LONG = 30  # number of characters from which on an entry of the legend needs more than a sixth of the width
TABLE = (
    "environment", "scene", "learner", "seeds", "axis", "x",
    *(f"{name}{end}" for name in MEASURES for end in ("", "_low", "_high")),
    "expert_hold_success", "expert_mean_return",
)  # fmt: skip
"""Columns of the CSV file: x in steps or seconds, rates from 0 to 1."""


class Curve(NamedTuple):
    """Learning of a group."""

    x: NDArray[np.float64]  # (points,), environment steps, or training time in seconds
    middle: NDArray[np.float64]  # interquartile means over seeds, (points, len(MEASURES))
    low: NDArray[np.float64]  # ends of their 95 % intervals, NaN for few seeds
    high: NDArray[np.float64]


def curves(places: Iterable[str | Path], path: str | Path) -> Path:
    """Draw learning curves of runs, and write their numbers beside them, as CSV, whose path is returned.

    Panels show what the task tells on the selection goals, over steps and over seconds: pale lines are seeds,
    a thick line is their interquartile mean, a band its 95 % interval by bootstrap, and dashed is computed
    torque on the evaluation goals.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"out is {path}; end its name in {' or '.join(ENDINGS)}")
    return draw_curves(read_groups(places), path)


def draw_curves(groups: Sequence[Group], path: Path) -> Path:
    """Draw the learning curves of groups, and write their numbers beside them; returns the CSV file."""
    save_figure(draw(groups), path)
    rows = [row for same in groups for axis in AXES for row in _rows(same, axis)]
    write_rows(rows, TABLE, path.with_suffix(".csv"))
    return path.with_suffix(".csv")


def _rows(same: Group, axis: str) -> Iterable[dict[str, Any]]:
    curve = summarize(same, axis)
    head = [same.environment, same.scene, same.learner, len(same.runs), axis]
    experts = [expert(same, name) for name, (_, entry) in MEASURES.items() if entry]
    for x, *numbers in zip(curve.x, curve.middle, curve.low, curve.high, strict=True):
        known = ("" if np.isnan(v) else float(v) for v in np.stack(numbers, axis=1).ravel())
        yield dict(zip(TABLE, (*head, float(x), *known, *experts), strict=True))


def summarize(same: Group, axis: str) -> Curve:
    """The curve of a group; runs whose points differ are interpolated linearly where all have a curve, at
    as many points as the longest run has. ValueError if that is nowhere."""
    lines = [points(run, axis) for run in same.runs]
    grid = lines[0][0]
    if any(not np.array_equal(x, grid) for x, _ in lines):
        start, end = max(x[0] for x, _ in lines), min(x[-1] for x, _ in lines)
        if start > end:
            names = ", ".join(str(run.folder) for run in same.runs)
            raise ValueError(f"a curve of {names} ends before another one begins; leave it out")
        grid = np.linspace(start, end, max(len(x) for x, _ in lines))
    runs = np.stack(
        [np.stack([np.interp(grid, x, column) for column in values.T], axis=1) for x, values in lines]
    )  # (runs, points, measures)
    return Curve(grid, interquartile_mean(runs), *run_interval(runs))


def points(run: Run, axis: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x (points,) and measures (points, len(MEASURES)) of a run; of rows with equal x the last counts."""
    if not len(run.curve):
        raise ValueError(f"{run.folder} has no row in selection.csv; train longer, or leave it out")
    x = run.curve[:, SELECTION.index(AXES[axis][0])]
    last = np.append(np.diff(x) > 0, True)
    return x[last], run.curve[last][:, [SELECTION.index(name) for name in MEASURES]]


def expert(same: Group, measure: str) -> float | None:
    """Computed torque's number for a group, None if no run has it."""
    known = same.numbers(MEASURES[measure][1])
    return float(np.median(known)) if known else None


def draw(groups: Sequence[Group]) -> Any:
    """The figure of the groups: a subfigure per environment and scene, a row per axis, three panels each."""
    with needs("plot"):
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch
    explained: list[Any] = []
    if any(len(same.runs) > 1 for same in groups):
        explained = [
            Line2D([], [], color="0.4", linewidth=2.2, label="interquartile mean"),
            Line2D([], [], color="0.4", alpha=0.5, linewidth=0.6, label="one seed"),
        ]
    if any(len(same.runs) >= MIN_RUNS for same in groups):
        explained.append(Patch(color="0.4", alpha=0.25, linewidth=0, label="95 % interval of the mean"))
    titles = list(dict.fromkeys(same.title for same in groups))
    looks = _looks(groups)
    figure = new_figure(11.0, len(titles) * (2.5 * len(AXES) + 0.75), 120)
    parts = figure.subfigures(len(titles), 1, squeeze=False)[:, 0]
    for part, title in zip(parts, titles, strict=True):
        shown = [same for same in groups if same.title == title]
        names = known_measures(shown)
        panels = part.subplots(len(AXES), len(names), squeeze=False)
        for row, axis in zip(panels, AXES, strict=True):
            for panel, name in zip(row, names, strict=True):
                for same in shown:
                    _draw_group(panel, name, axis, same, looks[same.learner])
                _finish(panel, name, axis, shown)
        part.suptitle(literal(title), fontweight="bold")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        named = [*dict(zip(labels, handles, strict=True)).values(), *explained]
        columns = 6 if max(map(len, labels)) < LONG else 2
        part.legend(handles=named, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def known_measures(groups: Sequence[Group]) -> list[str]:
    """The measures that some curve of groups has; a task may tell no success."""
    known = np.zeros(len(MEASURES), np.bool_)
    for run in (run for same in groups for run in same.runs):
        known |= np.isfinite(points(run, "steps")[1]).any(axis=0)
    return [name for name, there in zip(MEASURES, known, strict=True) if there]


def _draw_group(panel: Any, name: str, axis: str, same: Group, color: str) -> None:
    k, scale, curve = list(MEASURES).index(name), AXES[axis][1], summarize(same, axis)
    for run in same.runs if len(same.runs) > 1 else ():
        x, values = points(run, axis)
        panel.plot(scale * x, values[:, k], color=color, alpha=0.3, linewidth=0.6)
    x, low, high = scale * curve.x, curve.low[:, k], curve.high[:, k]
    panel.fill_between(x, low, high, color=color, alpha=0.25, linewidth=0)
    label = literal(f"{same.learner} ({len(same.runs)} seed{'s' * (len(same.runs) > 1)})")
    panel.plot(x, curve.middle[:, k], color=color, linewidth=2.2, label=label)


def _finish(panel: Any, name: str, axis: str, shown: Sequence[Group]) -> None:
    """The expert, scales and labels of a panel."""
    for level in sorted({level for same in shown if (level := expert(same, name)) is not None}):
        panel.axhline(level, color=palette.EXPERT, linestyle=(0, (5, 3)), lw=1.1, label="expert")
    title, label = MEASURES[name][0], AXES[axis][2]
    ends = [points(run, axis)[0][-1] for same in shown for run in same.runs]
    if 0.0 < SPREAD * min(ends) < max(ends):
        from matplotlib.ticker import FuncFormatter, LogLocator

        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter(FuncFormatter(lambda at, _: f"{at:g}"))
        label += " (logarithmic)"
    else:
        panel.set_xlim(left=0)
    panel.set_xlabel(label)
    bare(panel)
    if name.endswith("success"):
        title += " (misses: logarithmic)"
        _rate_scale(panel, 1.0 / max(same.runs[0].settings["curve_episodes"] for same in shown))
    panel.set_title(title, loc="left", fontsize="medium")
    panel.minorticks_off()


def _rate_scale(panel: Any, goal: float) -> None:
    """A scale of rates, logarithmic in the misses, to which one goal is added, so that 100 % is on it."""

    def height(rate: Any) -> Any:
        return -np.log10(np.maximum(1.0 + goal - np.asarray(rate, dtype=np.float64), 1e-12))

    def rate(at: Any) -> Any:
        return 1.0 + goal - 10.0 ** -np.asarray(at, dtype=np.float64)

    low, high = height(0.0), height(1.0)
    chosen: list[float] = []
    for tick in TICKS:
        if all(abs(height(tick) - height(other)) >= CLOSEST * (high - low) for other in chosen):
            chosen.append(tick)
    panel.set_yscale("function", functions=(height, rate))
    panel.set_ylim(rate(low - 0.02 * (high - low)), rate(high + 0.03 * (high - low)))
    panel.set_yticks(sorted(chosen), [f"{100 * tick:g}" for tick in sorted(chosen)], minor=False)


def _looks(groups: Sequence[Group]) -> dict[str, str]:
    """Colour of each learner, the same in all panels; others take turns with those that are free."""
    learners = {same.learner for same in groups}
    free = [c for who, c in palette.LEARNERS.items() if who not in learners] or [*palette.LEARNERS.values()]
    others = zip(sorted(learners - palette.LEARNERS.keys()), itertools.cycle(free), strict=False)
    return dict(others) | palette.LEARNERS
