"""The expert of TrackAround: as that of Track, with first poses, paths and ways that keep clear of discs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.clearance import clearance, clearance_slopes, discs_of
from redundant_envs.control.experts.track import PER_ERROR, Lanes, Track
from redundant_envs.control.road_map import is_free
from redundant_envs.control.time_law import Motion
from redundant_envs.control.ways import MARGINS, smooth_ways, ways_to
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
WIDE = 0.07  # m: links that are nearer to a disc are pushed away from it
PUSH, STRONGEST = 12.0, 1.5  # rad/s per rad/m: the rates at a disc's surface, and the largest, in those
MOBILITY = 0.6  # weight of mobility, 1 without discs
BLOCKED = 8.0  # distance in joint space that is gone for a straight way
CLEAR, CLEAR_ENOUGH = 20.0, 0.06  # distance in joint space that a metre of clearance is worth, up to so much


class TrackAround(Track):
    """Way to the curve by a road map where it is not free, and repulsion from discs in the null space."""

    steps = 240

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._discs = np.zeros((0, 0, 3))

    def _plan(self, start: Array, numbers: Mapping[str, Array], wait: int, steps: int) -> Motion:
        self._discs = discs_of(self.model.scene, numbers)
        return super()._plan(start, numbers, wait, steps)

    def _first_costs(self, poses: Array, start: Array) -> Array:
        gaps = clearance(self.model, poses, self._discs[:, None])
        return super()._first_costs(poses, start) - CLEAR * np.minimum(gaps, CLEAR_ENOUGH)

    def _line_costs(self, start: Array, first: Array, soon: Array, lanes: Lanes) -> Array:
        free = is_free(self.model, start, first, self._discs[lanes], MARGINS[0])
        return super()._line_costs(start, first, soon, lanes) + np.where(free, 0.0, BLOCKED)

    def _posture(self, phi: Array, lanes: Lanes) -> Array:
        rates = MOBILITY * super()._posture(phi, lanes)
        near = np.flatnonzero(clearance(self.model, phi, self._discs[lanes]) < WIDE)
        gaps, slopes = clearance_slopes(self.model, phi[near], self._discs[lanes[near]])
        push = PUSH * np.clip(1.0 - gaps / WIDE, 0.0, STRONGEST)
        rates[near] += (push[..., None] * slopes).sum(axis=1)
        return rates

    def _ways(self, start: Array, first: Array, lanes: Lanes) -> Array:
        discs, free = self._discs[lanes], np.zeros((len(first), 1))
        return smooth_ways(self.model, ways_to(self.model, start, first[:, None], free, discs), discs)

    def _costs(self, motion: Motion, targets: Array, since: Array, lanes: Lanes) -> Array:
        gaps = clearance(self.model, motion.phi, self._discs[lanes, None]).min(axis=1)
        lacking = np.maximum(MARGINS[-1] - gaps, 0.0)
        return super()._costs(motion, targets, since, lanes) + PER_ERROR * lacking
