"""Resolved motion: rates of the joints for a path of the tip, and terms that use the null space.

    qd = J# (v + k e) + N A g,    J# = A J^T (J A J^T)^-1,    N = 1 - J# J

with the path's velocity v, the tip's distance e from the path, the metric's inverse A (:mod:`null_space`),
and the gradient g by the coordinates of a quantity that is to grow: the clearance of the links from
obstacles, manipulability, minus the load of the motors at rest, minus the distance of sliders from the middle
of their travel. A g is the motion in which it grows fastest.

Sources: D. E. Whitney, "Resolved motion rate control of manipulators and human prostheses", IEEE Trans.
Man-Machine Systems 10(2), 1969; A. Liegeois, "Automatic supervisory control of the configuration and behavior
of multibody mechanisms", IEEE Trans. Systems, Man, and Cybernetics 7(12), 1977 (the gradient in the null
space, and the middle of the travel); A. A. Maciejewski and C. A. Klein, "Obstacle avoidance for kinematically
redundant manipulators in dynamically varying environments", Int. J. Robotics Research 4(3), 1985 (obstacles).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.control.holding import effort_limits, motor_efforts, slider_travel, stops
from redundant_envs.control.null_space import generalised_inverse, kinematic_mobility
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
Gradient = Callable[[Array], Array]
"""Of q (..., n) the gradient by q, (..., n), of what is to grow, times a weight."""
STEP = 1e-5  # of central differences, rad and m: its square and rounding / STEP are both below 1e-9


def gradient(quantity: Callable[[Array], Array], q: ArrayLike) -> Array:
    """Gradient (..., n) of a quantity (...) by the coordinates q (..., n), by central differences."""
    place = np.asarray(q, dtype=np.float64)
    ways = STEP * np.eye(place.shape[-1])
    ahead, behind = (quantity(place[..., None, :] + way) for way in (ways, -ways))
    slope: Array = (ahead - behind) / (2.0 * STEP)
    return slope


def manipulability_gradient(scene: Scene, weight: float = 1.0) -> Gradient:
    """Of log sqrt(det J J^T): away from singular poses, at which it has no bound."""
    return lambda q: weight * gradient(lambda x: np.log(scene.robot.manipulability(x)), q)


def load_gradient(scene: Scene, weight: float = 1.0) -> Gradient:
    """Of minus half the sum of (effort at rest / limit)^2, without the help of stops."""
    limits = effort_limits(scene)
    return lambda q: -0.5 * weight * gradient(lambda x: ((motor_efforts(scene, x) / limits) ** 2).sum(-1), q)


def centring_gradient(scene: Scene, weight: float = 1.0) -> Gradient:
    """Of minus half the sum of ((position - middle) / (upper - lower))^2 over the sliders (Liegeois 1977)."""
    travel, b = slider_travel(scene), scene.robot.motor_map

    def toward(q: Array) -> Array:
        joints = np.asarray(q, dtype=np.float64) @ b
        at_joints = np.zeros_like(joints)
        for k, (low, high) in travel.items():
            at_joints[..., k] = weight * (0.5 * (low + high) - joints[..., k]) / (high - low) ** 2
        slope: Array = at_joints @ b.T
        return slope

    return toward


class ResolvedMotion:
    """Rates of an arm whose sliders stay within their travel.

    A slider at an end of its travel that would move beyond it stays, and the other joints do its part.

    Parameters
    ----------
    scene : Scene
    terms : sequence of callables
        Gradients (..., n) of q (..., n), with their weights in them; their sum is g.
    gain : float
        k, 1/s.
    mobility : callable, optional
        q (..., n) -> A (..., n, n); by default :func:`kinematic_mobility`, the same in all poses.
    """

    def __init__(
        self, scene: Scene, terms: tuple[Gradient, ...] = (), gain: float = 10.0,
        mobility: Callable[[Array], Array] | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.terms, self.gain, self.stops = scene.robot, terms, gain, stops(scene)
        fixed = kinematic_mobility(scene.robot)
        self.mobility = mobility or (lambda q: fixed)

    def rates(self, q: ArrayLike, point: ArrayLike, velocity: ArrayLike) -> Array:
        """qd (..., n), rad/s and m/s, at poses q (..., n) for points of paths (..., 2), m, and their
        velocities, m/s. ValueError at singular poses: there no rates lead along every path."""
        place, b = np.asarray(q, dtype=np.float64), self.robot.motor_map
        inverse, joints = np.linalg.inv(b), place @ b
        jacobian = self.robot.jacobian(place) @ inverse.T  # by the joints, so that a slider is an entry
        wish = np.asarray(velocity) + self.gain * (np.asarray(point) - self.robot.forward_kinematics(place))
        pull = sum((term(place) for term in self.terms), np.zeros_like(place)) @ inverse.T
        mobility = np.broadcast_to(b.T @ self.mobility(place) @ b, (*place.shape, place.shape[-1]))
        free = np.ones(place.shape, dtype=np.bool_)
        for _ in range(len(self.stops) + 1):
            a = _held(mobility, free)
            moved = (a @ pull[..., None])[..., 0]
            short = wish - (jacobian @ moved[..., None])[..., 0]
            rates = moved + (generalised_inverse(jacobian, a) @ short[..., None])[..., 0]
            beyond = np.zeros_like(free)
            for k, (low, high) in self.stops.items():
                beyond[..., k] = (joints[..., k] <= low) & (rates[..., k] < 0.0)
                beyond[..., k] |= (joints[..., k] >= high) & (rates[..., k] > 0.0)
            if not (beyond & free).any():
                break
            free &= ~beyond
        coordinates: Array = rates @ inverse
        return coordinates

    def follow(self, q: ArrayLike, path: ArrayLike, interval: float) -> Array:
        """Poses (T, ..., n) from the start q (..., n) for the points of a path (T, ..., 2), m, that are an
        interval [s] apart, by Euler's method; a slider that reaches an end of its travel stops exactly
        there."""
        points = np.asarray(path, dtype=np.float64)
        b = self.robot.motor_map
        inverse, poses = np.linalg.inv(b), [np.asarray(q, dtype=np.float64)]
        for point, after in itertools.pairwise(points):
            joints = (poses[-1] + interval * self.rates(poses[-1], point, (after - point) / interval)) @ b
            for k, (low, high) in self.stops.items():
                joints[..., k] = np.clip(joints[..., k], low, high)
            poses.append(joints @ inverse)
        return np.stack(poses)


def _held(mobility: Array, free: NDArray[np.bool_]) -> Array:
    """The inverse of the metric of the joints that are free; zero for the others."""
    both = free[..., None] & free[..., None, :]
    metric = np.where(both, np.linalg.inv(mobility), np.eye(free.shape[-1]))
    held: Array = np.linalg.inv(metric) * both
    return held
