"""The expert of Track: the first pose from which the tip can follow the whole curve, and a motion along it
that stays mobile and within the travel of the sliders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.following import Following
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import cheapest, far_apart, pose_at, poses_at
from redundant_envs.control.resolved_motion import mobility_slopes, resolved_motion
from redundant_envs.control.time_law import Motion, timed
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
GRID = 9  # of the poses at the first point of a curve
ROUNDS = (1, 3, 6, 6)  # first poses that are tried, in lanes where those before them do not serve
MOBILE = 2.0  # distance in joint space that a pose as mobile as any is worth
ENOUGH_ERROR, ENOUGH_LOAD = 0.002, 0.85  # m, and of a limit: a plan within both serves
HURRY = 0.92  # of the time before the target moves: in this share the arm is there


def targets_of(numbers: Mapping[str, Array], dt: float, steps: int) -> Array:
    """Places (n, steps + 1, 2) of the target of a tracking task at the ends of control steps, m."""
    c = {name: np.asarray(numbers[name])[:, None] for name in CURVE}
    ramp = np.clip((np.arange(steps) * dt - c["wait"]) / c["rise"], 0.0, 1.0)
    phase = c["phase"] + c["spin"] * dt * np.cumsum(np.pad(ramp, ((0, 0), (1, 0))), axis=1)
    x = c["along"] * np.cos(phase)
    y = c["across"] * np.where(c["eight"] > 0.5, np.sin(2.0 * phase), np.sin(phase))
    tilt_s, tilt_c = c["tilt_s"], c["tilt_c"]
    return np.stack(
        [c["centre_x"] + x * tilt_c - y * tilt_s, c["centre_y"] + x * tilt_s + y * tilt_c], axis=-1
    )


CURVE = (
    "phase", "spin", "along", "across", "eight", "tilt_s", "tilt_c", "centre_x", "centre_y", "wait", "rise"
)  # fmt: skip


class Track:
    """Plans for all lanes at once; only lanes in which a plan does not serve try further first poses."""

    STEPS = 200

    def __init__(self, scene: Scene) -> None:
        self.model = NominalModel(scene)
        self.following = Following(self.model, frequency=18.0)

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        """Plan new episodes; see :class:`~redundant_envs.control.experts.Expert`."""
        model, dt, start = self.model, self.following.dt, q @ self.model.b
        self.prepare(numbers)
        targets = targets_of(numbers, dt, self.STEPS)
        wait = int(np.rint(numbers["wait"].min() / dt))
        firsts = self.first_poses(start, targets[:, 0])
        best = np.full(len(q), np.inf)
        motion = Motion(*np.zeros((3, len(q), self.STEPS + 1, model.joints)))
        left, tried = np.arange(len(q)), 0
        for count in ROUNDS:
            first = firsts[left, tried : tried + count]
            tried += count
            if not first.size:
                break
            lanes = np.repeat(left, first.shape[1])
            path = resolved_motion(
                model, first.reshape(-1, model.joints), targets[lanes, wait:], dt,
                lambda phi, lanes=lanes: self.posture(phi, lanes),
            )
            costs = self.cost(Motion(path, *derivatives(path, dt)), targets[lanes, wait:], lanes)
            each = costs.reshape(len(left), -1)
            one = each.argmin(axis=1) + np.arange(len(left)) * each.shape[1]
            trial = self.approached(start[left], path[one], wait, left)
            costs = self.cost(trial, np.concatenate([np.full((len(left), wait, 2), np.nan), targets[left, wait:]], axis=1), left)
            better = costs < best[left]
            for mine, new in zip(motion, trial, strict=True):
                mine[left[better]] = new[better]
            best[left[better]] = costs[better]
            left = left[costs > 0.0]
        self.best = best
        self.following.begin(motion, index)

    def prepare(self, numbers): pass

    def first_poses(self, start: Array, first: Array) -> Array:
        """First poses (n, m, joints) in the order in which they are tried."""
        model = self.model
        poses = poses_at(model, first, start, GRID)
        best, _ = cheapest(poses, self.first_cost(poses, start), APART * sum(ROUNDS))
        return best[:, ::APART]

    def first_cost(self, poses, start):
        mobile = self.model.arm.manipulability(poses @ self.model.inverse)
        mobile /= mobile.max(axis=1, keepdims=True)
        return far_apart(self.model, poses, start[:, None]) - MOBILE * mobile

    def posture(self, phi, lanes):
        return mobility_slopes(self.model, phi)

    def ways(self, start, first, lanes):
        return np.linspace(start, first, 21, axis=1)

    def approached(self, start, path, wait, lanes):
        dt = self.following.dt
        approach = timed(self.ways(start, path[:, 0], lanes), np.full(len(start), HURRY * wait * dt), dt, wait)
        along = (path, *derivatives(path, dt))
        return Motion(*(np.concatenate([a[:, :-1], b], axis=1) for a, b in zip(approach, along)))

    def cost(self, motion, targets, lanes):
        """0 for a plan that serves."""
        error = np.nanmax(np.linalg.norm(self.model.tip(motion.phi) - targets, axis=-1), axis=1)
        load = self.model.load(*motion).max(axis=1)
        return np.maximum(load - ENOUGH_LOAD, 0.0) + 100.0 * np.maximum(error - ENOUGH_ERROR, 0.0)

    def action(self, t: Array, q: Array, qd: Array) -> NDArray[np.float32]:
        return self.following.action(t, q, qd)


APART = 4  # every so many of the poses, in order: neighbours differ little


def derivatives(path, dt):
    phid = np.gradient(path, dt, axis=1)
    return phid, np.gradient(phid, dt, axis=1)
