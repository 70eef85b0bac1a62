"""Operational-space control: an acceleration of the tip, and of the joints as far as the tip leaves them
free.

With the tip's equation of motion x'' = J qdd + J' qd, the inertia that the tip feels, L = (J M^-1 J^T)^-1,
and the dynamically consistent inverse of J, M^-1 J^T L, the generalized forces are

    Q = J^T L (x''_wanted - J' qd) + N^T M qdd_posture + h + G - F,    N = 1 - M^-1 J^T L J

with the forces F of friction, springs and other effects. The second term accelerates the joints and not the
tip.

Source: O. Khatib, "A unified approach for motion and force control of robot manipulators: the operational
space formulation", IEEE J. Robotics and Automation 3(1), 1987, equations 19 to 24, and section VI for
redundant arms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.control.holding import stops
from redundant_envs.control.null_space import generalised_inverse
from redundant_envs.effects.hooks import Force
from redundant_envs.language.algebra import numbered
from redundant_envs.model.energy import at_joints, scene_quantities
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]


class OperationalSpace:
    """The controller for an arm and the effects of its scene, which it knows exactly but for dry friction,
    and states of effects, which it takes at their initial values. What acts between a command and its motor,
    delays, lags, limits, it does not know.

    A slider at a stop whose acceleration would lead beyond it stays there: the tip's acceleration is then
    that of the other joints alone, and the motor leans the slider on the stop as far as that helps. Such
    sliders are found one after another, and none is released again at the same instant.

    Parameters
    ----------
    scene : Scene
        With efforts at joints. Its limits of efforts are not applied: the efforts are those that are needed.
    """

    def __init__(self, scene: Scene) -> None:
        if scene.actuation != "joint":
            raise ValueError(
                f"scene.actuation is {scene.actuation!r}; efforts are those of joints: use 'joint'"
            )
        self.scene, self.stops = scene, stops(scene)

    def efforts(
        self, q: ArrayLike, qd: ArrayLike, tip_acceleration: ArrayLike, posture: ArrayLike | None = None
    ) -> Array:
        """Joint efforts (..., n), N m and N.

        Parameters
        ----------
        q, qd : (..., n)
            State, rad and m, rad/s and m/s.
        tip_acceleration : (..., 2)
            Wanted, m/s^2.
        posture : (..., n), optional
            Wanted accelerations of the coordinates, rad/s^2 and m/s^2; by default none.

        Raises
        ------
        ValueError
            In singular poses, also where too few joints are left because sliders stay at their stops.
        """
        arm, b = self.scene.loaded_robot, self.scene.robot.motor_map
        place, rate = np.broadcast_arrays(np.asarray(q, dtype=np.float64), np.asarray(qd, dtype=np.float64))
        wish = np.zeros_like(place) if posture is None else np.broadcast_to(posture, place.shape)
        rest = np.asarray(tip_acceleration, dtype=np.float64) - arm.jacobian_dot_qd(place, rate)
        inverse = np.linalg.inv(b)  # the equations are those of the joints: J B^-T, B^-1 M B^-T, B^-1 (h + G)
        jacobian, mass = arm.jacobian(place) @ inverse.T, inverse @ arm.mass_matrix(place) @ inverse.T
        joints, rates, wish = place @ b, rate @ b, wish @ b
        free = np.ones(place.shape, dtype=np.bool_)
        for _ in range(len(self.stops) + 1):
            both = free[..., None] & free[..., None, :]
            mobility = np.linalg.inv(np.where(both, mass, np.eye(len(b)))) * both
            back = generalised_inverse(jacobian, mobility)
            moved = wish * free
            short = rest - (jacobian @ moved[..., None])[..., 0]
            acceleration = moved + (back @ short[..., None])[..., 0]
            beyond = self._beyond(joints, rates, acceleration) & free
            if not beyond.any():
                break
            free &= ~beyond
        efforts: Array = (mass @ acceleration[..., None])[..., 0] + self._bias(place, rate)
        return self._leaning(efforts, joints, free)

    def _bias(self, q: Array, qd: Array) -> Array:
        """Joint efforts that balance bias forces, gravity and the forces of effects, (..., n)."""
        x, n = scene_quantities(self.scene, q, qd), q.shape[-1]
        parts = x.each([*numbered("h{}", n), *numbered("G{}", n)])
        columns = np.stack([np.broadcast_to(part, q.shape[:-1]) for part in parts], axis=-1)
        bias: Array = (columns[..., :n] + columns[..., n:]) @ np.linalg.inv(self.scene.robot.motor_map).T
        for a in self.scene.attached.of(Force):
            bias -= at_joints(self.scene, a, "function", x)
        return bias

    def _beyond(self, joints: Array, rates: Array, acceleration: Array) -> NDArray[np.bool_]:
        """Which sliders are at a stop, do not move away from it and would accelerate beyond it."""
        beyond = np.zeros(joints.shape, dtype=np.bool_)
        for k, (low, high) in self.stops.items():
            at, speed, change = joints[..., k], rates[..., k], acceleration[..., k]
            beyond[..., k] = (at <= low) & (speed <= 0.0) & (change < 0.0)
            beyond[..., k] |= (at >= high) & (speed >= 0.0) & (change > 0.0)
        return beyond

    def _leaning(self, efforts: Array, joints: Array, free: NDArray[np.bool_]) -> Array:
        """Efforts in which a slider that stays leans on its stop: a lower stop pushes outwards, an upper one
        inwards, and the motor does the rest."""
        for k, (low, _) in self.stops.items():
            share = efforts[..., k]
            leant = np.where(joints[..., k] <= low, np.minimum(share, 0.0), np.maximum(share, 0.0))
            efforts[..., k] = np.where(free[..., k], share, leant)
        return efforts
