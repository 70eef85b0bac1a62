"""The expert of Track: a first pose from which the tip can follow the whole curve, and a motion along the
curve that stays mobile and within the travel of the sliders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts.planned import Planned
from redundant_envs.control.experts.targets import targets_of
from redundant_envs.control.joint_path import joint_path, mobility_slopes
from redundant_envs.control.poses import cheapest, far_apart, poses_at
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
HURRY = 0.95  # of the time before the target moves, or errors count: after this share the arm is there
SOON = 0.8  # s: an approach of less time takes longer where motors need that
TIMES = np.array([0.2, *np.linspace(0.4, 2.4, 21)])[:, None]  # s, of those
LATE = 1.0  # 1/s: an approach that is late by 10 ms is as bad as one that takes 1 % beyond the limits
MOST_STEPS = 10_000  # of a plan, which is a table


class Track(Planned):
    """Plans at once for all lanes whose targets wait equally long; only lanes in which no plan serves yet try
    further first poses."""

    frequency = 18.0
    steps = 200  # of a motion where an episode has no limit; the last pose is held after it

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        steps = self._episode_steps(numbers)
        waits = np.rint(np.minimum(numbers["wait"], steps * self.dt) / self.dt).astype(np.intp)
        motion = Motion(*np.zeros((3, len(start), steps + 1, self.model.joints)))
        for wait in np.unique(waits).tolist():
            some = np.flatnonzero(waits == wait)
            part = self._plan(start[some], {n: x[some] for n, x in numbers.items()}, wait, steps)
            for table, new in zip(motion, part, strict=True):
                table[some] = new
        return motion

    def _episode_steps(self, numbers: Mapping[str, Array]) -> int:
        limit = float(np.max(numbers.get("limit", np.inf)))
        if MOST_STEPS < limit < np.inf:
            raise ValueError(
                f"max_episode_steps is {limit:g}; {type(self).__name__} plans whole episodes, of at most "
                f"{MOST_STEPS} control steps: give fewer"
            )
        return self.steps if limit == np.inf else int(limit)

    def _plan(self, start: Array, numbers: Mapping[str, Array], wait: int, steps: int) -> Motion:
        """The motion of lanes whose targets stand still for ``wait`` steps."""
        targets = targets_of(numbers, self.dt, steps)
        soon = HURRY * np.minimum(wait * self.dt, numbers["settle"])
        firsts = self._firsts(start, targets[:, 0], soon)
        motion = Motion(*np.zeros((3, len(start), steps + 1, self.model.joints)))
        best, left, tried = np.full(len(start), np.inf), np.arange(len(start)), 0
        for count in ROUNDS:
            tried += count
            few = firsts[left, tried - count : tried]
            if not few.size:
                break
            path = self._best_path(few, targets[left, wait:], left)
            trial, seconds = self._whole(start[left], path, wait, soon[left], left)
            since = np.maximum(wait, np.ceil(seconds / self.dt))
            late = LATE * (seconds - soon[left])
            costs = self._costs(trial, targets[left], since, left) + late
            better = costs < best[left]
            best[left[better]] = costs[better]
            for table, new in zip(motion, trial, strict=True):
                table[left[better]] = new[better]
            left = left[costs > 0.0]
        return motion

    def _firsts(self, start: Array, first: Array, soon: Array) -> Array:
        """First poses (n, m, joints) in the order in which they are tried."""
        poses = poses_at(self.model, first, start, GRID)
        poses, costs = cheapest(poses, self._first_costs(poses, start), APART * sum(ROUNDS))
        poses, costs = poses[:, ::APART], costs[:, ::APART]
        n, m, joints = poses.shape
        starts, lanes = np.repeat(start, m, axis=0), np.repeat(np.arange(n), m)
        lines = self._line_costs(starts, poses.reshape(-1, joints), soon[lanes], lanes)
        return cheapest(poses, costs + lines.reshape(n, m), m)[0]

    def _first_costs(self, poses: Array, start: Array) -> Array:
        mobile = self.model.arm.manipulability(poses @ self.model.inverse)
        share = mobile / mobile.max(axis=1, keepdims=True)
        costs: Array = far_apart(self.model, poses, start[:, None]) - MOBILE * share
        return costs

    def _line_costs(self, start: Array, first: Array, soon: Array, lanes: Lanes) -> Array:
        """Costs of straight ways to first poses: of those that take too much effort."""
        ways, seconds = np.linspace(start, first, 3, axis=1), np.maximum(soon, SOON)[None]
        return PER_EFFORT * np.maximum(quickest(self.model, ways, seconds, 1.0)[1] - MOST_EFFORT, 0.0)

    def _best_path(self, firsts: Array, targets: Array, lanes: Lanes) -> Array:
        """Of the paths (n, points, joints) from first poses (n, m, joints), the best in each lane."""
        n, m, _ = firsts.shape
        each, targets = np.repeat(lanes, m), np.repeat(targets, m, axis=0)
        firsts = firsts.reshape(n * m, -1)
        path = joint_path(self.model, firsts, targets, self.dt, lambda phi: self._posture(phi, each))
        costs = self._costs(Motion(path, *self._rates(path)), targets, np.zeros(len(path)), each)
        return path[costs.reshape(n, m).argmin(axis=1) + m * np.arange(n)]

    def _posture(self, phi: Array, lanes: Lanes) -> Array:
        """Rates (n, joints) that improve a posture, for the null space."""
        return mobility_slopes(self.model, phi)

    def _whole(self, start: Array, path: Array, wait: int, soon: Array, lanes: Lanes) -> tuple[Motion, Array]:
        """The motion to a path and along it, which goes on while a late approach ends; and the times (n,) of
        the approaches: ``soon``, or those that motors can do."""
        ways = self._ways(start, path[:, 0], lanes)
        times = np.where(soon < SOON, np.maximum(soon, TIMES), soon)
        seconds, _ = quickest(self.model, ways, times, MOST_EFFORT)
        before = timed(ways - ways[:, -1:], seconds, self.dt, wait + path.shape[1] - 1)
        still = ((0, 0), (wait, 0), (0, 0))
        along = np.pad(path, still, mode="edge"), *(np.pad(x, still) for x in self._rates(path))
        return Motion(*(a + b for a, b in zip(before, along, strict=True))), seconds

    def _ways(self, start: Array, first: Array, lanes: Lanes) -> Array:
        """Ways (n, points, joints) to first poses."""
        return np.linspace(start, first, 3, axis=1)

    def _rates(self, path: Array) -> tuple[Array, Array]:
        """Rates and accelerations along a path, by differences; a path of one point is at rest."""
        if path.shape[1] < 2:
            return np.zeros_like(path), np.zeros_like(path)
        rates = np.gradient(path, self.dt, axis=1)
        return rates, np.gradient(rates, self.dt, axis=1)

    def _costs(self, motion: Motion, targets: Array, since: Array, lanes: Lanes) -> Array:
        """Costs (n,) of motions: 0 where one serves. Before the steps ``since`` (n,) errors do not count."""
        error = np.linalg.norm(self.model.tip(motion.phi) - targets, axis=-1)
        error = np.where(np.arange(error.shape[1]) < since[:, None], 0.0, error).max(axis=1)
        effort = self.model.load(*motion).max(axis=1)
        return PER_ERROR * np.maximum(error - MOST_ERROR, 0.0) + np.maximum(effort - MOST_EFFORT, 0.0)
