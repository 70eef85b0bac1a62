"""The episodes of an evaluation as one figure: how far from its goal the tip ended, and which were missed."""

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support import palette
from redundant_envs.support.figures import bare, new_figure, save_figure

from ..config.run import LABELS
from ..rollout import expert_name, task_of
from ..run_folder import EPISODES

NEAREST = 1e-2  # mm; a tip that ends nearer to its goal is drawn here, on a logarithmic axis
MISSED = palette.css(palette.ERROR)
LINE = 80  # characters of a line of the title


def draw_outcomes(
    result: Mapping[str, Any], episodes: NDArray[np.float64], tolerance: float | None, path: Path
) -> None:
    """Draw the episodes of an evaluation, rows of episodes.csv; ``tolerance`` (m) is the distance up to which
    the tip is at its goal, None if the task has none."""
    save_figure(figure(result, episodes, tolerance), path)


def figure(result: Mapping[str, Any], episodes: NDArray[np.float64], tolerance: float | None) -> Any:
    columns = dict(zip(EPISODES, episodes.T, strict=True))
    drawn = new_figure(7.5, 3.4, 120)
    panel, learner = drawn.subplots(), LABELS[result["algo"]]
    color, (_, goals) = palette.LEARNERS[learner], task_of(result["env"]).successes
    if np.isnan(columns["distance"]).any():  # the task does not tell it
        _steps(panel, columns["return"], learner, color, "-")
        panel.set(xlabel="return of an episode", ylabel="episodes that return at most this")
    else:
        ours, other = (np.maximum(1000.0 * columns[who], NEAREST) for who in ("distance", "expert_distance"))
        places = _steps(panel, ours, learner, color, "-")
        if not np.isnan(other).any():
            _steps(panel, other, expert_name(result["env"]), palette.EXPERT, (0, (5, 3)))
        if (missed := columns["hold"] == 0.0).any():
            panel.plot(ours[missed], places[missed], "o", color=MISSED, ms=5, label=f"missed: {missed.sum()}")
        if tolerance is not None:
            near = 1000.0 * tolerance
            panel.axvline(near, color=palette.GREY, lw=1.2, label=f"near enough: {near:g} mm")
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(lambda at, _: f"{'≤ ' if at < 1.01 * NEAREST else ''}{at:g}")
        panel.set(xlabel="distance of the tip at the end, mm", ylabel=f"{goals} at most this far")
        panel.minorticks_off()
    panel.set_ylim(bottom=0.0)
    bare(panel)
    panel.legend(frameon=False, fontsize="small")
    title = textwrap.fill(finding(result, columns), LINE)
    panel.set_title(title, loc="left", fontsize="medium", fontweight="bold")
    return drawn


def finding(result: Mapping[str, Any], columns: Mapping[str, NDArray[np.float64]]) -> str:
    """What the episodes show, in a sentence without its point."""
    if np.isnan(columns["distance"]).any():
        return f"Half of {len(columns['return'])} episodes return at least {np.median(columns['return']):.3g}"
    distances, missed = 1000.0 * columns["distance"], columns["hold"] == 0.0
    text = f"half of the tips end within {_number(float(np.median(distances)))} mm"
    if np.isnan(columns["hold"]).any():
        return text.capitalize()
    held, goals = task_of(result["env"]).successes
    text = f"{(~missed).sum()} of {len(missed)} {goals} {held}: {text}"
    if not missed.any():
        return text
    low, high = (_number(float(end)) for end in (distances[missed].min(), distances[missed].max()))
    return f"{text}, the missed {missed.sum()} at {low if low == high else f'{low} to {high}'} mm"


def _number(value: float) -> str:
    """Two digits, without an exponent where that is short."""
    return f"{float(f'{value:.2g}'):g}"


def _steps(
    panel: Any, values: NDArray[np.float64], label: str, color: str, style: Any
) -> NDArray[np.float64]:
    """Draw how many values are at most each of them; returns these numbers, in the order of the values."""
    order = np.argsort(values, kind="stable")
    places = np.empty(len(values))
    places[order] = np.arange(1.0, len(values) + 1.0)
    panel.step(values[order], places[order], where="post", color=color, ls=style, lw=1.8, label=label)
    return places
