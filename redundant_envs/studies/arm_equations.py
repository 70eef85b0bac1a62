"""Do the equations of an arm belong together? Each is found again from the point masses by differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import numbered
from redundant_envs.robots.arm import Arm

Array = NDArray[np.float64]

STEP = 1e-4
"""Of coordinates, rad and m; two differences of fourth order leave some 1e-11 of what they are taken of."""
AGREE = 1e-6
"""Largest difference, in units of the largest entry: far above what differences leave."""


def slopes(function: Callable[[Array], Array], q: Array) -> Array:
    """Derivatives by each coordinate, on a last axis, by central differences of order four."""
    columns = []
    for k in range(q.shape[-1]):
        step = STEP * np.eye(q.shape[-1])[k]
        near = function(q + step) - function(q - step)
        far = function(q + 2.0 * step) - function(q - 2.0 * step)
        columns.append((8.0 * near - far) / (12.0 * STEP))
    return np.stack(columns, axis=-1)


def arm_faults(arm: Arm, q: Array, qd: Array) -> tuple[str, ...]:
    """What contradicts the point masses at some states (n, joints): names of equations, with how far off."""
    masses = np.array(arm.masses)
    of_points = slopes(arm.points, q)  # (n, masses, 2, joints)
    inertia = np.einsum("p,npai,npaj->nij", masses, of_points, of_points)
    change = slopes(arm.mass_matrix, q)  # (n, i, j, k)
    bias = np.einsum("nijk,nj,nk->ni", change, qd, qd) - 0.5 * np.einsum("njki,nj,nk->ni", change, qd, qd)
    turned = slopes(arm.jacobian, q)  # (n, 2, j, k)
    height = np.einsum("p,npj->nj", masses, of_points[:, :, 1])
    positions, rates = _named(arm, "phi{}", q, qd), _named(arm, "phid{}", q, qd)
    B = arm.motor_map
    expected: dict[str, tuple[Array, Array]] = {
        "tip": (arm.forward_kinematics(q), arm.points(q)[:, -1]),
        "J": (arm.jacobian(q), of_points[:, -1]),
        "Jdqd": (arm.jacobian_dot_qd(q, qd), np.einsum("najk,nj,nk->na", turned, qd, qd)),
        "M": (arm.mass_matrix(q), inertia),
        "h": (arm.bias_forces(q, qd), bias),
        "G": (arm.gravity_forces(q, 1.0), height),
        "T": (arm.kinetic_energy(q, qd), 0.5 * np.einsum("nij,ni,nj->n", inertia, qd, qd)),
        "phi and phid": (
            rates,
            np.einsum("nij,nj->ni", slopes(lambda x: _named(arm, "phi{}", x, qd), q), qd),
        ),
        "phid and Q": (rates, qd @ B),
        "coordinates_of_joints": (_coordinates(arm, positions), q),
    }
    told = []
    for name, (given, found) in expected.items():
        gap = float(np.abs(given - found).max() / max(float(np.abs(found).max()), 1e-300))
        if not gap <= AGREE:
            told.append(f"{arm.kind}: {name} contradicts the point masses by {gap:.1e} of its size")
    return tuple(told)


def _named(arm: Arm, form: str, q: Array, qd: Array) -> Array:
    values: dict[str, Any] = dict(arm.parameter_values())
    values |= {name: q[:, k] for k, name in enumerate(arm.coordinates)}
    values |= {name: qd[:, k] for k, name in enumerate(arm.rates)}
    found = arm.evaluate(numbered(form, len(arm.joints)), values)
    return np.stack([np.broadcast_to(x, len(q)) for x in found], axis=-1)


def _coordinates(arm: Arm, positions: Array) -> Array:
    """Coordinates from joint positions."""
    found = arm.coordinates_of_joints(*positions.T)
    return np.stack(found if isinstance(found, tuple) else (found,), axis=-1)
