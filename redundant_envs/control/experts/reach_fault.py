"""The expert of ReachFault: a first motion that leaves a pose at the goal, whichever joint stops in it; and a
new plan, without the braked joint, once the brake has closed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts.planned import Planned
from redundant_envs.control.following import leaning, normalized
from redundant_envs.control.poses import cheapest, far_apart, pose_at, poses_at
from redundant_envs.control.reachable_values import ReachableValues
from redundant_envs.control.time_law import Motion, latest_end, minimum_jerk, quickest, quintic, timed
from redundant_envs.effects import MotorBrake
from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown

Array = NDArray[np.float64]
GRID = 13  # of the poses at a goal
TRIED = 8  # ends of the first motion whose times are computed, and poses from which a new end is sought
MOST_AT_REST = 0.9  # of a limit, in poses that hold the goal
TIMES = np.array([0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.3])  # s, of the first motion
MOST_FIRST = 1.4  # of a limit, in the first motion: soon is better than exact, since it ends nothing
GUESS = 0.8  # s, the time of first motions from which the ones to try are chosen
FAULTS = np.linspace(0.0, 0.5, 6)  # s, of faults that the first motion expects, in any joint
PER_DISTANCE = 0.01  # risk that is taken for a shorter first motion
SECOND = (0.7, 0.9, 1.1, 1.3, 1.6, 2.0)  # s, of the motion with a braked joint
MOST_SECOND = 0.95  # of a limit, in it
MISS = 2e-3  # m, of an end from the goal
OFF, HEAVY, MISSED = 20.0, 10.0, 1e4
"""Distance in joint space that is gone for a pose which has the braked joint where it is, per rad or m; for
one that motors hold with the share above; and for one at the goal, per metre."""


class ReachFault(Planned):
    """Plans for all lanes at once, and again for those in which a joint has braked. ValueError for a scene
    with another fault than one MotorBrake."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        faults = [effect for effect in scene.effects if isinstance(effect, MotorFault)]
        if [type(effect) for effect in faults] != [MotorBrake]:
            raise ValueError(f"effects has the faults {shown(faults)}; the expert knows one MotorBrake alone")
        self._key = faults[0].key

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        if index is None:
            index, n = np.arange(len(q)), len(q)
            self._joint, self._braked = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=np.bool_)
            self._at, self._since, self._goal = np.zeros(n), np.zeros(n), np.zeros((n, 2))
            self._latest = np.zeros(n)
            self.following.motion = None
        self._joint[index], self._at[index] = numbers[f"{self._key}.joint"], numbers[f"{self._key}.at"]
        self._braked[index], self._since[index], self._goal[index] = False, 0.0, goal
        self._latest[index] = latest_end(numbers, self.dt)
        super().begin(q, goal, index, numbers)

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        """The straight motion after whose possible stops most often a pose at the goal is left."""
        model, (n, joints) = self.model, start.shape
        poses = poses_at(model, goal, start, GRID)
        holds = model.loads_at_rest(poses).max(axis=-1) < MOST_AT_REST
        values = ReachableValues(model, poses, holds)
        risk = np.where(holds, self._risk(values, start, poses, np.full(holds.shape, GUESS)), np.inf)
        ends, _ = cheapest(poses, risk, TRIED)
        ways = np.linspace(np.repeat(start, TRIED, axis=0), ends.reshape(-1, joints), 3, axis=1)
        latest = np.broadcast_to(latest_end(numbers, self.dt), n).repeat(TRIED)
        seconds, _ = quickest(model, ways, np.minimum(TIMES[:, None], latest), MOST_FIRST)
        risk = self._risk(values, start, ends, seconds.reshape(n, TRIED))
        best = risk.argmin(axis=1) + TRIED * np.arange(n)
        return timed(ways[best], seconds[best], self.dt, self._steps)

    @property
    def _steps(self) -> int:
        return int(np.rint(max(TIMES[-1], SECOND[-1]) / self.dt))

    def _risk(self, values: ReachableValues, start: Array, ends: Array, seconds: Array) -> Array:
        """Share (n, m) of the faults in straight motions to ends (n, m, joints) that leave no pose."""
        share, _, _ = minimum_jerk(np.minimum(FAULTS / seconds[..., None], 1.0))
        stopped = start[:, None, None] + share[..., None] * (ends - start[:, None])[:, :, None]
        lost = 1.0 - values.include(stopped).mean(axis=(2, 3))
        risk: Array = lost + PER_DISTANCE * far_apart(self.model, ends, start[:, None])
        return risk

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each episode began."""
        model, t = self.model, np.broadcast_to(t, len(q))
        phi, phid = q @ model.b, qd @ model.b
        closed = t >= self._at
        new = np.flatnonzero(closed & ~self._braked)
        if len(new):
            self.following.begin(self._second(new, t[new], phi[new], phid[new]), new)
            self._braked[new], self._since[new] = True, t[new]
        if model.speeds is not None:
            return self.following.action(t - self._since, q, qd)
        wanted = self.following.accelerations(t - self._since, phi, phid)
        wanted[closed, self._joint[closed]] = 0.0  # and the brake takes what the others need for that
        resting = (self.following.reference(t - self._since)[2] == 0.0).all(axis=1)
        return normalized(model, leaning(model, model.efforts(phi, phid, wanted), phi, resting))

    def _second(self, lanes: NDArray[np.intp], t: Array, phi: Array, phid: Array) -> Motion:
        """The motion from a state, in which a joint of each lane has just braked, to a pose at the goal."""
        model, n = self.model, len(lanes)
        braked = np.arange(model.joints) == self._joint[lanes][:, None]
        poses = poses_at(model, self._goal[lanes], phi, GRID)
        off = np.where(braked[:, None], np.abs(poses - phi[:, None]), 0.0).sum(axis=-1)
        ends, _ = cheapest(poses, OFF * off + self._costs(poses, phi, braked), TRIED)
        ends = np.where(braked[:, None], phi[:, None], ends).reshape(n * TRIED, -1)
        goals, movable = (np.repeat(x, TRIED, axis=0) for x in (self._goal[lanes], 1.0 - braked))
        ends = pose_at(model.static, ends @ model.inverse, goals, movable) @ model.b
        missed = np.linalg.norm(model.tip(ends) - goals, axis=-1).reshape(n, TRIED)
        ends = ends.reshape(n, TRIED, -1)
        costs = MISSED * np.maximum(missed - MISS, 0.0) + self._costs(ends, phi, braked)
        end = cheapest(ends, costs, 1)[0][:, 0]
        rates, best = np.where(braked, 0.0, phid), np.full(n, np.inf)
        latest = np.maximum(self._latest[lanes] - t, SECOND[0])
        motion = Motion(*np.zeros((3, n, self._steps + 1, model.joints)))
        for seconds in SECOND:
            trial = quintic(phi, rates, end, seconds, self.dt, self._steps)
            shares = np.where(braked[:, None], 0.0, np.abs(model.efforts(*trial)) / model.limits)
            most = shares.max(axis=(1, 2))
            better = (most < best) & (best > MOST_SECOND) & (seconds <= latest)
            for table, new in zip(motion, trial, strict=True):
                table[better] = new[better]
            best[better] = most[better]
        return motion

    def _costs(self, poses: Array, phi: Array, braked: NDArray[np.bool_]) -> Array:
        """Costs (n, m) of ends: their distances, and what their motors lack, but for the braked one."""
        loads = np.where(braked[:, None], 0.0, self.model.loads_at_rest(poses)).max(axis=-1)
        far: Array = far_apart(self.model, poses, phi[:, None])
        return far + HEAVY * (loads > MOST_AT_REST)
