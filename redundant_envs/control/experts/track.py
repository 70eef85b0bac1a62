"""The expert of Track: a first pose from which the tip can follow the whole curve, and a motion along the
curve that stays mobile and within the travel of the sliders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts.planned import Planned
from redundant_envs.control.joint_path import joint_path, mobility_slopes
from redundant_envs.control.poses import cheapest, far_apart, pose_at, poses_at
from redundant_envs.control.time_law import Motion, quickest, timed

Array = NDArray[np.float64]
Lanes = NDArray[np.intp]
GRID = 7  # of the poses at the first point
APART = 3  # every so many of these poses, in order of their costs, are tried: neighbours are alike
ROUNDS = (1, 4, 11)  # first poses that are tried at a time, in lanes where none before them serves
MOBILE = 2.0  # distance in joint space that is gone for the most mobile first pose
MOST_ERROR, MOST_EFFORT = 0.002, 0.97  # m, and of a limit: a plan within both serves
PER_ERROR = 100.0  # 1/m: a plan that misses the curve by 1 cm is as bad as one that takes twice the limits
PER_EFFORT = 20.0  # distance in joint space that is gone for an approach with less effort, by one limit
HURRY = 0.95  # of the time before the target moves: after this share the arm is there
CURVE = (
    "phase", "spin", "along", "across", "eight", "tilt_s", "tilt_c", "centre_x", "centre_y", "wait", "rise"
)  # fmt: skip


def targets_of(numbers: Mapping[str, Array], dt: float, steps: int) -> Array:
    """Places (n, steps + 1, 2) of the target [m] at 0, dt, .., from the numbers of the task and its curve."""
    c = {name: numbers[name][:, None] for name in CURVE}
    ramp = np.clip((np.arange(steps) * dt - c["wait"]) / c["rise"], 0.0, 1.0)
    phase = c["phase"] + c["spin"] * dt * np.cumsum(np.pad(ramp, ((0, 0), (1, 0))), axis=1)
    x = c["along"] * np.cos(phase)
    y = c["across"] * np.where(c["eight"] > 0.5, np.sin(2.0 * phase), np.sin(phase))
    turned = c["tilt_c"] * x - c["tilt_s"] * y, c["tilt_s"] * x + c["tilt_c"] * y
    return np.stack([c["centre_x"] + turned[0], c["centre_y"] + turned[1]], axis=-1)


class Track(Planned):
    """Plans for all lanes at once; only lanes in which no plan serves yet try further first poses."""

    frequency = 18.0
    steps = 200  # of a motion: those of an episode

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        targets = targets_of(numbers, self.dt, self.steps)
        wait = int(np.rint(numbers["wait"].min() / self.dt))
        firsts = self._firsts(start, targets[:, 0], wait)
        motion = Motion(*np.zeros((3, len(start), self.steps + 1, self.model.joints)))
        best, left, tried = np.full(len(start), np.inf), np.arange(len(start)), 0
        for count in ROUNDS:
            tried += count
            few = firsts[left, tried - count : tried]
            if not few.size:
                break
            path = self._best_path(few, targets[left, wait:], left)
            trial = self._whole(start[left], path, wait, left)
            costs = self._costs(trial, targets[left], wait, left)
            better = costs < best[left]
            best[left[better]] = costs[better]
            for table, new in zip(motion, trial, strict=True):
                table[left[better]] = new[better]
            left = left[costs > 0.0]
        return motion

    def _firsts(self, start: Array, first: Array, wait: int) -> Array:
        """First poses (n, m, joints) in the order in which they are tried."""
        poses = poses_at(self.model, first, start, GRID)
        poses, costs = cheapest(poses, self._first_costs(poses, start), APART * sum(ROUNDS))
        poses, costs = poses[:, ::APART], costs[:, ::APART]
        n, m, joints = poses.shape
        starts, lanes = np.repeat(start, m, axis=0), np.repeat(np.arange(n), m)
        lines = self._line_costs(starts, poses.reshape(-1, joints), wait, lanes)
        return cheapest(poses, costs + lines.reshape(n, m), m)[0]

    def _first_costs(self, poses: Array, start: Array) -> Array:
        mobile = self.model.arm.manipulability(poses @ self.model.inverse)
        share = mobile / mobile.max(axis=1, keepdims=True)
        costs: Array = far_apart(self.model, poses, start[:, None]) - MOBILE * share
        return costs

    def _line_costs(self, start: Array, first: Array, wait: int, lanes: Lanes) -> Array:
        """Costs of straight ways to first poses: of those that take too much effort."""
        ways, seconds = np.linspace(start, first, 3, axis=1), np.array([HURRY * wait * self.dt])
        return PER_EFFORT * np.maximum(quickest(self.model, ways, seconds, 1.0)[1] - MOST_EFFORT, 0.0)

    def _best_path(self, firsts: Array, targets: Array, lanes: Lanes) -> Array:
        """Of the paths (n, points, joints) from first poses (n, m, joints), the best in each lane."""
        n, m, _ = firsts.shape
        each, targets = np.repeat(lanes, m), np.repeat(targets, m, axis=0)
        firsts = firsts.reshape(n * m, -1)
        path = joint_path(self.model, firsts, targets, self.dt, lambda phi: self._posture(phi, each))
        costs = self._costs(Motion(path, *self._rates(path)), targets, 0, each)
        return path[costs.reshape(n, m).argmin(axis=1) + m * np.arange(n)]

    def _posture(self, phi: Array, lanes: Lanes) -> Array:
        """Rates (n, joints) that improve a posture, for the null space."""
        return mobility_slopes(self.model, phi)

    def _whole(self, start: Array, path: Array, wait: int, lanes: Lanes) -> Motion:
        """The motion to the beginning of a path and along it."""
        seconds = np.full(len(start), HURRY * wait * self.dt)
        before = timed(self._ways(start, path[:, 0], lanes), seconds, self.dt, wait)
        pairs = zip(before, (path, *self._rates(path)), strict=True)
        return Motion(*(np.concatenate([a[:, :-1], b], axis=1) for a, b in pairs))

    def _ways(self, start: Array, first: Array, lanes: Lanes) -> Array:
        """Ways (n, points, joints) to first poses."""
        return np.linspace(start, first, 3, axis=1)

    def _rates(self, path: Array) -> tuple[Array, Array]:
        """Rates and accelerations along a path, by differences."""
        rates = np.gradient(path, self.dt, axis=1)
        return rates, np.gradient(rates, self.dt, axis=1)

    def _costs(self, motion: Motion, targets: Array, wait: int, lanes: Lanes) -> Array:
        """Costs (n,) of motions: 0 where one serves. Before ``wait`` steps errors do not count."""
        error = np.linalg.norm((self.model.tip(motion.phi) - targets)[:, wait:], axis=-1).max(axis=1)
        effort = self.model.load(*motion).max(axis=1)
        return PER_ERROR * np.maximum(error - MOST_ERROR, 0.0) + np.maximum(effort - MOST_EFFORT, 0.0)


class NearestPose(Track):
    """The baseline of tracking tasks: from the nearest first pose, without a use of the null space."""

    steps = 240  # of the longest episodes

    def _firsts(self, start: Array, first: Array, wait: int) -> Array:
        near = pose_at(self.model.scene, start @ self.model.inverse, first) @ self.model.b
        return near[:, None]

    def _posture(self, phi: Array, lanes: Lanes) -> Array:
        return np.zeros_like(phi)
