"""Metrics of the accuracy study: plain functions of states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import CentringSpring, Gravity
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scenes.scene import Scene
from studies.accuracy_config import States

Array = NDArray[np.float64]


def stops(scene: Scene) -> dict[int, tuple[float, float]] | None:
    """Travel between the hard stops of a scene: joint -> its ends, m; None without stops."""
    values = scene.parameters()
    ends = {
        joint: (values[low], values[high])
        for joint, (low, high) in scene.travel().items()
        if low.startswith("prismatic_stop.")
    }
    return ends or None


def end(scene: Scene, start: States, seconds: float) -> tuple[Array, Array]:
    """q and qd of a scene with its own stepping, (n, 4), after a whole number of control intervals."""
    batch = BatchSimulator(scene, len(start[0]))
    batch.set_state(*start[:2])
    for _ in range(round(seconds / scene.control_dt)):
        batch.advance(start[2])
    return batch.q, batch.qd


def finite_states(*tables: Array) -> NDArray[np.bool_]:
    """Whether all entries of a state are finite, (n,)."""
    return np.asarray(np.isfinite(np.concatenate(tables, axis=1)).all(axis=1))


def tip_error(scene: Scene, q: Array, reference: Array) -> Array:
    """Distance of the tips, (n,), m; infinite where q is not finite."""
    arm: Any = scene.robot
    finite = finite_states(q)
    q = np.where(finite[:, None], q, reference)
    error = np.linalg.norm(arm.forward_kinematics(q) - arm.forward_kinematics(reference), axis=1)
    return np.where(finite, error, np.inf)


def largest_error(values: Array, reference: Array) -> Array:
    """Largest difference of the four entries, (n,); infinite where it is not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(values - reference).max(axis=1)
    return np.where(np.isfinite(error), error, np.inf)


def quantile(errors: Array, share: float) -> float:
    """Quantile: the smallest of the errors that this share of the states does not exceed."""
    return float(np.quantile(errors, share, method="inverted_cdf"))


def energy(scene: Scene, q: Array, qd: Array) -> Array:
    """Kinetic plus potential energy, (n,), J; infinite where the state is not finite."""
    finite = finite_states(q, qd)
    q, qd = (np.where(finite[:, None], x, 0.0) for x in (q, qd))
    with np.errstate(over="ignore"):
        total = kinetic_energy(scene, q, qd) + potential_energy(scene, q)
    return np.where(finite & np.isfinite(total), total, np.inf)


def energy_scale(scene: Scene, middle: ArrayLike) -> float:
    """Energy that raises the stretched arm from level to upright on Earth, J; sliders are as in
    ``middle``."""
    arm: Any = scene.robot
    upright = np.where(arm.prismatic, np.asarray(middle), 0.5 * np.pi)
    level = np.where(arm.prismatic, np.asarray(middle), 0.0)
    return float(arm.potential_energy(upright) - arm.potential_energy(level))


def keeps_energy(scene: Scene) -> bool:
    """Whether only the integrator can change the energy of a free motion."""
    values = scene.parameters()
    lossless = (Gravity, CentringSpring)
    return all(isinstance(e, lossless) or values.get(f"{e.key}.restitution") == 1.0 for e in scene.effects)


def digits(difference: float, scale: float) -> float:
    """Decimal digits to which two numbers of this size agree; float64 has 15.7."""
    return float(-np.log10(max(difference / scale, np.finfo(float).eps)))
