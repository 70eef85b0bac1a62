"""The expert of TrackAround: as that of Track, with poses, paths and ways that keep clear of the discs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.around import smooth, ways_to
from redundant_envs.control.clearance import clearance, clearance_slopes, discs_of
from redundant_envs.control.time_law import evenly
from redundant_envs.control.track import Track
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
WIDE = 0.07  # m, of clearance from which on links are pushed away from a disc
PUSH = 12.0  # 1/s, how quickly
ENOUGH_CLEARANCE = 0.006
CLEAR = 20.0


class TrackAround(Track):
    STEPS = 240

    def __init__(self, scene: Scene, seed: int = 0) -> None:
        super().__init__(scene)
        self.rng = np.random.default_rng(seed)

    def prepare(self, numbers):
        self.discs = discs_of(self.model.scene, numbers)

    def first_cost(self, poses, start):
        gap = clearance(self.model, poses, self.discs[:, None])
        return super().first_cost(poses, start) - CLEAR * np.minimum(gap, 0.06)

    def posture(self, phi, lanes):
        gap, slopes = clearance_slopes(self.model, phi, self.discs[lanes])
        push = np.clip((WIDE - gap) / WIDE, 0.0, 1.5)
        return 0.6 * super().posture(phi, lanes) + PUSH * (push[..., None] * slopes).sum(axis=1)

    def ways(self, start, first, lanes):
        found = ways_to(self.model, start, first[:, None], np.zeros((len(first), 1)), self.discs[lanes], self.rng)
        ways = [np.stack([a, b]) if way is None else way for a, b, way in zip(start, first, found, strict=True)]
        return smooth(self.model, np.stack([evenly(self.model, way) for way in ways]), self.discs[lanes])

    def cost(self, motion, targets, lanes):
        gap = clearance(self.model, motion.phi, self.discs[lanes, None]).min(axis=1)
        return super().cost(motion, targets, lanes) + 100.0 * np.maximum(ENOUGH_CLEARANCE - gap, 0.0)
