"""Free ways among discs for many lanes: straight where that is free, else by a road map; corners rounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.clearance import clearance
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.road_map import is_free, road
from redundant_envs.control.time_law import evenly, rounded

Array = NDArray[np.float64]
MARGINS = (0.015, 0.006)  # m, of the links from discs: the second where the first leaves no way
TIGHT = 100.0  # added to the cost of poses that have the smaller margin alone: they are the last choice
FIRST = 4  # poses to which a straight way is tried before the others
MAPS = ((MARGINS[0], 150), (MARGINS[0], 400), (MARGINS[1], 1000))
"""Margins and numbers of nodes of the road maps that are tried, while there is no way."""
WIDTHS = (0.1, 0.05, 0.02)  # of the rounding of corners: the largest that leaves a way free
LEAST = 0.003  # m, from discs, of a rounded way


def ways_to(model: NominalModel, start: Array, poses: Array, costs: Array, discs: Array) -> list[Array]:
    """Ways, polylines (m, joints), to the cheapest poses that can be reached.

    Parameters
    ----------
    model : NominalModel
    start, poses, costs, discs : (n, joints), (n, k, joints), (n, k) and (n, d, 3) Arrays
        The cheapest pose comes first; infinite is the cost of one that does not serve.

    Returns
    -------
    list of Arrays
        Where there is no free way it is straight to the first pose.
    """
    ways: list[Array | None] = [None] * len(start)
    for some in (slice(0, FIRST), slice(FIRST, None)):
        left = np.array([lane for lane, way in enumerate(ways) if way is None], dtype=np.intp)
        row, k = np.nonzero(np.isfinite(costs[left, some]))
        lane, k = left[row], k + some.start
        margins = np.where(costs[lane, k] < TIGHT, *MARGINS)
        free = is_free(model, start[lane], poses[lane, k], discs[lane], margins)
        for i, j in zip(lane[free][::-1].tolist(), k[free][::-1].tolist(), strict=True):
            ways[i] = np.stack([start[i], poses[i, j]])
    for i in (i for i, way in enumerate(ways) if way is None):
        for margin, nodes in MAPS:
            ends = poses[i, costs[i] < (TIGHT if margin == MARGINS[0] else np.inf)]
            if ways[i] is None and len(ends):
                ways[i] = road(model, start[i], ends, discs[i], margin, nodes)
    straight = np.stack([start, poses[:, 0]], axis=1)
    return [line if way is None else way for way, line in zip(ways, straight, strict=True)]


def smooth_ways(model: NominalModel, ways: list[Array], discs: Array) -> Array:
    """Ways (n, points, joints) at even points of polylines, whose corners are rounded as far as that leaves
    them free of the discs (n, d, 3)."""
    even = np.stack([evenly(model, way) for way in ways])
    left = np.flatnonzero([len(way) > 2 for way in ways])
    for width in WIDTHS:
        trial = rounded(even[left], width)
        fits = (clearance(model, trial, discs[left, None]) > LEAST).all(axis=1)
        even[left[fits]] = trial[fits]
        left = left[~fits]
    return even
