"""The backward pass of iLQR: the best small change of a motion whose efforts are limited, and its feedback.

Source: Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming", ICRA 2014.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Expansion = tuple[Array, Array, Array, Array]
"""Gradients and second derivatives of a cost by the states, (T + 1, n, m) and (T + 1, n, m, m), and by the
actions, (T, n, k) and (T, n, k, k)."""
SHARES = 0.5 ** np.arange(8.0)  # of a step that are tried: one of less than 1/128 is of no use
ROUNDS = 12  # of Newton's method in the box: with four actions the set at a limit settles in fewer
SMALL = 1e-9  # Newton step at which it ends, shares of the limits


def box_minimum(h: Array, g: Array, low: Array, high: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The x (n, k) between low and high, which include 0, with the least x.H x / 2 + g.x, H positive
    definite, by projected Newton steps; and which entries are free there."""
    x, eye = np.zeros_like(g), np.eye(g.shape[-1])
    for _ in range(ROUNDS):
        slope = g + (h @ x[..., None])[..., 0]
        free = ~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0)))
        both = free[..., None] & free[..., None, :]
        newton = -np.linalg.solve(np.where(both, h, eye), (slope * free)[..., None])[..., 0]
        if not np.abs(newton).max() > SMALL:
            break
        trial = np.clip(x + SHARES[:, None, None] * newton, low, high)
        value = ((((0.5 * h) @ trial[..., None])[..., 0] + g) * trial).sum(axis=-1)
        x = np.take_along_axis(trial, value.argmin(axis=0)[None, :, None], axis=0)[0]
    return x, free


def backward(a: Array, b: Array, costs: Expansion, actions: Array, damping: Array) -> tuple[Array, Array]:
    """Change of the actions (T, n, k) and feedback (T, n, k, m), from the last interval to the first.

    Parameters
    ----------
    a, b : (T, n, m, m), (T, n, m, k)
        Of the intervals, x' = a x + b u.
    costs : Expansion
    actions : (T, n, k)
        Of the motion, -1 to 1.
    damping : (n,)
        Weight of the change, in units of the mean second derivative by the actions.
    """
    lx, lxx, lu, luu = costs
    eye, vx, vxx = np.eye(actions.shape[-1]), lx[-1], lxx[-1]
    change, gains = np.zeros_like(actions), np.zeros((*actions.shape, lx.shape[-1]))
    for k in reversed(range(len(actions))):
        bt = b[k].swapaxes(-1, -2)
        qu = lu[k] + (bt @ vx[..., None])[..., 0]
        qux, quu = bt @ vxx @ a[k], luu[k] + bt @ vxx @ b[k]
        size = np.trace(quu, axis1=-2, axis2=-1) / len(eye)
        damped = quu + (damping * size)[:, None, None] * eye
        change[k], free = box_minimum(damped, qu, -1.0 - actions[k], 1.0 - actions[k])
        both = free[..., None] & free[..., None, :]
        gains[k] = -np.linalg.solve(np.where(both, damped, eye), qux * free[..., None])
        # What remains under the new actions and feedback: sums of squares, which rounding leaves positive.
        closed, gt, du = a[k] + b[k] @ gains[k], gains[k].swapaxes(-1, -2), change[k][..., None]
        ct = closed.swapaxes(-1, -2)
        vx = lx[k] + (gt @ (lu[k][..., None] + luu[k] @ du) + ct @ (vx[..., None] + vxx @ b[k] @ du))[..., 0]
        vxx = lxx[k] + gt @ luu[k] @ gains[k] + ct @ vxx @ closed
    return change, gains
