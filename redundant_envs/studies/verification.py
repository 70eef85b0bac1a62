"""Is a scene simulated right? Its own step against far finer ones, from random states."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scene import Scene

FINE, FINER = 16, 32
"""Substeps of the two references, in units of the scene's own."""
ENOUGH = 1e-3
"""Tip error of a control interval [m] that is called good enough at its 99th percentile."""


@dataclass(frozen=True)
class Verification:
    """Errors of one control interval over random states.

    Attributes
    ----------
    tip_error : median, 99th percentile and maximum, m
    reference : largest difference of the two references, m
    energy : 99th percentile of |change of energy - work|, J
    inverse : largest residual of inverse(forward) dynamics, relative
    """

    tip_error: tuple[float, float, float]
    reference: float
    energy: float
    inverse: float

    @property
    def good(self) -> bool:
        """Whether the 99th percentile of the tip error is below 1 mm."""
        return self.tip_error[1] < ENOUGH


def random_states(scene: Scene, count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles uniform all around, travel uniform, rates normal: 2 rad/s, 0.5 m/s."""
    arm: Any = scene.robot
    rng = np.random.default_rng(seed)
    prismatic = np.array(arm.prismatic)
    joints = rng.uniform(-np.pi, np.pi, (count, 4))
    joints[:, prismatic] = rng.uniform(0.0, 0.2, (count, int(prismatic.sum())))
    values = scene.parameters()
    for joint, (low, high) in scene.travel().items():
        joints[:, joint] = rng.uniform(values[low], values[high], count)
    rates = rng.normal(0.0, 1.0, (count, 4)) * np.where(prismatic, 0.5, 2.0)
    inverse = np.linalg.inv(arm.motor_map)
    return joints @ inverse, rates @ inverse


def verify(scene: Scene, count: int = 1024, seed: int = 0) -> Verification:
    """Measure the errors of a scene's own step."""
    arm: Any = scene.robot
    q, qd = random_states(scene, count, seed)

    def ends(factor: int) -> tuple[NDArray[np.float64], ...]:
        finer = scene
        if factor > 1:
            method = "rk8" if scene.integrator == "dop853" else scene.integrator
            finer = dataclasses.replace(
                scene, integrator=method, substeps=factor * scene.substeps, tolerance=None
            )
        batch = BatchSimulator(finer, count, track_work=True)
        batch.set_state(q, qd)
        batch.advance()
        return batch.q, batch.qd, batch.work

    own, fine, finest = ends(1), ends(FINE), ends(FINER)
    tips = [arm.forward_kinematics(x[0]) for x in (own, fine, finest)]
    error = np.linalg.norm(tips[0] - tips[2], axis=1)
    before = kinetic_energy(scene, q, qd) + potential_energy(scene, q)
    after = kinetic_energy(scene, own[0], own[1]) + potential_energy(scene, own[0])
    book = np.abs(after - before - own[2])
    forces = np.random.default_rng(seed + 1).normal(0.0, 5.0, (count, 4))
    back = arm.inverse_dynamics(q, qd, arm.forward_dynamics(q, qd, forces))
    return Verification(
        tip_error=(float(np.median(error)), float(np.quantile(error, 0.99)), float(error.max())),
        reference=float(np.linalg.norm(tips[1] - tips[2], axis=1).max()),
        energy=float(np.quantile(book, 0.99)),
        inverse=float((np.abs(back - forces).max(axis=1) / np.abs(forces).max(axis=1)).max()),
    )
