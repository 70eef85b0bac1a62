"""Joint paths along which the tips of many lanes follow given points, while their postures improve as far as
that leaves freedom: resolved motion (Whitney 1969) with a null-space term (Liegeois 1977), damped near
singular poses, since among many plans some pass them, and with each point reached in itself:

    step = J# (p - x) + (1 - J# J) dt z,    J# = W J^T (J W J^T + damping)^-1
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.nominal import NominalModel

Array = NDArray[np.float64]
DAMPING = 1e-5  # m^2, of the inverse near singular poses: it changes a step by 1 % where sigma is 3 cm
SLIDERS = 0.06  # weight of sliders in the inverse, those of turns being 1: their travel is short
LARGEST_STEP = 0.3  # rad or m, of a joint between two points
EVERY = 2  # points for which a posture's rates serve: they change little, and take most of the time
STEP = 1e-4  # rad and m, of central differences
MOST_SLOPE = 4.0  # of log manipulability, which has no bound near singular poses
CENTRING = 6.0  # 1/s, of sliders towards the middle of their travel


def joint_path(
    model: NominalModel, phi: Array, targets: Array, dt: float,
    posture: Callable[[Array], Array] | None,
) -> Array:  # fmt: skip
    """Paths (m, points, joints) from poses phi (m, joints) at the first of targets (m, points, 2), m, that
    are ``dt`` [s] apart. ``posture`` (phi) gives the rates z (m, joints), of which the part acts that moves
    no tip; None is no rates."""
    path = np.empty((*targets.shape[:2], model.joints))
    path[:, 0] = phi
    drift = np.zeros_like(phi)
    for k in range(1, targets.shape[1]):
        if posture is not None and k % EVERY == 1:
            drift = dt * posture(phi)
        phi = _moved(model, phi, targets[:, k], drift)
        path[:, k] = phi = _moved(model, phi, targets[:, k], np.zeros_like(phi))  # for the arm's curvature
    return path


def _moved(model: NominalModel, phi: Array, target: Array, drift: Array) -> Array:
    """Poses (m, joints) with the tips nearer to the targets (m, 2), and moved by the part of the drift in the
    null space. A slider does not leave its travel, and the other joints make up for it."""
    jacobian, (low, high) = model.jacobian(phi), model.travel
    way, free = target - model.tip(phi), np.ones_like(phi)
    weight = np.where(model.slides, SLIDERS, 1.0)
    for _ in range(1 + model.slides.sum()):
        freed = jacobian * free[:, None]
        across = weight[:, None] * freed.transpose(0, 2, 1)
        inverse = across @ np.linalg.inv(freed @ across + DAMPING * np.eye(2))
        part = free * drift
        step = part + (inverse @ (way[..., None] - freed @ part[..., None]))[..., 0]
        leaves = ((phi <= low) & (step < 0.0)) | ((phi >= high) & (step > 0.0))
        if not leaves.any():
            break
        free[leaves] = 0.0
    return np.clip(phi + np.clip(free * step, -LARGEST_STEP, LARGEST_STEP), low, high)


def mobility_slopes(model: NominalModel, phi: Array) -> Array:
    """Slopes (m, joints) of the logarithm of manipulability (Yoshikawa 1985) by the joints; those of sliders
    are replaced by rates to the middle of their travel, 1/s."""
    around = phi[:, None] + STEP * np.concatenate([np.eye(model.joints), -np.eye(model.joints)])
    log = np.log(np.maximum(model.arm.manipulability(around @ model.inverse), STEP))
    ahead, behind = log[:, : model.joints], log[:, model.joints :]
    slopes = np.clip((ahead - behind) / (2.0 * STEP), -MOST_SLOPE, MOST_SLOPE)
    if not model.slides.any():
        return slopes
    low, high = (end[model.slides] for end in model.travel)
    slopes[:, model.slides] = CENTRING * (0.5 * (low + high) - phi[:, model.slides])
    return slopes
