"""The cost of a motion that is to rest with the tip at a goal when it ends: for :mod:`ilqr`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.robots.arm import Arm

Array = NDArray[np.float64]
LAST = 20.0  # weight of the end of a motion in units of that of an interval of the hold


@dataclass(frozen=True)
class ReachCost:
    """Sum over the motion of w (sqrt(d^2 + a^2) / a - 1) + w_v |v|^2 + w_j |joint rates|^2 + w_u |actions|^2,
    with the distance d of the tip from the goal and its velocity v.

    Far away the first term grows like d / a, so that no goal outweighs the others; near the goal it is
    quadratic. Before the hold w is small and w_v is 0: the arm may swing. Second derivatives are those of
    Gauss and Newton, positive semidefinite. That v turns with the positions, too, is left out of all
    derivatives: it vanishes at rest.

    Parameters
    ----------
    robot : Arm
    goals : (n, 2) m
    hold : int
        Intervals at the end in which the tip is to rest at the goal.
    width : float
        a, m.
    approach, speed, rates, effort : float
        w before the hold (1 in it), w_v in it [s^2/m^2], w_j [s^2/rad^2, s^2/m^2], w_u.
    """

    robot: Arm
    goals: Array
    hold: int
    width: float = 0.1
    approach: float = 1e-3
    speed: float = 2.0
    rates: float = 3e-3
    effort: float = 1e-3

    def _weights(self, intervals: int) -> tuple[Array, Array]:
        """w and w_v at the ends of all intervals and the start, (intervals + 1, 1)."""
        held = np.arange(intervals + 1) > intervals - self.hold
        weights = np.stack([np.where(held, 1.0, self.approach), np.where(held, self.speed, 0.0)])
        weights[:, -1] *= LAST
        near, slow = weights[..., None]
        return near, slow

    def _tip(self, states: Array) -> tuple[Any, ...]:
        """Error, root of d^2 + a^2, Jacobian and velocity of the tip, and rates of the joints."""
        q, qd = np.split(states, 2, axis=-1)
        error = self.robot.forward_kinematics(q) - self.goals
        jacobian = self.robot.jacobian(q)
        root = np.sqrt((error**2).sum(axis=-1) + self.width**2)
        return error, root, jacobian, (jacobian @ qd[..., None])[..., 0], qd @ self.robot.motor_map

    def value(self, states: Array, actions: Array) -> Array:
        """Cost (..., n) of states (T + 1, ..., n, 2 joints) and actions (T, ..., n, joints)."""
        _, root, _, velocity, rates = self._tip(states)
        near, slow = (w.reshape(-1, *[1] * (root.ndim - 1)) for w in self._weights(len(actions)))
        terms = near * (root / self.width - 1.0) + slow * (velocity**2).sum(axis=-1)
        terms += self.rates * (rates**2).sum(axis=-1)
        total: Array = terms.sum(axis=0) + self.effort * (actions**2).sum(axis=(0, -1))
        return total

    def expansion(self, states: Array, actions: Array) -> tuple[Array, Array, Array, Array]:
        """Gradients and second derivatives by the states, (T + 1, n, m) and (T + 1, n, m, m), and by the
        actions, (T, n, joints) and (T, n, joints, joints)."""
        error, root, jacobian, velocity, rates = self._tip(states)
        near, slow = (w[..., None, None] for w in self._weights(len(actions)))
        across, joints, b = jacobian.swapaxes(-1, -2), rates.shape[-1], self.robot.motor_map
        pull = near / (self.width * root[..., None, None]) * across
        brake = 2.0 * slow * across
        gradient = np.concatenate(
            [
                (pull @ error[..., None])[..., 0],
                (brake @ velocity[..., None])[..., 0] + 2.0 * self.rates * rates @ b.T,
            ],
            axis=-1,
        )
        second = np.zeros((*gradient.shape, 2 * joints))
        second[..., :joints, :joints] = pull @ jacobian
        second[..., joints:, joints:] = brake @ jacobian + 2.0 * self.rates * b @ b.T
        of_actions = np.broadcast_to(2.0 * self.effort * np.eye(joints), (*actions.shape, joints))
        return gradient, second, 2.0 * self.effort * actions, of_actions
