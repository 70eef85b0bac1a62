"""Is a scene right, and its step fine enough? Energies are checked and far finer steps taken, from random
states."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scene import Scene
from redundant_envs.studies.arm_equations import arm_faults
from redundant_envs.studies.conservation import Book, Potential, energy_book, potentials

FINE, FINER = 16, 32
"""Substeps of the two references, in units of the scene's own."""
ENOUGH = 1e-3
"""Tip error of a control interval [m] that is called good enough at its 99th percentile."""


BEYOND = 0.5
"""How far beyond the travel potentials are looked at, in units of it: springs at its ends act only there."""


@dataclass(frozen=True)
class Verification:
    """Errors of one control interval over random states.

    Attributes
    ----------
    tip_error : median, 99th percentile and maximum, m
    reference : largest difference of the two references, m
    energy : 99th percentile of |change of energy - work|, J
    inverse : largest residual of inverse(forward) dynamics, relative
    missed : share of states whose tip error is above the scene's tolerance without a flag; None
        for a scene without a tolerance
    equations : what contradicts the point masses in the equations of the arm
    potentials : every effect that has a potential, against its force
    book : kinetic + potential - work of the interval, with steps of dop853
    """

    tip_error: tuple[float, float, float]
    reference: float
    energy: float
    inverse: float
    missed: float | None
    equations: tuple[str, ...]
    potentials: tuple[Potential, ...]
    book: Book

    @property
    def fine_enough(self) -> bool:
        """Whether the 99th percentile of the tip error is below 1 mm."""
        return self.tip_error[1] < ENOUGH

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with the scene's arm and effects: no step is fine enough to mend it."""
        faults = (*self.equations, *(p.fault for p in self.potentials), self.book.fault)
        return tuple(fault for fault in faults if fault)

    @property
    def good(self) -> bool:
        """Whether the scene is right and its own step fine enough."""
        return self.fine_enough and not self.faults


def random_states(
    scene: Scene, count: int, seed: int, beyond: float = 0.0
) -> tuple[NDArray[np.float64], ...]:
    """Coordinates, velocities and efforts, (count, joints) each.

    Angles uniform all around, travel uniform, rates normal: 2 rad/s, 0.5 m/s. One slider in four
    stands still at an end of its travel. Efforts are uniform within the scene's limits, if it has some.
    ``beyond`` widens the travel to both sides, in units of itself.
    """
    arm: Any = scene.robot
    rng = np.random.default_rng(seed)
    prismatic, shape = np.array(arm.prismatic), (count, len(arm.joints))
    joints = rng.uniform(-np.pi, np.pi, shape)
    joints[:, prismatic] = rng.uniform(0.0, 0.2, (count, int(prismatic.sum())))
    values = scene.parameters()
    for joint, (low, high) in scene.travel().items():
        margin = beyond * (values[high] - values[low])
        joints[:, joint] = rng.uniform(values[low] - margin, values[high] + margin, count)
    rates = rng.normal(0.0, 1.0, shape) * np.where(prismatic, 0.5, 2.0)
    for joint, (low, high) in scene.travel().items():
        if prismatic[joint]:
            at_end = rng.random(count) < 0.25
            ends = np.where(rng.random(count) < 0.5, values[low], values[high])
            joints[at_end, joint], rates[at_end, joint] = ends[at_end], 0.0
    limits = np.array([values[name] for name in scene.action_units()] or [0.0])
    inverse = np.linalg.inv(arm.motor_map)
    return joints @ inverse, rates @ inverse, rng.uniform(-1.0, 1.0, shape) * limits


def verify(scene: Scene, count: int = 1024, seed: int = 0) -> Verification:
    """Measure the errors of a scene's own step, and check how its effects are booked.

    Parameters
    ----------
    scene : Scene
        Its effects may be a program's own.
    count : int
        Random states.
    seed : int
        Of the states.
    """
    arm: Any = scene.robot
    if count < 1:
        raise ValueError(f"states is {count}; give at least 1")
    q, qd, efforts = random_states(scene, count, seed)

    def ends(factor: int) -> tuple[NDArray[Any], ...]:
        finer = scene
        if factor > 1:
            method = "rk8" if scene.integrator == "dop853" else scene.integrator
            finer = dataclasses.replace(
                scene, integrator=method, substeps=factor * scene.substeps, tolerance=None
            )
        batch = BatchSimulator(finer, count, track_work=True)
        batch.set_state(q, qd)
        status = batch.advance(efforts)
        return batch.q, batch.qd, batch.work, status.numerics

    own, fine, finest = ends(1), ends(FINE), ends(FINER)
    tips = [arm.forward_kinematics(x[0]) for x in (own, fine, finest)]
    error = np.linalg.norm(tips[0] - tips[2], axis=1)
    before = kinetic_energy(scene, q, qd) + potential_energy(scene, q)
    after = kinetic_energy(scene, own[0], own[1]) + potential_energy(scene, own[0])
    book = np.abs(after - before - own[2])
    forces = np.random.default_rng(seed + 1).normal(0.0, 5.0, q.shape)
    back = arm.inverse_dynamics(q, qd, arm.forward_dynamics(q, qd, forces))
    return Verification(
        tip_error=(float(np.median(error)), float(np.quantile(error, 0.99)), float(error.max())),
        reference=float(np.linalg.norm(tips[1] - tips[2], axis=1).max()),
        energy=float(np.quantile(book, 0.99)),
        missed=None if scene.tolerance is None else float(np.mean((error > scene.tolerance) & (own[3] == 0))),
        equations=arm_faults(arm, q, qd),
        potentials=potentials(scene, random_states(scene, count, seed, BEYOND)[0]),
        book=energy_book(scene, q, qd, efforts),
        inverse=float((np.abs(back - forces).max(axis=1) / np.abs(forces).max(axis=1)).max()),
    )
