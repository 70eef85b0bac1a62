"""Figures and clips of recorded motions."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.animation import stated_limits
from redundant_envs.figures import bare, new_figure, save_figure
from redundant_envs.model.trajectory import EnergyRun

KINETIC, POTENTIAL, TOTAL, ERROR, LEFT_OUT = "#34496e", "#d9822b", "#2e8b66", "#8c3b3b", "#a9adb5"
SLIDERS = ("#34496e", "#7c9dcd")


def energies_figure(run: EnergyRun) -> Any:
    """Figure 1: kinetic and potential energy; below, the travel of the sliders if there are any."""
    motion = run.trajectory
    sliders = run.scene.robot.sliders()
    figure = new_figure(7.0, 5.4 if sliders else 3.6)
    ratios = [3, 2] if sliders else [1]
    panels = figure.subplots(len(ratios), sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
    energy = panels[0]
    energy.plot(motion.t, motion.kinetic_energy, color=KINETIC, lw=1.4, label="kinetic")
    energy.plot(motion.t, motion.potential_energy, color=POTENTIAL, lw=1.4, label="potential")
    energy.set_ylabel("energy [J]")
    energy.set_title(f"{run.name}: kinetic and potential energy", loc="left")
    limits = stated_limits(run.scene)
    for k, color in zip(sliders, itertools.cycle(SLIDERS), strict=False):
        name = run.scene.robot.coordinates[k]
        panels[1].plot(motion.t, motion.q[:, k], color=color, lw=1.4, label=name)
        for i, limit in enumerate(limits.get(k, ())):
            label = f"limits of {name}" if i == 0 else None
            panels[1].axhline(limit, color=color, lw=1.0, ls=(0, (2 + 3 * (k > 1), 2)), label=label)
    if sliders:
        panels[1].set_ylabel("travel [m]")
    _finish(panels, motion.t)
    return figure


def total_figure(run: EnergyRun) -> Any:
    """Figure 2: total energy on the scale of its parts; below, its relative departure."""
    motion = run.trajectory
    figure = new_figure(7.0, 5.0)
    energy, error = figure.subplots(2, sharex=True, height_ratios=[3, 2])
    book = run.without_springs
    if book is not None:
        energy.plot(motion.t, book, color=LEFT_OUT, lw=1.0, label="springs left out")
    energy.plot(motion.t, run.total, color=TOTAL, lw=2.0, label="total")
    worked = float(np.abs(motion.work).max()) > 1e-12 * run.scale
    if worked:
        energy.plot(motion.t, run.balance, color=ERROR, lw=1.4, ls="--", label="total minus work")
    low = min(motion.potential_energy.min(), run.balance.min())
    high = max(motion.kinetic_energy.max(), run.balance.max(), run.total.max())
    if book is not None:
        low, high = min(low, book.min()), max(high, book.max())
    margin = 0.05 * (high - low)
    energy.set_ylim(low - margin, high + margin)
    energy.set_ylabel("energy [J]")
    energy.set_title(f"{run.name}: total energy, relative drift {run.drift:.1e}", loc="left")
    error.plot(motion.t, run.relative_error, color=ERROR, lw=1.2, label="relative error")
    error.set_ylabel("error / energy\nexchanged [1]")
    error.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
    _finish((energy, error), motion.t)
    return figure


def _finish(panels: Any, t: NDArray[np.float64]) -> None:
    for panel in panels:
        panel.set_xlim(t[0], t[-1])
        bare(panel)
        # Outside, so that a legend never covers a curve.
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    panels[-1].set_xlabel("time [s]")


def save_figures(run: EnergyRun, folder: Path) -> list[Path]:
    """Write both figures of a run as PNG; returns their paths."""
    figures = {"energies": energies_figure(run), "total": total_figure(run)}
    return [save_figure(figure, folder / f"{run.name}_{kind}.png") for kind, figure in figures.items()]
