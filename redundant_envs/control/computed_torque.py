"""Computed torque along a planned joint motion: the expert with which every learner is compared. The plan
goes from the start pose to a pose at the goal along a minimum-jerk profile; the torque is inverse dynamics of
the plan's acceleration plus proportional-derivative feedback. Effects it compensates: the field and viscous
friction of the nominal scene."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import holding_poses
from redundant_envs.effects import EffortLimits, Gravity, ViscousFriction
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]

MARGIN = 0.02  # share of the travel kept free at its ends by the plan
ITERATIONS, DAMPING = 60, 1e-4  # of the search for a pose


def pose_at(scene: Scene, start: Array, goal: Array) -> Array:
    """A pose (n, joints) with the tip at the goal (n, 2) m, near the start (n, joints), by damped
    Gauss-Newton in joint coordinates; if that does not converge, the nearest pose that it found."""
    robot, b = scene.robot, scene.robot.motor_map
    inverse = np.linalg.inv(b)  # q = B^-T phi
    phi = start @ b
    best, best_error = phi.copy(), np.full(len(phi), np.inf)
    values, low, high = scene.parameters(), np.full(len(b), -np.inf), np.full(len(b), np.inf)
    for joint, (lower, upper) in scene.travel().items():
        margin = MARGIN * (values[upper] - values[lower])
        low[joint], high[joint] = values[lower] + margin, values[upper] - margin
    for _ in range(ITERATIONS):
        q = phi @ inverse
        error = goal - robot.forward_kinematics(q)
        size = np.linalg.norm(error, axis=-1)
        better = size < best_error
        best[better], best_error[better] = phi[better], size[better]
        jacobian = robot.jacobian(q) @ inverse.T  # with respect to phi
        free = np.ones_like(phi)
        for _ in range(3):  # joints at the end of their travel are held, the others make up for it
            freed = jacobian * free[:, None, :]
            across = freed.transpose(0, 2, 1)  # damped least squares
            step = (across @ np.linalg.solve(freed @ across + DAMPING * np.eye(2), error[..., None]))[..., 0]
            free *= ((phi > low) | (step > 0.0)) & ((phi < high) | (step < 0.0))
        largest = np.abs(step).max(axis=-1, keepdims=True)
        phi = np.clip(phi + step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-12)), low, high)
    return best @ inverse


def lightest_pose(scene: Scene, start: Array, goal: Array) -> Array:
    """The pose with the tip at the goal that loads the motors least, reached by the shortest turns; that of
    :func:`pose_at`, with its arguments, if the goal is out of reach."""
    robot, b = scene.robot, scene.robot.motor_map
    poses, _ = holding_poses(scene, goal)
    out = np.isnan(poses).any(axis=1)
    poses[out] = pose_at(scene, start[out], goal[out])
    turns = np.round((start - poses) @ b / (2.0 * np.pi))
    turns[:, np.array(robot.prismatic)] = 0.0
    turns[out] = 0.0
    pose: Array = poses + 2.0 * np.pi * turns @ np.linalg.inv(b)
    return pose


class ComputedTorque:
    """Computed-torque controller for a batch of episodes.

    Parameters
    ----------
    scene : Scene
    duration : float
        Time of the planned motion, s.
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
        joints, kinds = len(scene.robot.joints), (EffortLimits, ViscousFriction, Gravity)
        effects: Any = [next((e for e in scene.effects if isinstance(e, kind)), None) for kind in kinds]
        limits, friction, gravity = effects
        if limits is None:
            raise ValueError("scene has no EffortLimits; the expert returns actions in their units")
        if (units := scene.action_units()) != tuple(f"{limits.key}.{name}" for name in limits.parameters()):
            raise ValueError(f"actions are shares of {units[0]}; the expert knows efforts alone")
        self.limits = np.array(limits.limits)
        self.friction = np.array(friction.coefficients) if friction else np.zeros(joints)
        if gravity and gravity.down[0] != 0.0:
            raise ValueError("scene has gravity along x; the expert handles gravity along -y")
        self.g = -gravity.g * gravity.down[1] if gravity else 0.0
        self._start, self._end = np.zeros((2, 0, joints))

    def begin(self, q: Array, goal: Array, index: NDArray[np.intp] | None = None) -> None:
        """Plan new episodes from poses (n, joints) to goals (n, 2), of all lanes or those in ``index``."""
        end = self.pose(self.scene, q, goal)
        if index is None:
            self._start, self._end = q.copy(), end
        else:
            self._start[index], self._end[index] = q, end

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each episode began."""
        s = np.broadcast_to(np.clip(np.divide(t, self.duration), 0.0, 1.0), len(q))[:, None]
        distance = self._end - self._start
        place = self._start + distance * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = distance * 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        wanted = distance * 60.0 * s * (1.0 - 3.0 * s + 2.0 * s**2) / self.duration**2
        w = self.frequency
        qdd = wanted + 2.0 * w * (rate - qd) + w * w * (place - q)
        robot, b = self.scene.loaded_robot, self.scene.robot.motor_map
        forces = robot.inverse_dynamics(q, qd, qdd, g=self.g)
        efforts = np.linalg.solve(b, forces.T).T + self.friction * (qd @ b)
        return np.clip(efforts / self.limits, -1.0, 1.0).astype(np.float32)
