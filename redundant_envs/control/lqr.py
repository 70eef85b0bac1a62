"""Linear-quadratic regulator around a pose at rest: the feedback that costs least near it.

With x the departure from the pose and its rates, and u that of the efforts from those that hold it, an
interval is x' = A x + B u. The feedback u = -K x that minimises the sum of x.Q x + u.R u over all time
follows from the least positive P of the Riccati equation

    P = Q + A^T P (1 + B R^-1 B^T P)^-1 A,    K = (R + B^T P B)^-1 B^T P A.

Sources: B. D. O. Anderson and J. B. Moore, "Optimal control: linear quadratic methods", 1990, chapter 2; the
doubling algorithm, which squares A in each round, is E. K.-W. Chu et al., "A structure-preserving doubling
algorithm for periodic discrete-time algebraic Riccati equations", Int. J. Control 77(8), 2004.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.control.holding import effort_limits, static_efforts, stops
from redundant_envs.control.linearisation import STEP, from_differences
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
ROUNDS = 40  # of doubling, 2^40 intervals: more than any motion that is not at rest by then
SETTLED = 1e-12  # relative change of P in the last round


def riccati(a: Array, b: Array, q: Array, r: Array) -> Array:
    """P (..., m, m) of A (..., m, m), B (..., m, k), Q (m, m) and R (k, k). ValueError if it does not settle:
    then the efforts do not stabilise the arm, or Q does not see what grows."""
    eye, g, p = np.eye(a.shape[-1]), b @ np.linalg.inv(r) @ b.swapaxes(-1, -2), np.broadcast_to(q, a.shape)
    with np.errstate(over="ignore", invalid="ignore"):  # without a solution P has no bound
        for _ in range(ROUNDS):
            at, back = a.swapaxes(-1, -2), np.linalg.inv(eye + g @ p)
            grown = at @ p @ back @ a
            g, a, p = g + a @ back @ g @ at, a @ back @ a, p + grown
            if not np.isfinite(p).all():
                break
            if (np.abs(grown).max(axis=(-1, -2)) <= SETTLED * np.abs(p).max(axis=(-1, -2))).all():
                return 0.5 * (p + p.swapaxes(-1, -2))
    raise ValueError(
        "the Riccati equation has no solution; the efforts do not stabilise this pose, or Q is 0"
    )


class HoldingLQR:
    """Feedback that holds poses against small disturbances.

    The costs are those of the joints: |positions / 1 rad or 0.25 m|^2 and |rates x settling|^2, both by the
    same measure, and effort_weight |efforts / limits|^2.

    Parameters
    ----------
    scene : Scene
        With EffortLimits, and without effects that have states.
    q : (..., n)
        Poses to hold, rad and m; no slider within ``linearisation.STEP`` of a stop, where A jumps.
    settling : float
        Time in which a rate counts like a position, s.
    effort_weight : float

    Raises
    ------
    ValueError
        For other scenes and poses, or poses that the efforts do not stabilise.
    """

    def __init__(
        self, scene: Scene, q: ArrayLike, settling: float = 0.1, effort_weight: float = 0.01
    ) -> None:
        self.limits, self.pose, robot = effort_limits(scene), np.asarray(q, dtype=np.float64), scene.robot
        self.efforts = static_efforts(scene, self.pose)
        if not (np.abs(self.efforts) < self.limits).all():
            most = (np.abs(self.efforts) / self.limits).max()
            raise ValueError(f"q has a pose that needs {most:.3g} times its limits of efforts; give others")
        joints = self.pose @ robot.motor_map
        for k, (low, high) in stops(scene).items():
            if not ((joints[..., k] > low + STEP) & (joints[..., k] < high - STEP)).all():
                raise ValueError(
                    f"q has {robot.joints[k]!r} at a stop, {low} or {high} m; give poses between them"
                )
        rest = np.zeros_like(self.pose)
        a, b = from_differences(scene)(np.concatenate([self.pose, rest], axis=-1), self.efforts)
        n, sizes = len(self.limits), np.where(robot.prismatic, 4.0, 1.0)
        positions = robot.motor_map * sizes**2 @ robot.motor_map.T
        zero = np.zeros((n, n))
        self.state_cost = np.block([[positions, zero], [zero, settling**2 * positions]])
        self.effort_cost = effort_weight * np.diag(1.0 / self.limits**2)
        p = riccati(a, b, self.state_cost, self.effort_cost)
        bt = b.swapaxes(-1, -2)
        self.gain = np.linalg.solve(self.effort_cost + bt @ p @ b, bt @ p @ a)

    def action(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Efforts / limits, (..., n), clipped to -1 and 1 as motors do."""
        apart = np.concatenate([np.asarray(q) - self.pose, np.asarray(qd, dtype=np.float64)], axis=-1)
        efforts = self.efforts - (self.gain @ apart[..., None])[..., 0]
        return np.clip(efforts / self.limits, -1.0, 1.0)
