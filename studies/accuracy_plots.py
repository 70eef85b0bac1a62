"""Figures of the accuracy study: error and energy against cost, a panel for each arm."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.support import palette
from redundant_envs.support.bounded import read_rows
from redundant_envs.support.figures import bare, literal, new_figure, save_figure
from studies.accuracy import STAMP, WHAT, PanelResult, Row, answers
from studies.accuracy_config import Study

# Ours are thick, the peers thin.
OURS: dict[str, dict[str, Any]] = {
    "euler": {"color": palette.AMBER, "marker": "s"},
    "rk4": {"color": palette.BLUE, "marker": "o"},
    "rk8": {"color": palette.GREEN, "marker": "^"},
    "rk8, error-controlled": {"color": palette.VERMILION, "marker": "D"},
}
PEERS: dict[str, dict[str, Any]] = {
    "MuJoCo Euler": {"color": palette.GREY, "marker": "s", "ls": "-"},
    "MuJoCo implicitfast": {"color": palette.GREY, "marker": "x", "ls": ":"},
    "MuJoCo implicit": {"color": palette.GREY, "marker": "+", "ls": "--"},
    "MuJoCo RK4": {"color": palette.DARK, "marker": "o", "ls": "-"},
    "SciPy RK45": {"color": palette.PINK, "marker": "v", "ls": ":"},
    "SciPy DOP853": {"color": palette.PINK, "marker": "^", "ls": "-"},
}
COLUMNS = {
    "this package": {name: name for name in OURS},
    "MuJoCo": {f"MuJoCo {x}": x for x in ("Euler", "implicitfast", "implicit", "RK4")},
    "SciPy, all states as one": {f"SciPy {x}": x for x in ("RK45", "DOP853")},
}
"""Columns of the legend: title -> method -> its name there."""
ENCODER_MM = 1e-2
"""Movement of the tip that a good joint encoder just resolves on such an arm, mm: 1e-5 rad at 1 m."""
ENCODER = "encoder: the movement of the tip of a 1 m arm that a joint encoder of 1e-5 rad just resolves"
TABLES = "accuracy.csv", "accuracy_long.csv"
"""Files of the rows and of the rows of long motions."""
WIDTH = 8.0
TICKS = {1e1: "10 ns", 1e2: "100 ns", 1e3: "1 µs", 1e4: "10 µs", 1e5: "100 µs", 1e6: "1 ms"}
NOTE: dict[str, Any] = {"fontsize": 7.5, "color": palette.css(palette.INK)}


def read(study: Study, folder: Path) -> list[PanelResult]:
    """Results from the tables that a run of the study wrote into a folder; ValueError if they do not fit."""
    tables = []
    for name in TABLES:
        path = folder / name
        if not path.is_file():
            raise ValueError(f"{folder} has no {name}; give a folder that the accuracy study wrote")
        try:
            tables.append([_typed(row) for row in read_rows(path, "table")])
        except (ValueError, LookupError) as error:
            raise ValueError(f"{path} is damaged ({error}); write it again with the study") from error
    result = []
    for panel in study.panels:
        rows, long_rows = ([row for row in table if row["panel"] == panel.name] for table in tables)
        if not rows:
            panel_names = ", ".join(sorted({row["panel"] for row in tables[0]}))
            raise ValueError(f"{folder / TABLES[0]} has no panel {panel.name!r}, only {panel_names}")
        floor = rows[0].get("floor_mm", math.nan)
        if not 0.0 <= floor < math.inf:
            raise ValueError(f"{folder / TABLES[0]} has {floor} as 'floor_mm'; write it again with the study")
        result.append(PanelResult(panel, rows, long_rows, 1e-3 * floor))
    return result


def _typed(row: dict[str, str]) -> Row:
    """A row of a table with its numbers as floats; empty fields are left out."""
    texts: Row = {name: row[name] for name in WHAT}
    return texts | {name: float(cell) for name, cell in row.items() if cell and name not in (*STAMP, *WHAT)}


def work_precision_figure(results: Sequence[PanelResult], control_dt: float) -> Any:
    """Tip error of a control interval against its cost."""
    figure, axes = _grid(len(results), 3.3)
    for panel, result in zip(axes, results, strict=True):
        panel.set_ylim(1e-13, 1e2)
        panel.axhspan(1e-13, 1e3 * result.floor, color=palette.css(palette.REACH), zorder=0)
        panel.axhline(ENCODER_MM, color=palette.GREY, lw=0.8, zorder=1)
        _lines(panel, result.rows, lambda row: row["tip_mm_p99"])
        _title(panel, result)
        panel.set_yticks([10.0**k for k in range(-12, 3, 2)])
        panel.text(2e6, 0.8 * ENCODER_MM, "encoder", ha="right", va="top", **NOTE)
        panel.text(2e6, 1.6e-13, "error of the reference itself", ha="right", va="bottom", **NOTE)
        _advantage(panel, result)
    _settings(axes[min(1, len(axes) - 1)], results[min(1, len(axes) - 1)].rows)
    label = f"tip error after {1e3 * control_dt:g} ms, 99 % of states below [mm]"
    _finish(figure, axes, label, control_dt, f"\n{ENCODER}", advantages(results))
    return figure


def energy_figure(results: Sequence[PanelResult], control_dt: float, motions: int) -> Any:
    """Rate of the energy error of free motions against the cost of a control interval."""
    figure, axes = _grid(len(results), 3.0)
    for panel, result in zip(axes, results, strict=True):
        cost = {(r["method"], r["setting"]): r["ns_best"] for r in result.rows}
        rows = [
            {**r, "ns_best": cost[key]}
            for r in result.long_rows
            if (key := (r["method"], r["setting"])) in cost and "energy_rate_median" in r
        ]
        panel.set_ylim(1e-17, 1e1)
        _lines(panel, rows, lambda row: row["energy_rate_median"])
        _title(panel, result)
        panel.set_yticks([10.0**k for k in range(-16, 1, 4)])
    label = f"energy error per second, as a share of what raises the arm [median of {motions} motions]"
    _finish(figure, axes, label, control_dt, title=drifts(results))
    return figure


def advantages(results: Sequence[PanelResult]) -> str:
    """How many times less time this package takes than MuJoCo for the encoder's error, as a title."""
    ratios = [ratio for r in results if not math.isnan(ratio := answers(r.rows, [ENCODER_MM])[0].ratio)]
    if not ratios:
        return ""
    times = f"{min(ratios):.0f} to {max(ratios):.0f}" if len(ratios) > 1 else f"{ratios[0]:.0f}"
    return f"Within the error of an encoder this package is {times} times as fast as MuJoCo"


def drifts(results: Sequence[PanelResult]) -> str:
    """The energy error of the best settings, in the panel where it is largest, as a title."""
    best: dict[str, list[float]] = {"": [], "mujoco": []}
    for result, (peer, found) in itertools.product(results, best.items()):
        rows = [row for row in result.long_rows if row["peer"] == peer and "energy_rate_median" in row]
        found += [min(row["energy_rate_median"] for row in rows)] if rows else []
    if not all(best.values()):
        return ""
    ours, others = (f"{max(found):.0e}" for found in best.values())
    return f"The most accurate settings lose {ours} of the energy per second at most, MuJoCo's {others}"


def _grid(count: int, height: float) -> tuple[Any, list[Any]]:
    """A figure with a number of panels of a height [inch], two in a row; the axes are shared."""
    columns = min(2, count)
    rows = -(-count // columns)
    figure = new_figure(WIDTH, height * rows + 1.1, 200)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for panel in grid[count:]:
        panel.set_visible(False)
    return figure, list(grid[:count])


def _lines(panel: Any, rows: Sequence[Row], value: Callable[[Row], float]) -> None:
    """One line for each method, through its configurations."""
    for styles, size in ((PEERS, {"lw": 1.0, "ms": 3.5}), (OURS, {"lw": 2.0, "ms": 4.5})):
        for method, style in styles.items():
            points = [(r["ns_best"], value(r)) for r in rows if r["method"] == method]
            points = [p for p in points if np.isfinite(p[1])]
            if points:
                x, y = zip(*points, strict=True)
                panel.plot(x, y, label=method, zorder=4 if styles is OURS else 3, **size, **style)


def _advantage(panel: Any, result: PanelResult) -> None:
    """An arrow from our cheapest configuration within the encoder's error to MuJoCo's."""
    answer = answers(result.rows, [ENCODER_MM])[0]
    if answer.ours is None or answer.mujoco is None:
        return
    ends = [(row["ns_best"], ENCODER_MM) for row in (answer.ours, answer.mujoco)]
    arrow = {"arrowstyle": "<->", "color": palette.DARK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    panel.annotate("", *ends, arrowprops=arrow, zorder=5)
    middle = np.sqrt(ends[0][0] * ends[1][0])
    text = f"{answer.ratio:.0f} ×"
    panel.text(1.5 * middle, 0.7 * ENCODER_MM, text, ha="center", va="top", fontsize=9, fontweight="bold")


def _settings(panel: Any, rows: Sequence[Row]) -> None:
    """Label the first and the last point of some lines."""
    beside = {"xytext": (6, 0), "textcoords": "offset points", "va": "center", **NOTE}
    for method in ("rk4", "MuJoCo RK4", "rk8, error-controlled"):
        line = [r for r in rows if r["method"] == method]
        for row in {id(r): r for r in (*line[:1], *line[-1:])}.values():
            text = row["setting"].rpartition(" x ")[2].removeprefix("tolerance ")
            if " x " in row["setting"] or row is line[-1]:
                panel.annotate(text, (row["ns_best"], row["tip_mm_p99"]), **beside)


def _title(panel: Any, result: PanelResult) -> None:
    panel.set_title(literal(result.panel.name), loc="left", fontsize=10.5, fontweight="bold", pad=16)
    below = {"transform": panel.transAxes, "fontsize": 8.5, "color": palette.css(palette.INK)}
    panel.text(0.0, 1.02, literal(result.panel.about), **below)


def _finish(figure: Any, axes: Sequence[Any], label: str, dt: float, note: str = "", title: str = "") -> None:
    """Axes, grid, the title, labels with a note below, and one legend for all panels."""
    for panel in axes:
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlim(8.0, 2.5e6)
        panel.set_xticks(list(TICKS), list(TICKS.values()))
        panel.minorticks_off()
        panel.tick_params(labelsize=8.5, labelbottom=True, length=2)
        bare(panel)
    figure.supxlabel(f"time of one core for {1e3 * dt:g} ms of one arm{note}", fontsize=9.5)
    figure.supylabel(label, fontsize=9.5)
    handles = {h.get_label(): h for panel in axes for h in panel.get_lines() if h.get_label()[0] != "_"}
    blank = axes[0].plot([], [], alpha=0.0)[0]
    columns = [
        [(blank, title), *((handles[m], text) for m, text in methods.items() if m in handles)]
        for title, methods in COLUMNS.items()
    ]
    columns = [column for column in columns if len(column) > 1]
    rows = max(len(column) for column in columns)
    entries = [e for column in columns for e in (*column, *[(blank, " ")] * (rows - len(column)))]
    legend = figure.legend(
        *zip(*entries, strict=True), loc="outside upper center", ncols=len(columns), frameon=False,
        fontsize=8.5, columnspacing=3.0, labelspacing=0.25,
        title=title, title_fontproperties={"weight": "bold", "size": 10.5},
    )  # fmt: skip
    for text in legend.get_texts():
        if text.get_text() in COLUMNS:
            text.set_fontweight("bold")


PICTURES = ("accuracy_work_precision", "accuracy_energy")


def files(folder: Path) -> list[Path]:
    """The pictures of a folder: PNG files, then SVG files."""
    return [folder / f"{name}.{kind}" for kind in ("png", "svg") for name in PICTURES]


def save_figures(results: Sequence[PanelResult], study: Study, folder: Path) -> list[Path]:
    """Write both figures as SVG and PNG; returns the PNG files, then the SVG files."""
    dt = study.control_dt
    figures = work_precision_figure(results, dt), energy_figure(results, dt, study.long_runs.states)
    return [save_figure(figure, path) for path, figure in zip(files(folder), figures * 2, strict=True)]
