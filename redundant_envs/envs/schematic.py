"""Schematics of both arms, which explain their coordinates, lengths and masses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.rendering import BACKGROUND, JOINT, LINKS, RAIL, TRAIL
from redundant_envs.robots import RPRP, Arm, FourR
from redundant_envs.support.figures import new_figure, save_figure

Point = NDArray[np.float64]
Color = tuple[float, float, float]

INK, SOFT = "#1c2434", "#8a93a3"
SLIDER_TRAVEL, LENGTH = 0.7, 0.68  # m
LEGEND = ("Angles are absolute, from the direction of +x.", "A motor acts at every joint.")
OF_SLIDERS = "Grey rails are the travel of the sliders between their stops."


class Drawing(NamedTuple):
    """How an arm is drawn; widths and offsets are in printer's points."""

    title: str
    arm: Arm
    pose: tuple[float, ...]  # rad and m
    view: tuple[float, ...]  # ends of the axes, m
    widths: tuple[float, ...]  # of the links
    sides: tuple[float, ...]  # m by which the dimension of each link is to its left
    offsets: tuple[tuple[float, float], ...]  # of the names of the point masses


DRAWN = {
    "RPRP": Drawing(
        "RPRP", RPRP((1.0,) * 4, (LENGTH, 0.6)), (0.82, 0.36, -0.6, 0.32), (-0.3, 2.35, -0.2, 1.35),
        (15, 6, 12, 6), (0.17, 0.17, -0.17, -0.17), ((16, -12), (29, 12), (10, 18), (34, 14)),
    ),
    "FourR": Drawing(
        "4R", FourR((1.0,) * 4, (LENGTH,) * 4), (1.2, 0.62, -0.62, 0.72), (-0.3, 2.65, -0.2, 1.5),
        (15, 12.5, 10.5, 9), (0.16, 0.16, -0.16, 0.16), ((17, -12), (2, 18), (8, -18), (36, -6)),
    ),
}  # fmt: skip
"""Drawings by the kinds of the arms."""


def shade(color: tuple[int, int, int]) -> Color:
    """A colour of the renderer in matplotlib's form."""
    return color[0] / 255, color[1] / 255, color[2] / 255


def toward(angle: float) -> Point:
    """Unit vector at an angle from +x, rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def arrow(
    axes: Any, to: Any, start: Any, style: str, color: str, width: float, size: int, **options: Any
) -> None:
    """An arrow without a text."""
    shape = {"arrowstyle": style, "lw": width, "mutation_scale": size, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", to, start, arrowprops={**shape, "color": color}, **options)


def angle_mark(axes: Any, place: Point, angle: float, number: int, radius: float = 0.27) -> None:
    """An absolute angle: an arc from the direction of +x, with its name in its middle."""
    reach = place + (radius + 0.13) * toward(0.0)
    axes.plot(*zip(place, reach, strict=True), color=SOFT, lw=0.9, ls=(0, (4, 3)), zorder=1)
    arc = np.array([place + radius * toward(t) for t in np.linspace(0.0, angle, 40)])
    axes.plot(*arc[:-3].T, color=INK, lw=1.1, zorder=4)
    arrow(axes, arc[-1], arc[-5], "-|>", INK, 1.1, 9, zorder=4)
    name = place + (radius + 0.1) * toward(0.5 * angle)
    axes.text(*name, rf"$\theta_{number}$", ha="center", va="center", fontsize=13, color=INK, zorder=8)


def dimension(axes: Any, a: Point, b: Point, name: str, side: float) -> None:
    """A length beside a link, ``side`` m to its left, with its name."""
    along = (b - a) / np.linalg.norm(b - a)
    across = side * np.array([-along[1], along[0]])
    for end in (a, b):
        near, far = end + 0.55 * across, end + 1.12 * across
        axes.plot(*zip(near, far, strict=True), color=SOFT, lw=0.8, zorder=2)
    arrow(axes, a + across, b + across, "<|-|>", SOFT, 0.9, 8, zorder=2)
    axes.text(*(0.5 * (a + b) + 1.62 * across), name, ha="center", va="center", fontsize=13, color=INK)


def ground(axes: Any) -> None:
    """The base, hatched."""
    axes.plot((-0.16, 0.16), (-0.075, -0.075), color=INK, lw=1.6, zorder=2)
    for x in np.linspace(-0.13, 0.16, 6):
        axes.plot((x, x - 0.05), (-0.075, -0.135), color=INK, lw=0.9, zorder=2)
    axes.fill((-0.09, 0.09, 0.0), (-0.075, -0.075, 0.03), color=shade(RAIL), zorder=2)


def draw(axes: Any, drawing: Drawing) -> None:
    """An arm with its angles, lengths and masses."""
    arm, pose, number = drawing.arm, drawing.pose, 0
    points = arm.points(np.array(pose))
    roots = [np.zeros(2), *points]
    ground(axes)
    for k, (root, end, slides) in enumerate(zip(roots, points, arm.prismatic, strict=False)):
        if slides:
            along = toward(pose[k - 1])
            stops, across = (root, root + SLIDER_TRAVEL * along), 0.07 * np.array([-along[1], along[0]])
            axes.plot(*zip(*stops, strict=True), color=shade(RAIL), lw=7, solid_capstyle="butt", zorder=2)
            for stop in stops:
                ends = zip(stop - across, stop + across, strict=True)
                axes.plot(*ends, color=shade(JOINT), lw=2.0, zorder=2)
            axes.plot(*root, "o", ms=6, color=shade(JOINT), zorder=6)
        else:
            number += 1
            angle_mark(axes, root, pose[k], number)
            axes.plot(*root, "o", ms=9, mfc=shade(BACKGROUND), mec=shade(JOINT), mew=2.2, zorder=6)
        line = zip(root, end, strict=True)
        color, width = shade(LINKS[k]), drawing.widths[k]
        axes.plot(*line, color=color, lw=width, solid_capstyle="round", zorder=3)
        dimension(axes, root, end, f"${'r' if slides else 'l'}_{number}$", drawing.sides[k])
        name = rf"$m_{k + 1}$" + ("  (tip)" if k == len(points) - 1 else "")
        axes.annotate(name, end, drawing.offsets[k], textcoords="offset points", ha="center", va="center",
                      fontsize=12, color=INK, zorder=8)  # fmt: skip
    axes.plot(*points[-1], "o", ms=11, color=shade(TRAIL), zorder=7)


def save_schematic(path: Path, kinds: Sequence[str] = tuple(DRAWN)) -> Path:
    """Draw arms of ``DRAWN`` side by side, by default all, as SVG or PNG by the ending of the name."""
    for kind in kinds:
        if kind not in DRAWN:
            raise ValueError(f"the arm is a {kind}; only {' and '.join(DRAWN)} have a drawing")
    figure = new_figure(5.5 * len(kinds), 4.3)
    figure.set_facecolor(shade(BACKGROUND))
    for axes, kind in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        drawing = DRAWN[kind]
        view = drawing.view
        draw(axes, drawing)
        axes.set_title(drawing.title, fontsize=14, color=INK, loc="left", fontweight="bold")
        x, y = view[0] + 0.12, view[3] - 0.05  # of the arrow of gravity
        arrow(axes, (x, y - 0.3), (x, y), "-|>", SOFT, 1.6, 13)
        axes.text(x + 0.06, y - 0.15, "$g$", fontsize=13, color=INK, va="center")
        axes.set(xlim=view[:2], ylim=view[2:], aspect="equal")
        axes.set_axis_off()
    legend = (" " if len(kinds) > 1 else "\n").join((*LEGEND, *[OF_SLIDERS] * ("RPRP" in kinds)))
    figure.supxlabel(legend, fontsize=10, color=INK)
    return save_figure(figure, path, dpi=160, facecolor=figure.get_facecolor())
