"""Learning curves of many runs: their interquartile means over seeds, as one figure and as numbers."""

import itertools
import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support import palette
from redundant_envs.support.extras import needs
from redundant_envs.support.figures import bare, literal, new_figure, save_figure
from redundant_envs.support.tables import write_rows

from ..rollout import task_of
from ..run_folder import SELECTION
from ..statistics import MIN_RUNS, interquartile_mean, run_interval
from .runs import Group, Run, read_groups

AXES = {
    "steps": ("env_steps", 1e-6, "environment steps, millions"),
    "seconds": ("seconds", 1.0, "training time, s"),
}
"""Name of an x axis -> its column of selection.csv, the factor with which it is drawn, and its label."""
MEASURES = {
    "hold_success": ("{1} not {0}, per thousand", "expert_hold_success"),
    "touch_success": ("{1} not touched, per thousand", ""), "return": ("mean return", "expert_mean_return"),
}  # fmt: skip
"""Column of selection.csv -> label of its panels, with the task's words of successes, and the expert's entry
in evaluation.json, if any."""
LEVELS = (0.99, 0.95, 0.9, 0.8, 0.5)
"""Rates of which a title says from when on they are kept."""
TICKS = (0, 1000, 100, 10, 500, 1, 20, 50, 200, 2)  # labelled misses of a thousand, most important first
CLOSEST = 0.075  # least distance of two labels, as a fraction of the axis
SPREAD = 3.0  # a panel's x axis is logarithmic if its longest curve is more than this many times its shortest
ENDINGS = (".png", ".svg")
LONG = 30  # number of characters from which on an entry of the legend needs more than a sixth of the width
LINE = 125  # characters of a line of a title
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


def draw_curves(groups: Sequence[Group], path: Path, axes: Sequence[str] = tuple(AXES)) -> Path:
    """Draw the learning curves of groups over some axes, and write the numbers of all beside them; returns
    the CSV file."""
    save_figure(draw(groups, axes), path)
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


def finding(groups: Sequence[Group]) -> str:
    """What the curves of groups of one title show, in a sentence without its point."""
    lines = {same.learner: summarize(same, "steps") for same in groups}
    if "hold_success" not in known_measures(groups):
        returns = {who: curve.middle[[0, -1], list(MEASURES).index("return")] for who, curve in lines.items()}
        return ", ".join(f"return of {who} from {a:.3g} to {b:.3g}" for who, (a, b) in returns.items())
    held, goals = task_of(groups[0].runs[0].env).successes
    begun = {who: {level: _kept_from(curve, level) for level in LEVELS} for who, curve in lines.items()}
    level = next((level for level in LEVELS if any(b[level] is not None for b in begun.values())), 1.0)
    kept = {who: x for who, b in begun.items() if (x := b.get(level)) is not None}
    others = {who: float(curve.middle[-1, 0]) for who, curve in lines.items() if who not in kept}
    subject, by = f" of {goals} {held}", (lambda who: f" by {who}") if len(lines) > 1 else (lambda who: "")
    parts = []
    if kept:
        ordered = sorted(kept, key=kept.__getitem__)
        starts = [f"{by(who)} from {1e-6 * kept[who]:.2g}" for who in ordered]
        parts.append(f"{100 * level:g} %{subject}{starts[0]} million steps on{','.join(['', *starts[1:]])}")
    if others:
        ordered = sorted(others, key=others.__getitem__, reverse=True)
        # rounded down, as none but 1 is 100 %
        shares = [f"{math.floor(1000.0 * others[who]) / 10:g} %" for who in ordered]
        ends = [f"{share}{by(who)}" for share, who in zip(shares, ordered, strict=True)]
        if not kept:
            ends[0] = f"{shares[0]}{subject}{by(ordered[0])}"
        parts.append(f"{', '.join(ends)} at the end")
    return "; ".join(parts)


def _kept_from(curve: Curve, level: float) -> float | None:
    """Steps from which on at least a share of goals is held; None if fewer are at the end."""
    below = np.flatnonzero(curve.middle[:, 0] < level)
    first = below[-1] + 1 if len(below) else 0
    return float(curve.x[first]) if first < len(curve.x) else None


def draw(groups: Sequence[Group], axes: Sequence[str] = tuple(AXES)) -> Any:
    """The figure of the groups: a subfigure per environment and scene, a row per axis, three panels each."""
    with needs("plot"):
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch
    explained: list[Any] = []
    if any(len(same.runs) > 1 for same in groups):
        explained = [
            Line2D([], [], color=palette.GREY, linewidth=2.2, label="interquartile mean"),
            Line2D([], [], color=palette.GREY, alpha=0.5, linewidth=0.6, label="one seed"),
        ]
    if any(len(same.runs) >= MIN_RUNS for same in groups):
        explained.append(
            Patch(color=palette.GREY, alpha=0.25, linewidth=0, label="95 % interval of the mean")
        )
    titles = list(dict.fromkeys(same.title for same in groups))
    looks = _looks(groups)
    figure = new_figure(11.0, len(titles) * (2.4 * len(axes) + 0.95), 120)
    parts = figure.subfigures(len(titles), 1, squeeze=False)[:, 0]
    for part, title in zip(parts, titles, strict=True):
        shown = [same for same in groups if same.title == title]
        names = known_measures(shown)
        panels = part.subplots(len(axes), len(names), squeeze=False)
        for row, axis in zip(panels, axes, strict=True):
            for panel, name in zip(row, names, strict=True):
                for same in shown:
                    _draw_group(panel, name, axis, same, looks[same.learner])
                _finish(panel, name, axis, shown)
        found = literal(f"{title}: {finding(shown)}").replace(" %", "\N{NO-BREAK SPACE}%")
        part.suptitle(textwrap.fill(found, LINE), fontweight="bold", fontsize="medium")
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
    alone = "o" if len(x) == 1 else None  # a line of one point has no length
    panel.plot(x, curve.middle[:, k], color=color, linewidth=2.2, marker=alone, label=label)


def _finish(panel: Any, name: str, axis: str, shown: Sequence[Group]) -> None:
    """The expert, scales and labels of a panel."""
    for level in sorted({level for same in shown if (level := expert(same, name)) is not None}):
        panel.axhline(level, color=palette.EXPERT, linestyle=(0, (5, 3)), lw=1.1, label="expert")
    label = AXES[axis][2]
    ends = [points(run, axis)[0][-1] for same in shown for run in same.runs]
    if 0.0 < SPREAD * min(ends) < max(ends):
        from matplotlib.ticker import FuncFormatter, LogLocator

        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter(FuncFormatter(lambda at, _: f"{at:g}"))
    else:
        panel.set_xlim(left=0)
        panel.locator_params(axis="x", nbins=5)  # their labels do not touch
    panel.set_xlabel(label)
    bare(panel)
    panel.margins(y=0.1)
    if name.endswith("success"):
        _rate_scale(panel, 1.0 / max(same.runs[0].settings["curve_episodes"] for same in shown))
    label = MEASURES[name][0].format(*task_of(shown[0].runs[0].env).successes)
    panel.set_ylabel(label, fontsize="small")
    panel.minorticks_off()


def _rate_scale(panel: Any, goal: float) -> None:
    """A scale of rates, labelled by the misses and logarithmic in them: one goal is added, so that none is on
    it. Up is better, as with returns."""

    def height(rate: Any) -> Any:
        return -np.log10(np.maximum(1.0 + goal - np.asarray(rate, dtype=np.float64), 1e-12))

    def rate(at: Any) -> Any:
        return 1.0 + goal - 10.0 ** -np.asarray(at, dtype=np.float64)

    low, high = height(0.0), height(1.0)
    chosen: list[float] = []
    for tick in (1.0 - missed / 1000.0 for missed in TICKS):
        if all(abs(height(tick) - height(other)) >= CLOSEST * (high - low) for other in chosen):
            chosen.append(tick)
    panel.set_yscale("function", functions=(height, rate))
    panel.set_ylim(rate(low - 0.02 * (high - low)), rate(high + 0.03 * (high - low)))
    panel.set_yticks(sorted(chosen), [f"{1000 * (1 - tick):.0f}" for tick in sorted(chosen)])


def _looks(groups: Sequence[Group]) -> dict[str, str]:
    """Colour of each learner, the same in all panels; others take turns with those that are free."""
    learners = {same.learner for same in groups}
    free = [c for who, c in palette.LEARNERS.items() if who not in learners] or [*palette.LEARNERS.values()]
    others = zip(sorted(learners - palette.LEARNERS.keys()), itertools.cycle(free), strict=False)
    return dict(others) | palette.LEARNERS
