"""Metrics of the accuracy study: plain functions of states."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import Gravity
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scenes.scene import Scene
from studies.accuracy_config import States

Array = NDArray[np.float64]

OFFSET = 1e-7
"""Distance of two motions whose separation gives the Lyapunov exponent, rad, m, rad/s and m/s."""


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


def weightless(scene: Scene) -> Scene:
    """The same scene with g = 0: the same simulator, another number."""
    effects = tuple(dataclasses.replace(e, g=0.0) if isinstance(e, Gravity) else e for e in scene.effects)
    return dataclasses.replace(scene, effects=effects)


def momentum_error(scene: Scene, start: States, end: tuple[Array, Array]) -> Array:
    """Change of the angular momentum about the base, (n,), in units of the median one of the starts."""
    arm: Any = scene.robot
    before = arm.angular_momentum(*start[:2])
    finite = finite_states(*end)
    with np.errstate(all="ignore"):
        change = np.abs(arm.angular_momentum(*end) - before) / np.median(np.abs(before))
    return np.where(finite & np.isfinite(change), change, np.inf)


def penetration(path: Array, ends: dict[int, tuple[float, float]]) -> Array:
    """Largest penetration of the stops by sliders in each motion, (n,), m; path is (T, n, 4)."""
    beyond = [np.maximum(low - path[..., k], path[..., k] - high) for k, (low, high) in ends.items()]
    deepest = np.maximum(np.max(beyond, axis=(0, 1)), 0.0)
    return np.where(np.isfinite(deepest), deepest, np.inf)


def lyapunov(scene: Scene, start: States, seconds: float, seed: int = 0) -> Array:
    """Largest Lyapunov exponent of the free motion from each state, (n,), 1/s, after Benettin: two motions
    start ``OFFSET`` apart, and after each control interval the second is moved back to that distance."""
    q, qd, _ = start
    n = len(q)
    low, high = np.full(4, -np.inf), np.full(4, np.inf)
    for joint, ends in (stops(scene) or {}).items():
        low[joint], high[joint] = ends
    apart = np.random.default_rng(seed).normal(size=(n, 8))
    batch = BatchSimulator(scene, 2 * n)
    second = np.arange(n, 2 * n)
    batch.set_state(q, qd, np.arange(n))
    growth = np.zeros(n)
    intervals = round(seconds / scene.control_dt)
    for _ in range(intervals):
        q, qd = batch.q[:n], batch.qd[:n]
        apart *= OFFSET / np.linalg.norm(apart, axis=1, keepdims=True)
        near_q, near_qd = np.clip(q + apart[:, :4], low, high), qd + apart[:, 4:]
        before = np.linalg.norm(np.concatenate([near_q - q, near_qd - qd], axis=1), axis=1)
        batch.set_state(near_q, near_qd, second)
        batch.advance()
        q, qd = batch.q, batch.qd
        apart = np.concatenate([q[n:] - q[:n], qd[n:] - qd[:n]], axis=1)
        growth += np.log(np.linalg.norm(apart, axis=1) / before)
    return growth / (intervals * scene.control_dt)


def digits(difference: float, scale: float) -> float:
    """Decimal digits to which two numbers of this size agree; float64 has 15.7."""
    return float(-np.log10(max(difference / scale, np.finfo(float).eps)))
