"""Ways through joint space among discs: straight where that is free, else along a probabilistic road map
(Kavraki, Svestka, Latombe and Overmars 1996), whose edges are examined only where a shortest way uses them
(Bohlin and Kavraki 2000)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.clearance import clearance
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import far_apart
from redundant_envs.control.time_law import evenly

Array = NDArray[np.float64]
FEW, MANY = np.linspace(0.1, 0.9, 5), np.linspace(0.0, 1.0, 31)
"""Shares of a line at which it is examined: at the few first, and the many where these are free."""
NEIGHBOURS = 9  # edges of a node: with more, the ways are hardly shorter, and each round takes longer
LARGEST_TURN = 3.4  # rad from the start, of the poses that are drawn
SEED = 0  # of the poses that are drawn: the way of an episode does not depend on those planned before it
ROUNDS = 60  # blocked ways after which a road map is given up
TRIES = 20  # pairs of points between which each round of shortening tries a line
WORTHWHILE, PATIENCE = 0.05, 2
"""Share of a way that a round of shortening has to save, and rounds in a row that may save less."""


def is_free(
    model: NominalModel, a: Array, b: Array, discs: Array, margin: Any, *shares: Array
) -> NDArray[np.bool_]:
    """Whether the lines in joint space from a to b, (m, joints) each, keep the links farther than ``margin``
    [m], one or (m,), from the discs, (d, 3) or (m, d, 3), at some shares of their lengths."""
    free, least = np.ones(len(a), dtype=np.bool_), np.broadcast_to(margin, len(a))
    discs = np.broadcast_to(discs, (len(a), *discs.shape[-2:]))
    for s in shares or (FEW, MANY):
        some = np.flatnonzero(free)
        line = a[some, None] + s[:, None] * (b - a)[some, None]
        free[some] = clearance(model, line, discs[some, None]).min(axis=1) > least[some]
    return free


def road(
    model: NominalModel, start: Array, ends: Array, discs: Array, margin: float, nodes: int
) -> Array | None:
    """A free way (m, joints) from a pose (joints,) to one of some free poses (k, joints), or None.

    Parameters
    ----------
    model : NominalModel
    start, ends : Array
        The way begins at the one, and ends at the other that is reached first.
    discs : (d, 3) Array
        Centre x, y and radius, m.
    margin : float
        Least distance of the links from the discs, m.
    nodes : int
        Poses that are drawn, the same ones in each call; those that are not free are left out.
    """
    rng = np.random.default_rng(SEED)
    low, high = model.travel
    low = np.where(model.slides, low, start - LARGEST_TURN)
    high = np.where(model.slides, high, start + LARGEST_TURN)
    drawn = rng.uniform(low, high, (nodes, model.joints))
    drawn = drawn[clearance(model, drawn, discs) > margin]
    places = np.concatenate([start[None], ends, drawn])
    apart = far_apart(model, places[:, None], places[None])
    near = np.argsort(apart, axis=1)[:, 1 : NEIGHBOURS + 1]
    a, b = np.repeat(np.arange(len(places)), near.shape[1]), near.ravel()
    a, b = np.unique(np.sort(np.stack([a, b]), axis=0), axis=1)
    edges = np.full_like(apart, np.inf)
    free = is_free(model, places[a], places[b], discs, margin, FEW)
    edges[a[free], b[free]] = edges[b[free], a[free]] = apart[a[free], b[free]]
    left = apart[:, 1 : 1 + len(ends)].min(axis=1)
    known = np.zeros(apart.shape, dtype=np.bool_)  # edges that were examined at many places
    for _ in range(ROUNDS):
        way = _shortest(edges, left, len(ends))
        if way is None:
            return None
        a, b = way[:-1], way[1:]
        unknown = ~known[a, b]
        a, b = a[unknown], b[unknown]
        free = is_free(model, places[a], places[b], discs, margin, MANY)
        known[a, b] = known[b, a] = True
        edges[a[~free], b[~free]] = edges[b[~free], a[~free]] = np.inf
        if free.all():
            return shortened(model, places[way], discs, margin, rng)
    return None


def _shortest(edges: Array, left: Array, ends: int) -> NDArray[np.intp] | None:
    """The nodes of a shortest way from node 0 to one of the nodes 1 to ``ends``, by A* (Hart, Nilsson and
    Raphael 1968): ``left`` is no longer than the way from each node on."""
    cost, back = np.full(len(edges), np.inf), np.zeros(len(edges), dtype=np.intp)
    is_open = np.full(len(edges), np.inf)
    cost[0], is_open[0] = 0.0, left[0]
    while np.isfinite(is_open[node := int(is_open.argmin())]):
        if 1 <= node <= ends:
            way = [node]
            while way[-1]:
                way.append(int(back[way[-1]]))
            return np.array(way[::-1])
        is_open[node] = np.inf
        through = cost[node] + edges[node]
        shorter = through < cost
        cost[shorter], back[shorter] = through[shorter], node
        is_open[shorter] = through[shorter] + left[shorter]
    return None


def shortened(
    model: NominalModel, way: Array, discs: Array, margin: float, rng: np.random.Generator
) -> Array:
    """The way (m, joints) with shortcuts: in each round, that line between two of its points that is free
    and saves most."""
    stale = 0
    while stale < PATIENCE:
        points = evenly(model, way, 4 * TRIES)
        i, j = np.sort(rng.integers(0, len(points), (2, TRIES)), axis=0)
        step = far_apart(model, points[1], points[0])
        saved = (j - i) * step - far_apart(model, points[i], points[j])
        saved[~is_free(model, points[i], points[j], discs, margin)] = 0.0
        best = saved.argmax()
        stale = 0 if saved[best] > WORTHWHILE * len(points) * step else stale + 1
        if saved[best] > 0.0:
            way = np.concatenate([points[: i[best] + 1], points[j[best] :]])
    return way
