"""The baseline of tracking tasks, which uses no null space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts.track import Lanes, Track
from redundant_envs.control.poses import pose_at

Array = NDArray[np.float64]


class NearestPose(Track):
    """Follows the curve from the nearest first pose, with no rates in the null space."""

    steps = 240  # of the longest episodes

    def _firsts(self, start: Array, first: Array, soon: Array) -> Array:
        near = pose_at(self.model.scene, start @ self.model.inverse, first) @ self.model.b
        return near[:, None]

    def _posture(self, phi: Array, lanes: Lanes) -> Array:
        return np.zeros_like(phi)
