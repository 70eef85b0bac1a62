"""The expert of ReachAround: a pose at the goal that is clear of all discs, and a free way to it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.clearance import clearance, discs_of
from redundant_envs.control.following import Following
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import far_apart, pose_at, poses_at
from redundant_envs.control.road_map import is_free, road
from redundant_envs.control.time_law import evenly, quickest, rounded, timed
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
GRID = 13  # of the poses at a goal: neighbours are 0.26 rad apart at most, and there is a way around them
MARGINS = (0.015, 0.006)  # m, of the links from discs: the second where the first leaves no way
CLOSE = 16  # poses to which a straight way is tried, and which a road map may end in
NODES = (150, 400)  # of the first road map, and of those where it has no way
WIDTHS = (0.1, 0.05, 0.02, 0.0)  # of the rounding of corners: the largest that leaves a way free
TIMES = np.array([0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4])  # s, of the motion
MOST_EFFORT = 0.9  # of a limit: the rest is for the feedback
MOST_AT_REST = 0.85  # of a limit, at the goal: a pose that takes more has too little left to settle


class Around:
    """Plans for all lanes at once where a straight way is free, and by a road map for each of the others."""

    def __init__(self, scene: Scene, seed: int = 0) -> None:
        self.model = NominalModel(scene)
        self.following = Following(self.model)
        self.rng = np.random.default_rng(seed)

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        """Plan new episodes; see :class:`~redundant_envs.control.experts.Expert`."""
        model, start = self.model, q @ self.model.b
        discs = discs_of(model.scene, numbers)
        poses, costs = free_poses(model, start, goal, discs)
        ways = ways_to(model, start, poses, costs, discs, self.rng)
        near = pose_at(model.scene, q, goal) @ model.b
        lines = [np.stack([a, b]) if way is None else way for a, b, way in zip(start, near, ways, strict=True)]
        even = smooth(model, np.stack([evenly(model, way) for way in lines]), discs)
        seconds, _ = quickest(model, even, TIMES, MOST_EFFORT)
        self.following.begin(timed(even, seconds, self.following.dt, STEPS), index)

    def action(self, t: Array, q: Array, qd: Array) -> NDArray[np.float32]:
        return self.following.action(t, q, qd)


STEPS = 125  # of a motion: the longest of the times


def free_poses(model: NominalModel, start: Array, goal: Array, discs: Array) -> tuple[Array, Array]:
    """The nearest poses (n, CLOSE, joints) at goals, and their distances from the start, (n, CLOSE): infinite
    where a pose is too near a disc or too heavy. Joint 1 may come to each from either side."""
    poses = poses_at(model, goal, start, GRID)
    gaps = clearance(model, poses, discs[:, None])
    loads = model.loads_at_rest(poses).max(axis=-1)
    fit = (gaps > MARGINS[-1]) & (loads < MOST_AT_REST)
    tight = np.where(gaps > MARGINS[0], 0.0, TIGHT)
    turn = 2.0 * np.pi * np.eye(model.joints)[0]
    turned = np.concatenate([poses - turn, poses, poses + turn], axis=1)
    costs = far_apart(model, turned, start[:, None]) + np.tile(tight, 3)
    return spread(turned, np.where(np.tile(fit, 3), costs, np.inf))


def spread(poses: Array, costs: Array) -> tuple[Array, Array]:
    """The CLOSE cheapest of the poses (n, m, joints) with costs (n, m), and as many from all with finite
    costs, in even steps of their order."""
    order = np.argsort(costs, axis=1)
    steps = np.linspace(0.0, 1.0, CLOSE) * (np.isfinite(costs).sum(axis=1, keepdims=True) - 1)
    places = np.concatenate([np.tile(np.arange(CLOSE), (len(costs), 1)), np.maximum(steps, 0.0)], axis=1)
    order = np.take_along_axis(order, places.astype(np.intp) % order.shape[1], axis=1)
    return np.take_along_axis(poses, order[..., None], axis=1), np.take_along_axis(costs, order, axis=1)


TIGHT = 100.0  # distance that is added to poses with the smaller margin: they are the last choice


def ways_to(
    model: NominalModel, start: Array, poses: Array, costs: Array, discs: Array, rng: np.random.Generator
) -> list[Array | None]:
    """A free way (m, joints) from each start (n, joints) to one of its poses (n, k, joints) with finite
    costs (n, k), the cheapest first; None where there is none."""
    ways: list[Array | None] = [None] * len(start)
    for lanes, few in ((np.arange(len(start)), slice(0, 4)), (None, slice(4, 2 * CLOSE))):
        if lanes is None:
            lanes = np.flatnonzero([way is None for way in ways])
        lane, k = np.nonzero(np.isfinite(costs[lanes, few]))
        lane, k = lanes[lane], k + few.start
        margin = np.where(costs[lane, k] < TIGHT, MARGINS[0], MARGINS[1])
        free = is_free(model, start[lane], poses[lane, k], discs[lane], margin)
        for i, j in zip(lane[free][::-1].tolist(), k[free][::-1].tolist(), strict=True):
            ways[i] = np.stack([start[i], poses[i, j]])
    for lane in np.flatnonzero([way is None for way in ways]).tolist():
        for margin in MARGINS:
            ends = poses[lane, costs[lane] < (TIGHT if margin == MARGINS[0] else np.inf)]
            for nodes in NODES:
                if ways[lane] is None and len(ends):
                    ways[lane] = road(model, start[lane], ends, discs[lane], margin, nodes, rng)
    return ways


def smooth(model: NominalModel, ways: Array, discs: Array) -> Array:
    """Ways (n, points, joints) with rounded corners, as far as this leaves them free."""
    left = np.arange(len(ways))
    ways = ways.copy()
    for width in WIDTHS:
        trial = rounded(ways[left], width)
        fits = (clearance(model, trial, discs[left, None]) > 0.5 * MARGINS[-1]).all(axis=1)
        if width == 0.0:
            break
        ways[left[fits]] = trial[fits]
        left = left[~fits]
    return ways
