"""The expert of ReachLight: of the poses that load no motor by more than a share of its limit, the nearest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.following import Following
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import cheapest, far_apart, lightest_pose, poses_at
from redundant_envs.control.time_law import quickest, timed
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
GRID = 17  # of the poses at a goal
SHARE = 0.93  # of the load that counts as light, in the pose: the rest is for the feedback
NEAR_GOAL = 0.95  # of the tolerance: how far the tip rests from a goal that is lighter held beside it
TIMES = np.array([0.9, 1.0, 1.1, 1.2, 1.3, 1.4])  # s, of the motion
MOST_EFFORT = 0.9  # of a limit
REDUNDANT = 4  # joints of the arms whose lightest pose is known
STEPS = 70  # of a motion: the longest of the times


class Light:
    """Straight ways to light poses, for all lanes at once."""

    def __init__(self, scene: Scene) -> None:
        self.model = NominalModel(scene)
        self.following = Following(self.model)

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        """Plan new episodes; see :class:`~redundant_envs.control.experts.Expert`."""
        model, start, light = self.model, q @ self.model.b, numbers["light"]
        poses = poses_at(model, goal, start, GRID)
        loads = model.loads_at_rest(poses).max(axis=-1)
        far = far_apart(model, poses, start[:, None])
        ends, costs = cheapest(poses, np.where(loads < SHARE * light[:, None], far, np.inf), 1)
        ends, heavy = ends[:, 0], np.flatnonzero(np.isinf(costs[:, 0]))
        if model.joints == REDUNDANT:
            tolerance = NEAR_GOAL * numbers["goal_tolerance"].min() * model.lengths_beyond[0]
            ends[heavy] = lightest_pose(model.static, q[heavy], goal[heavy], tolerance) @ model.b
        else:
            ends[heavy] = cheapest(poses[heavy], loads[heavy], 1)[0][:, 0]
        ways = np.linspace(start, ends, 41, axis=1)
        seconds, _ = quickest(model, ways, TIMES, MOST_EFFORT)
        self.following.begin(timed(ways, seconds, self.following.dt, STEPS), index)

    def action(self, t: Array, q: Array, qd: Array) -> NDArray[np.float32]:
        return self.following.action(t, q, qd)
