"""Motions of the joints that leave the tip where it is: projectors and a basis of the null space of J.

The metric that says which of many motions is smallest is given by its inverse, a symmetric matrix A:

* A = M(q)^-1: dynamically consistent. Of all motions of the tip's velocity the one with the least kinetic
  energy, and forces N^T Q do not accelerate the tip (O. Khatib, "A unified approach for motion and force
  control of robot manipulators: the operational space formulation", IEEE J. Robotics and Automation 3(1),
  1987).
* A = :func:`kinematic_mobility`: the least squares of the rates of the joints, radians beside metres that are
  divided by a length (without it the result depends on the unit of length: K. L. Doty et al., "A theory of
  generalized inverses applied to robotics", Int. J. Robotics Research 12(1), 1993).

A joint whose row and column of A are zero stays where it is. Where J A J^T has less than full rank there is
no inverse, and a ValueError says in how many poses; nothing is damped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.robots.arm import Arm

Array = NDArray[np.float64]
SINGULAR = 1e-6
"""Ratio of the singular values of J, in the metric, below which a pose is singular: J A J^T has then lost
twelve of its sixteen digits."""


def kinematic_mobility(robot: Arm) -> Array:
    """A, (n, n), of |rates of the joints|^2 with sliders in units of the mean length of a link."""
    scale = np.where(robot.prismatic, np.mean(robot.lengths) ** 2, 1.0)
    inverse = np.linalg.inv(robot.motor_map)
    mobility: Array = inverse.T * scale @ inverse
    return mobility


def generalised_inverse(jacobian: ArrayLike, mobility: ArrayLike) -> Array:
    """A J^T (J A J^T)^-1, (..., n, k), of J (..., k, n) and A (..., n, n): of the rates that move the tip as
    wanted the smallest in the metric A^-1. ValueError at singular poses."""
    j = np.asarray(jacobian, dtype=np.float64)
    across = np.asarray(mobility, dtype=np.float64) @ j.swapaxes(-1, -2)
    square = j @ across
    least, *_, most = np.moveaxis(np.linalg.eigvalsh(square), -1, 0)
    if (singular := ~(least > SINGULAR**2 * most)).any():
        raise ValueError(
            f"jacobian has less than full rank in {singular.sum()} of {singular.size} poses, the first "
            f"of them {int(np.argmax(singular))}; leave singular poses out, or move less joints to them"
        )
    inverse: Array = across @ np.linalg.inv(square)
    return inverse


def null_projector(jacobian: ArrayLike, mobility: ArrayLike) -> Array:
    """N = 1 - A J^T (J A J^T)^-1 J, (..., n, n): J N = 0, N N = N, and J A N^T = 0, so that the forces N^T Q
    do not accelerate the tip where A = M^-1. ValueError at singular poses."""
    j = np.asarray(jacobian, dtype=np.float64)
    projector: Array = np.eye(j.shape[-1]) - generalised_inverse(j, mobility) @ j
    return projector


def posture_row(robot: Arm) -> Array:
    """A row c, (n,), for :func:`null_basis`: the rate c . qd that the first vector of the basis raises.

    With sliders it is the rate of the last one. That of RPRP is in no pose a combination of the rows of J, so
    the basis is smooth wherever both links have a length. Of revolute joints alone it is the alternating sum
    of l_k theta_k, a zigzag.
    """
    sliders = robot.sliders()
    if sliders:
        return np.asarray(robot.motor_map[:, sliders[-1]], dtype=np.float64)
    return np.array(robot.lengths) * (-1.0) ** np.arange(robot.num_lengths)


def null_basis(jacobian: ArrayLike, mobility: ArrayLike, row: ArrayLike) -> Array:
    """A basis of the null space of J, (..., n, n - 2), orthonormal in the metric A^-1.

    Of three joints it is the cross product of the rows of J, smooth in all poses that are not singular. Of
    four, the first vector is the projection of A c, the motion in which c . qd grows fastest, and the second
    is perpendicular to it, on the side of the cross product of the rows of J and N^T c. They are smooth where
    J has rank 2 and c is no combination of its rows. For RPRP and :func:`posture_row` that is everywhere. For
    4R and any c there are such poses, isolated curves in the space of the angles between links: around a
    singular pose the null spaces are the tangent planes of a sphere, which has no smooth field of tangents
    without a zero ("hairy ball"). With :func:`posture_row` they are zigzags: cos(theta_k - alpha) = (-1)^k b
    for some alpha, b.

    Parameters
    ----------
    jacobian : (..., 2, n)
        n is 3 or 4.
    mobility : (..., n, n)
        A, positive definite.
    row : (n,)
        c.

    Raises
    ------
    ValueError
        For another number of joints, at singular poses, and where c is a combination of the rows of J.
    """
    j, a, c = (np.asarray(x, dtype=np.float64) for x in (jacobian, mobility, row))
    n = j.shape[-1]
    if j.shape[-2] != 2 or n not in (3, 4):
        raise ValueError(f"jacobian has shape {j.shape}; give (..., 2, 3) or (..., 2, 4)")
    projector = null_projector(j, a)
    metric = np.linalg.inv(a).astype(np.float64)
    if n == 3:
        return _unit(_cross(j), metric)[..., None]
    across = c @ projector  # N^T c
    first = (a @ across[..., None])[..., 0]  # A N^T c = N A c
    share = (first * across).sum(axis=-1) / ((a @ c) @ c if a.ndim == 2 else (a @ c * c).sum(axis=-1))
    if (lost := ~(share > SINGULAR**2)).any():
        raise ValueError(
            f"row is a combination of the rows of jacobian in {lost.sum()} of {lost.size} poses, the first "
            f"of them {int(np.argmax(lost))}; give another row there"
        )
    second = _cross(np.concatenate([j, across[..., None, :]], axis=-2))
    return np.stack([_unit(first, metric), _unit(second, metric)], axis=-1)


def _cross(rows: Array) -> Array:
    """The vector (..., n) perpendicular to n - 1 rows (..., n - 1, n): their minors."""
    minors = [(-1.0) ** k * np.linalg.det(np.delete(rows, k, axis=-1)) for k in range(rows.shape[-1])]
    return np.stack(minors, axis=-1)


def _unit(vector: Array, metric: Array) -> Array:
    """The vector with the length 1 in a metric."""
    size = (vector * (metric @ vector[..., None])[..., 0]).sum(axis=-1)
    unit: Array = vector / np.sqrt(size)[..., None]
    return unit
