"""The values of single joints with which a goal can be held: what is left when a joint stops where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.nominal import NominalModel

Array = NDArray[np.float64]
BINS = 72  # of a turn and of the travel of a slider: narrow, and yet a grid of poses leaves no gap in them


class ReachableValues:
    """A table of the values that each joint has in some poses.

    Parameters
    ----------
    model : NominalModel
    poses : (n, m, joints) Array
        In each lane.
    counts : (n, m) Array of bool
        Which of them count, such as those in which the motors hold the arm.
    """

    def __init__(self, model: NominalModel, poses: Array, counts: NDArray[np.bool_]) -> None:
        low, high = model.travel
        self._turns, self._low = ~model.slides, np.where(model.slides, low, 0.0)
        self._width = np.where(model.slides, high, 2.0 * np.pi) - self._low
        self._table = np.zeros((len(poses), BINS, model.joints), dtype=np.bool_)
        lane, pose = np.nonzero(counts)
        self._table[lane[:, None], self._bins(poses[lane, pose]), np.arange(model.joints)] = True

    def include(self, phi: Array) -> NDArray[np.bool_]:
        """Whether the value of each joint in poses (n, ..., joints) is in the table of the lane."""
        lane = np.arange(len(phi)).reshape(-1, *[1] * (phi.ndim - 1))
        found: NDArray[np.bool_] = self._table[lane, self._bins(phi), np.arange(phi.shape[-1])]
        return found

    def _bins(self, phi: Array) -> NDArray[np.intp]:
        share = (phi - self._low) / self._width
        share = np.where(self._turns, share % 1.0, share)
        return np.clip((share * BINS).astype(np.intp), 0, BINS - 1)
