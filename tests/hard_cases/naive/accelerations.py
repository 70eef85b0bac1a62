"""Mistakes in solving M qdd + h + G = Q, and in inverting a Jacobian."""

import numpy as np
from subject import Subject


def _solve(matrix, vector):
    """x of A x = b for a batch; NaN where A is singular."""
    try:
        return np.linalg.solve(matrix, vector[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.full_like(vector, np.nan)


class DenseSolve(Subject):
    """Forms M and solves it by Gaussian elimination: loses as many digits as M is badly conditioned."""

    name = "dense solve"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        return _solve(arm.mass_matrix(q), Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g))


class RegularisedMass(Subject):
    """Adds a little to the diagonal of M, so that it is "never singular": another arm moves."""

    name = "regularised mass matrix"
    added = 1e-8

    def arm(self, kind, masses, lengths):
        """Accepts any numbers: a singular M is regularised later."""
        made = object.__new__(type(super().arm(kind, (1.0,) * len(masses), (1.0,) * len(lengths))))
        object.__setattr__(made, "masses", tuple(masses))
        object.__setattr__(made, "lengths", tuple(lengths))
        return made

    def accelerations(self, arm, q, qd, Q, g=0.0):
        mended = arm.mass_matrix(q) + self.added * np.eye(4)
        return _solve(mended, Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g))


class InvertedJacobian(Subject):
    """Moves in Cartesian space: accelerations of two points of the arm, and from them by the inverse of
    their Jacobian those of the joints; J J^T for poses. Dies where the arm is stretched or folded."""

    name = "inverted Jacobian"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        J = self._jacobian(arm, np.asarray(q, float))
        forces = Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g)
        cartesian = np.einsum("...ij,...j->...i", J, _solve(arm.mass_matrix(q), forces))
        return _solve(J, cartesian)

    @staticmethod
    def _jacobian(arm, q):
        """Of the second and the fourth mass point, (..., 4, 4): two links carry the second."""
        tip = arm.jacobian(q)
        return np.concatenate([np.where(np.arange(4) < 2, tip, 0.0), tip], axis=-2)

    def pose_at(self, scene, start, goal):
        q = np.array(start, float)
        for _ in range(60):
            J = scene.robot.jacobian(q)
            error = np.asarray(goal) - scene.robot.forward_kinematics(q)
            q = q + J.T @ _solve(J @ J.T, error)
        return q
