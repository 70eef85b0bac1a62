"""The expert of ReachAround: a pose at the goal that is clear of all discs, and a free way to it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.clearance import clearance, discs_of
from redundant_envs.control.experts.planned import Planned
from redundant_envs.control.poses import far_apart, poses_at
from redundant_envs.control.time_law import Motion, latest_end, quickest, timed
from redundant_envs.control.ways import MARGINS, TIGHT, smooth_ways, ways_to

Array = NDArray[np.float64]
GRID = 13  # of the poses at a goal: the arm has a way around those between two of them
CLOSE = 16  # nearest poses to which ways are tried, and as many from among all
TIMES = np.array([0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4])  # s, of the motion, where there is time
MOST_EFFORT = 0.9  # of a limit, in the motion: the rest is for the feedback
MOST_AT_REST = 0.85  # of a limit, at the goal


class ReachAround(Planned):
    """Plans for all lanes at once where a straight way is free, and by a road map in each other lane."""

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        model, discs = self.model, discs_of(self.model.scene, numbers)
        poses, costs = self._ends(start, poses_at(model, goal, start, GRID), discs)
        ways = smooth_ways(model, ways_to(model, start, poses, costs, discs), discs)
        times = np.minimum(TIMES[:, None], latest_end(numbers, self.dt))
        seconds, _ = quickest(model, ways, times, MOST_EFFORT)
        return timed(ways, seconds, self.dt, int(np.rint(TIMES[-1] / self.dt)))

    def _ends(self, start: Array, poses: Array, discs: Array) -> tuple[Array, Array]:
        """Poses (n, 2 CLOSE, joints) for the end of a motion, and their costs, infinite where a pose is too
        near a disc or too heavy: the nearest, and others in even steps of their order."""
        model = self.model
        gaps = clearance(model, poses, discs[:, None])
        fit = (gaps > MARGINS[-1]) & (model.loads_at_rest(poses).max(axis=-1) < MOST_AT_REST)
        extra = np.where(fit, np.where(gaps > MARGINS[0], 0.0, TIGHT), np.inf)
        turn = 2.0 * np.pi * np.eye(model.joints)[0]  # joint 1 may come to a pose from either side
        poses = np.concatenate([poses - turn, poses, poses + turn], axis=1)
        far, extra = far_apart(model, poses, start[:, None]), np.tile(extra, 3)
        costs, order = far + extra, np.lexsort((far, extra), axis=1)
        last = np.maximum(np.isfinite(costs).sum(axis=1, keepdims=True) - 1, 0)
        others = (np.linspace(0.0, 1.0, CLOSE) * last).astype(np.intp)
        nearest = np.broadcast_to(np.arange(CLOSE) % costs.shape[1], others.shape)
        order = np.take_along_axis(order, np.concatenate([nearest, others], axis=1), axis=1)
        return np.take_along_axis(poses, order[..., None], axis=1), np.take_along_axis(costs, order, axis=1)
