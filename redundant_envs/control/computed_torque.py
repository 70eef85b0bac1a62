"""Computed torque along a planned joint motion: the expert with which every learner is compared. The plan
goes from the start pose to a pose at the goal along a minimum-jerk profile; the torque is inverse dynamics of
the plan's acceleration plus proportional-derivative feedback. Effects it compensates: the field and viscous
friction of the nominal scene. Where actions are joint velocities, they follow the plan."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.following import horizon, normalized, towards
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import pose_at
from redundant_envs.control.time_law import latest_end, minimum_jerk
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
NO_NUMBERS: Mapping[str, Array] = {}


class ComputedTorque:
    """Computed-torque controller for a batch of episodes.

    Parameters
    ----------
    scene : Scene
    duration : float
        Time of the planned motion, s; shorter where the goal has to be held sooner.
    frequency : float
        Of the critically damped error dynamics, rad/s.
    pose : callable
        (scene, start, goal) -> pose in which the plan ends: :func:`pose_at` or :func:`lightest_pose`.
    """

    def __init__(
        self, scene: Scene, duration: float = 1.3, frequency: float = 12.0,
        pose: Callable[[Scene, Array, Array], Array] = pose_at,
    ) -> None:  # fmt: skip
        self.scene, self.pose, self.duration, self.frequency = scene, pose, duration, frequency
        self.model = NominalModel(scene)
        self.limits = self.model.limits
        self._start, self._end = np.zeros((2, 0, self.model.joints))
        self._seconds, self._ahead = np.zeros((0, 1)), 0.0

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None = None,
        numbers: Mapping[str, Array] = NO_NUMBERS,
    ) -> None:  # fmt: skip
        """Plan new episodes from poses (n, joints) to goals (n, 2), of all lanes or those in ``index``.
        Of their numbers ``limit`` and ``hold_steps`` say how soon the goal has to be held, and
        ``decide_every`` how long an action holds."""
        end = self.pose(self.model.scene, q, goal)
        self._ahead = horizon(self.model, np.max(numbers.get("decide_every", 1)) * self.scene.control_dt)
        seconds = np.minimum(latest_end(numbers, self.scene.control_dt), self.duration)[:, None]
        if index is None:
            self._start, self._end = q.copy(), end
            self._seconds = np.broadcast_to(seconds, (len(q), 1)).copy()
        else:
            self._start[index], self._end[index], self._seconds[index] = q, end, seconds

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each episode began."""
        seconds, model, w = self._seconds, self.model, self.frequency
        t = np.broadcast_to(t, len(q))[:, None] + (0.0 if model.speeds is None else self._ahead)
        share, rate, change = minimum_jerk(np.clip(t / seconds, 0.0, 1.0))
        distance = self._end - self._start
        if model.speeds is not None:
            place = self._start + distance * share
            return towards(model, place @ model.b, q @ model.b, self._ahead)
        qdd = distance * change / seconds**2
        qdd += 2.0 * w * (distance * rate / seconds - qd) + w * w * (self._start + distance * share - q)
        return normalized(model, model.efforts(q @ model.b, qd @ model.b, qdd @ model.b))
