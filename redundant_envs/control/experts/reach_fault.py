"""The expert of ReachFault: a motion that may stop in any joint, and a new plan once a brake has closed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.following import Following, leaning, normalized
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import cheapest, far_apart, pose_at, poses_at
from redundant_envs.control.time_law import Motion, at_shares, quickest, timed
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
GRID = 13  # of the poses at a goal
BINS = 72  # of the values of a joint: 0.09 rad and 3.5 mm wide, in which the poses of the grid leave no gap
MOST_AT_REST = 0.9  # of a limit, of poses in which the goal is held
MOST_EFFORT = 0.95  # of a limit, in a motion
TIMES = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3])  # s, of the first motion
AFTER = np.array([0.7, 0.9, 1.1, 1.3, 1.6, 2.0])  # s, of the motion with a brake
WATCHED = np.linspace(0.0, 0.5, 11)  # s, of possible faults
STARTS = 8
STEPS = 200


class Fault:
    def __init__(self, scene: Scene) -> None:
        self.model = NominalModel(scene)
        self.following = Following(self.model)

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        model, start, n = self.model, q @ self.model.b, len(q)
        if index is None:
            index = np.arange(n)
            self.joint, self.at = np.zeros(n, dtype=np.intp), np.zeros(n)
            self.begun, self.braked, self.goal = np.zeros(n), np.zeros(n, dtype=np.bool_), np.zeros((n, 2))
        self.joint[index], self.at[index] = numbers["motor_brake.joint"], numbers["motor_brake.at"]
        self.begun[index], self.braked[index], self.goal[index] = 0.0, False, goal
        poses = poses_at(model, goal, start, GRID)
        fit = model.loads_at_rest(poses).max(axis=-1) < MOST_AT_REST
        allowed = self.values(poses, fit)
        few, _ = cheapest(poses, self.risk(allowed, start, poses, 0.8, fit), STARTS)
        ways = np.linspace(np.repeat(start, STARTS, axis=0), few.reshape(-1, model.joints), 41, axis=1)
        seconds, loads = quickest(model, ways, TIMES, MOST_EFFORT)
        risk = self.risk(allowed, start, few, seconds.reshape(n, STARTS), np.ones((n, STARTS), bool))
        best = risk.argmin(axis=1) + STARTS * np.arange(n)
        self.risks = risk.min(axis=1)
        self.following.begin(timed(ways[best], seconds[best], self.following.dt, STEPS), index if len(index) < len(self.at) else None)

    def bins(self, phi):
        low, high = self.model.travel
        low, width = (np.where(self.model.slides, a, b) for a, b in ((low, 0.0), (high - low, 2.0 * np.pi)))
        share = (phi - low) / width
        share = np.where(self.model.slides, np.clip(share, 0.0, 1.0), share % 1.0)
        return np.minimum((share * BINS).astype(np.intp), BINS - 1)

    def values(self, poses: Array, fit) -> NDArray[np.bool_]:
        """Values (n, bins, joints) of each joint with which the goal can be held."""
        table = np.zeros((len(poses), BINS, self.model.joints), dtype=np.bool_)
        lane, pose = np.nonzero(fit)
        table[lane[:, None], self.bins(poses[lane, pose]), np.arange(self.model.joints)] = True
        return table

    def risk(self, allowed, start, poses, seconds, fit):
        """Share of the possible faults that leave no pose at the goal, of straight motions (n, m)."""
        model = self.model
        s = np.minimum(WATCHED / np.broadcast_to(seconds, poses.shape[:2])[..., None], 1.0)[..., None]
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        places = start[:, None, None] + share * (poses - start[:, None])[:, :, None]
        lane = np.arange(len(start))[:, None, None, None]
        held = allowed[lane, self.bins(places), np.arange(model.joints)]
        risk = 1.0 - held.mean(axis=(2, 3))
        return np.where(fit, risk + 0.01 * far_apart(model, poses, start[:, None]), np.inf)

    def action(self, t: Array, q: Array, qd: Array) -> NDArray[np.float32]:
        model = self.model
        phi, phid = q @ model.b, qd @ model.b
        closed = t >= self.at - 1e-9
        new = np.flatnonzero(closed & ~self.braked)
        if len(new):
            self.plan_again(new, phi[new], phid[new])
            self.begun[new], self.braked[new] = t[new], True
        since = t - self.begun
        wanted = self.following.accelerations(since, phi, phid)
        wanted[closed, self.joint[closed]] = 0.0  # the brake takes what it needs
        efforts = model.efforts(phi, phid, wanted)
        resting = (self.following.reference(since)[2] == 0.0).all(axis=1)
        return normalized(model, leaning(model, efforts, phi, resting))

    def plan_again(self, lanes, phi, phid):
        model, joint, n = self.model, self.joint[lanes], len(lanes)
        row = np.arange(n)
        poses = poses_at(model, self.goal[lanes], phi, GRID)
        loads = model.loads_at_rest(poses)
        loads[row, :, joint] = 0.0
        away = np.abs(poses[row, :, joint] - phi[row, joint][:, None])
        far = far_apart(model, poses, phi[:, None])
        costs = far + 20.0 * away + np.where(loads.max(axis=-1) < MOST_AT_REST, 0.0, 10.0)
        few, _ = cheapest(poses, costs, STARTS)
        few[row, :, joint] = phi[row, joint][:, None]
        movable = np.ones((n, STARTS, model.joints))
        movable[row, :, joint] = 0.0
        flat = lambda x: x.reshape(-1, x.shape[-1])
        goals = np.repeat(self.goal[lanes], STARTS, axis=0)
        ends = pose_at(model.static, flat(few) @ model.inverse, goals, flat(movable)) @ model.b
        error = np.linalg.norm(model.tip(ends) - goals, axis=-1).reshape(n, STARTS)
        ends = ends.reshape(n, STARTS, -1)
        loads = model.loads_at_rest(ends)
        loads[row, :, joint] = 0.0
        costs = far_apart(model, ends, phi[:, None]) + 1e4 * np.maximum(error - 0.002, 0.0) + 10.0 * np.maximum(loads.max(axis=-1) - MOST_AT_REST, 0.0)
        self.found = getattr(self, "found", {})
        end = cheapest(ends, costs, 1)[0][:, 0]
        for i, l in enumerate(lanes): self.found[int(l)] = (error[i].min(), costs[i].min())
        phid = phid.copy(); phid[row, joint] = 0.0
        best, motion = np.full(n, np.inf), None
        for seconds in AFTER:
            trial = between(phi, phid, end, seconds, self.following.dt, STEPS)
            efforts = np.abs(model.efforts(*trial)) / model.limits
            efforts[row, :, joint] = 0.0
            load = efforts.max(axis=(1, 2))
            better = (load < best) & (best > MOST_EFFORT)
            if motion is None: motion = trial
            for a, b in zip(motion, trial): a[better] = b[better]
            best[better] = load[better]
        self.following.begin(motion, lanes)


def between(phi, phid, end, seconds, dt, steps):
    """Quintic from a state to a pose at rest."""
    T, s = seconds, np.minimum(np.arange(steps + 1) * dt / seconds, 1.0)[:, None]
    way, v = (end - phi)[:, None], phid[:, None] * T
    a3, a4, a5 = 10.0 * way - 6.0 * v, -15.0 * way + 8.0 * v, 6.0 * way - 3.0 * v
    p = phi[:, None] + v * s + a3 * s**3 + a4 * s**4 + a5 * s**5
    d = (v + 3 * a3 * s**2 + 4 * a4 * s**3 + 5 * a5 * s**4) / T
    dd = (6 * a3 * s + 12 * a4 * s**2 + 20 * a5 * s**3) / T**2
    over = s >= 1.0
    return Motion(p, np.where(over, 0.0, d), np.where(over, 0.0, dd))
