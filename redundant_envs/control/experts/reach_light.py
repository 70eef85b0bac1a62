"""The expert of ReachLight: of the poses that load no motor beyond a share of its limit, the nearest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts.planned import Planned
from redundant_envs.control.poses import cheapest, far_apart, lightest_pose, poses_at
from redundant_envs.control.time_law import Motion, latest_end, quickest, timed

Array = NDArray[np.float64]
GRID = 17  # of the poses at a goal
SHARE = 0.93  # of the load that counts as light, in the nearest pose: the rest is for the feedback
NEAR_GOAL = 0.95  # of the tolerance: how far the tip may rest from a goal that is lighter held beside it
TIMES = np.array([0.9, 1.0, 1.1, 1.2, 1.3, 1.4])  # s, of the motion, where there is time
MOST_EFFORT = 0.9  # of a limit, in the motion: the rest is for the feedback


class ReachLight(Planned):
    """Straight ways to light poses, for all lanes at once."""

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        model, most = self.model, SHARE * numbers["light"][:, None]
        poses = poses_at(model, goal, start, GRID)
        loads, far = model.loads_at_rest(poses).max(axis=-1), far_apart(model, poses, start[:, None])
        ends, costs = (x[:, 0] for x in cheapest(poses, np.where(loads < most, far, np.inf), 1))
        heavy = np.flatnonzero(np.isinf(costs))
        if len(heavy):
            tolerance = NEAR_GOAL * numbers["goal_tolerance"].min() * model.lengths_beyond[0]
            q = lightest_pose(model.static, start[heavy] @ model.inverse, goal[heavy], tolerance)
            ends[heavy] = q @ model.b
        ways = np.linspace(start, ends, 3, axis=1)
        times = np.minimum(TIMES[:, None], latest_end(numbers, self.dt))
        seconds, _ = quickest(model, ways, times, MOST_EFFORT)
        return timed(ways, seconds, self.dt, int(np.rint(TIMES[-1] / self.dt)))
