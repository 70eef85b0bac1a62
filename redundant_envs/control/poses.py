"""The choice of a pose among those with the tip at a goal: near the start, light, clear of discs, mobile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import goal_poses, holding_poses, num_sheets, slider_travel
from redundant_envs.control.nominal import NominalModel
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]

MARGIN = 0.02  # share of the travel kept free at its ends by the plan
ITERATIONS, DAMPING = 60, 1e-4  # of the search for a pose


def pose_at(scene: Scene, start: Array, goal: Array, movable: Array | None = None) -> Array:
    """A pose (n, joints) with the tip at the goal (n, 2) m, near the start (n, joints), by damped
    Gauss-Newton in joint coordinates; if that does not converge, the nearest pose that it found. Joints of
    which ``movable`` (n, joints) is 0 stay."""
    robot, b = scene.robot, scene.robot.motor_map
    inverse = np.linalg.inv(b)  # q = B^-T phi
    phi = start @ b
    best, best_error = phi.copy(), np.full(len(phi), np.inf)
    movable = np.ones_like(phi) if movable is None else movable
    values, low, high = scene.parameters(), np.full(len(b), -np.inf), np.full(len(b), np.inf)
    for joint, (lower, upper) in scene.travel().items():
        margin = MARGIN * (values[upper] - values[lower])
        low[joint], high[joint] = values[lower] + margin, values[upper] - margin
    low, high = (np.where(movable > 0.0, end, phi) for end in (low, high))
    for _ in range(ITERATIONS):
        q = phi @ inverse
        error = goal - robot.forward_kinematics(q)
        size = np.linalg.norm(error, axis=-1)
        better = size < best_error
        best[better], best_error[better] = phi[better], size[better]
        jacobian = robot.jacobian(q) @ inverse.T  # with respect to phi
        free = movable.copy()
        for _ in range(3):  # joints at the end of their travel are held, the others make up for it
            freed = jacobian * free[:, None, :]
            across = freed.transpose(0, 2, 1)  # damped least squares
            step = (across @ np.linalg.solve(freed @ across + DAMPING * np.eye(2), error[..., None]))[..., 0]
            free *= ((phi > low) | (step > 0.0)) & ((phi < high) | (step < 0.0))
        largest = np.abs(step).max(axis=-1, keepdims=True)
        phi = np.clip(phi + step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-12)), low, high)
    return best @ inverse


def lightest_pose(scene: Scene, start: Array, goal: Array, tolerance: float = 0.0) -> Array:
    """The pose with the tip within ``tolerance`` [m] of the goal that loads the motors least, reached by the
    shortest turns; that of :func:`pose_at`, with its arguments, if the goal is out of reach."""
    robot, b = scene.robot, scene.robot.motor_map
    poses, _ = holding_poses(scene, goal, tolerance)
    out = np.isnan(poses).any(axis=1)
    poses[out] = pose_at(scene, start[out], goal[out])
    turns = np.round((start - poses) @ b / (2.0 * np.pi))
    turns[:, np.array(robot.prismatic)] = 0.0
    turns[out] = 0.0
    pose: Array = poses + 2.0 * np.pi * turns @ np.linalg.inv(b)
    return pose


def poses_at(model: NominalModel, goals: Array, start: Array, grid: int) -> Array:
    """Poses phi (n, m, joints) with the tip at the goals (n, 2) m, each turned as near as possible to the
    start (n, joints); where a goal is out of reach they are that of :func:`pose_at`.

    ``grid`` values of each parameter of :func:`~redundant_envs.control.holding.goal_poses` cover all poses.
    """
    free = model.joints - goals.shape[-1]
    axis = np.linspace(0.0, np.pi, grid)
    psi = np.stack(np.meshgrid(*[axis] * free, indexing="ij"), axis=-1) if free else np.zeros((1, 0))
    sheets = np.arange(num_sheets(model.arm))[:, None]
    travel = slider_travel(model.static)
    q = goal_poses(model.arm, travel, goals[:, None, None], psi.reshape(grid**free, free), sheets)
    phi = turned_near(model, q.reshape(len(goals), -1, model.joints) @ model.b, start[:, None])
    out = np.isnan(phi).any(axis=(1, 2))
    if out.any():
        phi[out] = (pose_at(model.scene, start[out] @ model.inverse, goals[out]) @ model.b)[:, None]
    return phi


def turned_near(model: NominalModel, phi: Array, start: Array) -> Array:
    """The same poses (..., joints) by the shortest turns from a start (..., joints)."""
    turns = np.round((start - phi) / (2.0 * np.pi))
    near: Array = phi + 2.0 * np.pi * np.where(model.slides, 0.0, turns)
    return near


def far_apart(model: NominalModel, a: Array, b: Array) -> Array:
    """Distance (...) in joint space, in which a joint weighs as the length of the stretched arm beyond it."""
    distance: Array = np.sqrt((model.lengths_beyond * np.square(a - b)).sum(axis=-1))
    return distance


def cheapest(poses: Array, costs: Array, count: int) -> tuple[Array, Array]:
    """The ``count`` poses (n, count, joints) of least cost, and their costs, of poses (n, m, joints) with
    costs (n, m); the best comes first, and where fewer than ``count`` exist it comes again."""
    order = np.argsort(costs, axis=1)[:, :count]
    order = order[:, np.arange(count) % order.shape[1]]
    return np.take_along_axis(poses, order[..., None], axis=1), np.take_along_axis(costs, order, axis=1)
