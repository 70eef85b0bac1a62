"""Moving pictures of motions that were simulated, and figures of their energies."""

import base64
import itertools
import tempfile
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.canvas import MARGIN
from redundant_envs.envs.rendering import Drawing, stated_limits
from redundant_envs.model.trajectory import Trajectory
from redundant_envs.support import palette
from redundant_envs.support.figures import bare, check_clip, literal, new_figure, save_figure, write_clip
from redundant_envs.support.values import shown

FRAMES_PER_SECOND = 25
TRAIL_SECONDS, TRAIL_POINTS = 2.0, 50  # how long the tip's way is shown, and by how many points at most
KEYS = """
const key = event.key, way = {ArrowLeft: -1, ArrowRight: 1}[key];
const factor = {ArrowUp: 2, '+': 2, '=': 2, ArrowDown: 0.5, '-': 0.5}[key];
if (event.ctrlKey || event.metaKey || !(key === ' ' || way || factor)) return;
event.preventDefault();
event.stopPropagation();
if (factor) this.playbackRate = Math.min(Math.max(factor * this.playbackRate, 1 / 8), 8);
else if (way || !this.paused) this.pause();
else this.play().catch(() => {});  // of which a pause may follow at once
if (way) this.currentTime = (Math.floor(fps * this.currentTime) + way + 0.5) / fps;
"""
"""What a key does to a video that has the focus: as in the window of an environment, and one frame back. As
an attribute of each video it needs no names, and the video plays where scripts are removed."""
KEYS_TOLD = "Click it, and space pauses, left and right go one frame, up and down double and halve the speed."
BORDER = 1.08  # half of a picture's width, in units of the farthest distance of a point from the base


def animate(trajectory: Trajectory, index: int | tuple[int, ...] | None = None) -> "Animation":
    """A moving picture of a motion, in real time.

    Its frames, 25 a second, show states of the trajectory: ask :func:`redundant_envs.simulate` for as many
    times a second, or more. It shows itself in a notebook, where space pauses it, left and right go one
    frame, and up and down double and halve the speed; ``save("file.gif")`` or ``save("file.mp4")`` writes it.
    Both need the extra ``plot``. ValueError if nothing is to be drawn, or index chooses no motion.

    Parameters
    ----------
    trajectory : Trajectory
        What ``simulate`` gave.
    index : int or tuple of ints, optional
        Which motion of a batch; a single motion has none.
    """
    if not isinstance(trajectory, Trajectory):
        raise ValueError(f"trajectory is {shown(trajectory)}; give what redundant_envs.simulate returns")
    if not trajectory.t.size:
        raise ValueError("trajectory has no times; simulate some to draw")
    rows: Any = (slice(None), *(() if index is None else index if isinstance(index, tuple) else (index,)))
    shape = trajectory.q.shape[1:-1]
    try:
        chosen = trajectory.q[rows].ndim == 2
    except IndexError:
        chosen = False
    if not chosen:
        fix = f"give index, such as {', '.join('0' for _ in shape)}" if shape else "leave index out"
        raise ValueError(f"index is {shown(index)} and trajectory has motions of shape {shape}; {fix}")
    return Animation(trajectory, rows)


class Animation:
    """Frames of a motion; use :func:`animate`."""

    def __init__(self, trajectory: Trajectory, rows: Any) -> None:
        scene = self._scene = trajectory.scene
        self._t, self._q, self._efforts = trajectory.t, trajectory.q[rows], trajectory.efforts[rows]
        self._z = None if trajectory.z is None else trajectory.z[rows]
        points = scene.robot.points(self._q)
        self._tips = points[:, -1]
        self._farthest = float(np.hypot(points[..., 0], points[..., 1]).max())
        self._drawing = Drawing(scene)
        self._limits = np.array(
            [scene.parameters()[name] for name in scene.effort_units() or scene.action_units()]
        )

    def __repr__(self) -> str:
        what = f"{self._scene.robot.kind}, {self._t[-1] - self._t[0]:g} s"
        return f"<Animation of {what}; save('file.gif') or save('file.mp4') writes it>"

    def _repr_html_(self) -> str:
        with tempfile.TemporaryDirectory() as folder:
            video = base64.b64encode(self.save(Path(folder) / "clip.mp4").read_bytes()).decode()
        keys = f"const fps = {FRAMES_PER_SECOND};{KEYS}"
        # JupyterLab has shortcuts for the same keys, which the attribute keeps away.
        does = f'tabindex="0" data-lm-suppress-shortcuts="true" onkeydown="{escape(keys)}"'
        source = f'src="data:video/mp4;base64,{video}"'
        player = f'<video controls autoplay loop muted style="max-width:100%" {does} {source}></video>'
        return f"{player}<p>{KEYS_TOLD}</p>"

    def save(self, path: str | Path) -> Path:
        """Write it as a GIF or an MP4, by the ending of the file's name; ValueError if it ends in neither.
        Gives the path."""
        path = Path(path)
        check_clip(path)
        times = np.arange(self._t[0], self._t[-1] + 1e-9, 1.0 / FRAMES_PER_SECOND)
        rows = np.searchsorted(self._t, times - 1e-9).clip(max=len(self._t) - 1)
        write_clip(path, [self.frame(int(row)) for row in rows], FRAMES_PER_SECOND)
        return path

    def frame(self, row: int) -> NDArray[np.uint8]:
        """The picture of a row of the trajectory, (480, 480, 3) uint8: arm, way of the tip, time, efforts."""
        arm = self._scene.robot
        known: dict[str, float] = {**self._scene.parameters(), **self._scene.attached.states.initial}
        if self._z is not None:
            known |= zip(self._scene.states(), self._z[row].tolist(), strict=True)
        surroundings = self._drawing.surroundings(arm, self._q[row], known)
        canvas = self._drawing.begun(surroundings, self._farthest, BORDER)
        start = int(np.searchsorted(self._t, self._t[row] - TRAIL_SECONDS))
        way = np.unique(np.linspace(start, row, TRAIL_POINTS).round().astype(int))
        canvas.trail(self._tips[way], 3.0, palette.TRAIL, faint=0.1, strong=0.8)
        self._drawing.arm(canvas, arm, self._q[row], known, surroundings)
        for mass, point in zip(arm.masses, arm.points(self._q[row]), strict=True):  # areas show masses
            canvas.disc(point, 9.0 * np.sqrt(mass / max(arm.masses)), palette.JOINT)
        canvas.disc((0.0, 0.0), 8.0, palette.JOINT)
        canvas.disc((0.0, 0.0), 4.0, palette.BACKGROUND)
        if self._limits.all() and self._limits.size:
            canvas.bars((self._efforts[row] / self._limits).tolist(), arm.joints)
        canvas.text(f"time {self._t[row]:.2f} s", MARGIN, MARGIN, palette.INK)
        return canvas.pixels


def energies_figure(motion: Trajectory, name: str) -> Any:
    """Figure 1: kinetic and potential energy; below, the travel of the sliders if there are any."""
    arm, limits = motion.scene.robot, stated_limits(motion.scene)
    sliders = arm.sliders()
    figure, ratios = new_figure(7.0, 5.4 if sliders else 3.6), [3, 2] if sliders else [1]
    panels = figure.subplots(len(ratios), sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
    energy = panels[0]
    kinetic, potential = map(palette.css, (palette.KINETIC, palette.POTENTIAL))
    energy.plot(motion.t, motion.kinetic_energy, color=kinetic, lw=1.4, label="kinetic")
    energy.plot(motion.t, motion.potential_energy, color=potential, lw=1.4, label="potential")
    energy.set_ylabel("energy [J]")
    low, high = (f"{end(motion.kinetic_energy):.3g} J" for end in (np.min, np.max))
    energy.set_title(f"{literal(name)}: the kinetic energy goes from {low} to {high}", loc="left")
    for k, color in zip(sliders, itertools.cycle(map(palette.css, palette.ARMS[0])), strict=False):
        slider = arm.coordinates[k]
        panels[1].plot(motion.t, motion.q[:, k], color=color, lw=1.4, label=slider)
        for i, limit in enumerate(filter(np.isfinite, limits.get(k, ()))):
            label = f"limits of {slider}" if i == 0 else None
            panels[1].axhline(limit, color=color, lw=1.0, ls=(0, (2 + 3 * (k > 1), 2)), label=label)
        panels[1].set_ylabel("travel [m]")
    _finish(panels, motion.t)
    return figure


def total_figure(motion: Trajectory, name: str) -> Any:
    """Figure 2: total energy on the scale of its parts; below, its relative departure."""
    figure, red = new_figure(7.0, 5.0), palette.css(palette.ERROR)
    energy, error = figure.subplots(2, sharex=True, height_ratios=[3, 2])
    parts = motion.potential_energy.min(), motion.kinetic_energy.max()
    energy.update_datalim([(motion.t[0], part) for part in parts])
    if (book := motion.without_springs) is not None:
        energy.plot(motion.t, book, color=palette.css(palette.LEFT_OUT), lw=1.0, label="springs left out")
    energy.plot(motion.t, motion.total, color=palette.css(palette.TOTAL), lw=2.0, label="total")
    if float(np.abs(motion.work).max()) > 1e-12 * motion.scale:
        energy.plot(motion.t, motion.balance, color=red, lw=1.4, ls="--", label="total minus work")
    energy.set_ylabel("energy [J]")
    title = f"{literal(name)}: the total drifts by {motion.drift:.1e}, relative"
    energy.set_title(title, loc="left")
    error.plot(motion.t, motion.relative_error, color=red, lw=1.2, label="relative error")
    error.set_ylabel("error / energy\nexchanged [1]")
    error.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
    _finish((energy, error), motion.t)
    return figure


def _finish(panels: Any, t: NDArray[np.float64]) -> None:
    """Limits, legends and the label of the time."""
    for panel in panels:
        panel.set_xlim(t[0], t[-1])
        bare(panel)
        # Outside, so that a legend never covers a curve.
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    panels[-1].set_xlabel("time [s]")


FIGURES = {"energies": energies_figure, "total": total_figure}
"""By what is between the name of the motion and the ending of the file."""


def save_figures(motion: Trajectory, name: str, folder: Path) -> list[Path]:
    """Write both figures of a motion as PNG; returns their paths."""
    return [save_figure(draw(motion, name), folder / f"{name}_{kind}.png") for kind, draw in FIGURES.items()]
