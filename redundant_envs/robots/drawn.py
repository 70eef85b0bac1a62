"""Drawings of arms as SVG, without any library and any script.

An arm is drawn if it has a point mass behind each joint.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support import palette
from redundant_envs.support.notebook import escaped, table

Points = NDArray[np.float64]
WIDTH, HEIGHT, MARGIN = 380.0, 250.0, 34.0  # px
PAPER, INK, SOFT, RAIL = map(palette.css, (palette.BACKGROUND, palette.JOINT, palette.SOFT, palette.RAIL))
LINKS = [tuple(map(palette.css, colors)) for colors in palette.ARMS]
MAX_ARMS = len(LINKS)
UP, DOWN = 0.9, 0.2
"""Directions of the links in a schematic, rad, in turn: a zigzag to the right shows every joint."""
ARC = 24.0  # px, radius of the arc that shows an angle
LONGEST_RAIL = 5.0  # in units of the arm; beyond it the arm would be a dot
MAX_POINTS = 300  # of the way of a tip


def schematic(arm: Any, travel: Mapping[int, tuple[float, float]] | None = None) -> str:
    """An arm with its angles and the names of its coordinates, masses and lengths; sliders on rails of a
    ``travel`` [m]."""
    size, rails = sum(arm.lengths) or 1.0, []
    phi, up = [], False
    travel = {k: ends for k, ends in (travel or {}).items() if ends[1] - ends[0] <= LONGEST_RAIL * size}
    for k, slides in enumerate(arm.prismatic):
        if slides:
            phi.append(sum(travel[k]) / 2.0 if k in travel else 0.6 * size / max(len(arm.lengths), 1))
        else:
            up = not up
            phi.append(UP if not any(phi) or all(arm.prismatic[:k]) else (UP - DOWN if up else DOWN - UP))
    q = _pose(arm, phi)
    ends = _ends(arm, q)
    for k, (low, high) in travel.items():
        if arm.prismatic[k]:
            moved = _ends(arm, _pose(arm, [x + size * (i == k) for i, x in enumerate(phi)]))
            along = (moved - ends)[k + 1] / size
            rails.append(ends[k + 1] + np.outer([low - phi[k], high - phi[k]], along))
    placed = _Placed([ends, *rails])
    at = placed(ends)
    parts = [_path(_line(placed(rail)), RAIL, 13.0) for rail in rails]
    parts += [_path(*path) for path in _paths(arm, at, 0)]
    names = iter(f"l{k + 1}" for k in range(arm.num_lengths))
    length_per_link = arm.num_lengths == arm.prismatic.count(False)
    for k, (a, b) in enumerate(itertools.pairwise(at)):
        x, y = 0.5 * (a + b) + 15.0 * np.array([b[1] - a[1], a[0] - b[0]]) / max(np.hypot(*(b - a)), 1.0)
        if arm.prismatic[k]:
            parts.append(_name(x, y, arm.coordinates[k], INK))
        else:
            if np.isclose(q[k], np.arctan2(a[1] - b[1], b[0] - a[0])):  # an absolute angle
                turn = np.linspace(0.0, q[k], 24)[:, None]
                arc = _line(a + ARC * np.hstack([np.cos(turn), -np.sin(turn)]))
                side = _line((a, a + np.array([ARC + 10.0, 0.0])))
                parts.append(_path(side + arc, INK, 1.0))
            parts.append(_name(a[0] + 32.0, a[1] + 13.0, arm.coordinates[k], INK))
            parts += [_name(x, y, next(names), SOFT)] if length_per_link else []
        parts.append(_name(b[0] - 9.0, b[1] - 12.0, f"m{k + 1}", SOFT))
    return _picture(parts, f"{arm.kind} with its coordinates, masses and lengths")


def numbers(arm: Any) -> str:
    """Masses, lengths and coordinates of an arm, with units, as a table."""
    rows = [(kind, _list(getattr(arm, kind)), arm.units.get(kind, "")) for kind in ("masses", "lengths")]
    units = ["m" if slides else "rad" for slides in arm.prismatic]
    rows.append(("coordinates", _list(arm.coordinates), _list(units)))
    return table((arm.kind, "", "unit"), [row for row in rows if row[1]])


def motions(arm: Any, q: Points) -> str:
    """The ways of the tips, and the last poses, of motions (T, arms, joints) of an arm: the first
    :data:`MAX_ARMS` of them, as long as all are finite."""
    ends = _ends(arm, q[:, :MAX_ARMS])
    ends = ends[np.isfinite(ends).all(axis=(1, 2, 3))]
    if not len(ends):
        raise ValueError("no pose of the motion is finite")
    at = _Placed([ends])(ends)
    rows = np.unique(np.linspace(0, len(at) - 1, MAX_POINTS).astype(int))
    ways = [_path(_line(at[rows, k, -1]), LINKS[k][1], 1.5) for k in range(at.shape[1])]
    poses = [_path(*path) for k in range(at.shape[1]) for path in _paths(arm, at[-1, k], k)]
    return _picture([*ways, *poses], f"{arm.kind} at the end of its motion, and the way of its tip")


def _list(values: Sequence[Any]) -> str:
    return ", ".join(f"{x:.6g}" if isinstance(x, float) else str(x) for x in values)


def _pose(arm: Any, phi: list[float]) -> Points:
    return np.array([float(x) for x in arm.coordinates_of_joints(*phi)])


def _ends(arm: Any, q: Points) -> Points:
    """Base and point masses in poses (..., joints): (..., 1 + masses, 2), m."""
    if arm.num_masses != len(arm.joints):
        raise ValueError(f"{arm.kind} has {arm.num_masses} point masses and {len(arm.joints)} joints")
    points = arm.points(q)
    return np.concatenate([np.zeros((*points.shape[:-2], 1, 2)), points], axis=-2)


class _Placed:
    """Positions in a picture, px, of points (..., 2), m: all that are given fit into it."""

    def __init__(self, points: Sequence[Points]) -> None:
        every = np.concatenate([x.reshape(-1, 2) for x in points])
        self.low, high = every.min(axis=0), every.max(axis=0)
        inside = np.array([WIDTH, HEIGHT]) - 2.0 * MARGIN
        self.unit = float(((high - self.low) / inside).max()) or 1.0
        self.corner = 0.5 * (np.array([WIDTH, HEIGHT]) - (high - self.low) / self.unit)

    def __call__(self, points: Points) -> Points:
        at: Points = (points - self.low) / self.unit + self.corner
        if not np.isfinite(at).all():
            raise ValueError("an arm of this size cannot be drawn")
        at[..., 1] = HEIGHT - at[..., 1]
        return at


def _paths(arm: Any, ends: Points, k: int) -> list[tuple[str, str, float]]:
    """Paths of sliders, links, masses and base of the arm k, with its ends at (1 + masses, 2) px: the data of
    each, its colour and its width."""
    dark, light = LINKS[k]
    runs, start = [], 0
    for slides, joints in itertools.groupby(arm.prismatic):
        runs.append((slides, start, start := start + len([*joints])))
    paths = []
    for kind, color, width in ((True, light, 5.0), (False, dark, 7.0)):
        spans = [(first, last + 1) for slides, first, last in runs if slides == kind]
        if spans:
            paths.append(("".join(_line(ends[first:last]) for first, last in spans), color, width))
    base, *dots = (_line([end] * 2) for end in ends)
    return [*paths, ("".join(dots), INK, 11.0), (base, RAIL, 13.0)]


def _line(points: Any) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _path(data: str, color: str, width: float) -> str:
    return f'<path d="{data}" stroke="{color}" stroke-width="{width:g}"/>'


def _name(x: float, y: float, name: str, color: str) -> str:
    return f'<text x="{x:.1f}" y="{y + 4.0:.1f}" fill="{color}">{escaped(name)}</text>'


def _picture(parts: Sequence[str], what: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" '
        f'height="{HEIGHT:g}" role="img" aria-label="{escaped(what)}" fill="none" stroke-linecap="round" '
        f'stroke-linejoin="round" font-family="sans-serif" font-size="12" text-anchor="middle">'
        f'<rect width="100%" height="100%" rx="8" fill="{PAPER}"/>{"".join(parts)}</svg>'
    )
