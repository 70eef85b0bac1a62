"""Energies of an arm over time, as in figures 1 and 2 of the report."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import Gravity
from redundant_envs.model.energy import potential_energy
from redundant_envs.model.trajectory import Trajectory, simulate
from redundant_envs.scene import Scene
from redundant_envs.tables import write_rows

Array = NDArray[np.float64]

STARTS: dict[str, tuple[float, float, float, float]] = {
    "rprp_report_spring": (1.2, 0.25, 0.4, 0.2),
    "rprp_stops": (1.2, 0.25, 0.4, 0.2),
    "rprp_limit_springs": (1.2, 0.25, 0.4, 0.2),
    "four_r_free": (0.0, -0.3, -0.6, -0.9),
}
"""Scenes of the report's experiment and the pose in which the arm starts: rad, and m for sliders. The
report states neither parameters nor a start; these are ours."""

SAMPLE_INTERVAL = 0.005
"""Longest time between rows of a recorded motion, s."""


@dataclass(frozen=True)
class EnergyRun:
    """A motion and its energies."""

    name: str
    scene: Scene
    trajectory: Trajectory

    @property
    def total(self) -> Array:
        """Kinetic plus potential energy, (T,), J."""
        return self.trajectory.kinetic_energy + self.trajectory.potential_energy

    @property
    def balance(self) -> Array:
        """Total energy minus the work done on the arm, (T,), J: constant but for integration error."""
        return self.total - self.trajectory.work

    @property
    def without_springs(self) -> Array | None:
        """Kinetic energy plus that of gravity alone, (T,), J; None if that is the total."""
        field = tuple(e for e in self.scene.effects if isinstance(e, Gravity))
        gravity = potential_energy(dataclasses.replace(self.scene, effects=field), self.trajectory.q)
        same = np.array_equal(gravity, self.trajectory.potential_energy)
        return None if same else self.trajectory.kinetic_energy + gravity

    @property
    def scale(self) -> float:
        """Scale of a drift, J: the energy that was exchanged."""
        potential = self.trajectory.potential_energy
        return float(max(self.trajectory.kinetic_energy.max(), np.ptp(potential), 1e-300))

    @property
    def relative_error(self) -> Array:
        """Departure of the balance from its start, (T,), relative to ``scale``."""
        return (self.balance - self.balance[0]) / self.scale

    @property
    def drift(self) -> float:
        """Largest relative error."""
        return float(np.abs(self.relative_error).max())


def default_start(name: str, scene: Scene) -> tuple[float, ...]:
    """Default start of a scene: the known one, else level with sliders in mid travel."""
    if name in STARTS:
        return STARTS[name]
    values, q = scene.parameters(), [0.0] * len(scene.robot.joints)
    for k, (low, high) in scene.travel().items():
        if scene.robot.prismatic[k]:
            q[k] = 0.5 * (values[low] + values[high])
    return tuple(q)


def check_start(scene: Scene, seconds: float, q: ArrayLike, qd: ArrayLike | None = None) -> None:
    """ValueError for invalid arguments of :func:`energy_run`."""
    if not np.isfinite(seconds) or seconds <= 0.0:
        raise ValueError(f"seconds is {seconds}; it must be positive and finite")
    joints = len(scene.robot.joints)
    for field, value in (("q", q), ("qd", qd)):
        if value is not None and (np.shape(value) != (joints,) or not np.isfinite(value).all()):
            raise ValueError(f"{field} is {value!r}; give {joints} finite numbers")


def energy_run(
    name: str, scene: Scene, seconds: float, q: ArrayLike, qd: ArrayLike | None = None
) -> EnergyRun:
    """Release the arm at q, with velocities qd or at rest, without motor efforts, and record its motion for
    some seconds."""
    qd = (0.0,) * len(scene.robot.joints) if qd is None else qd
    check_start(scene, seconds, q, qd)
    rows = max(1, round(seconds / min(scene.control_dt, SAMPLE_INTERVAL)))
    return EnergyRun(name, scene, simulate(scene, q, qd, np.linspace(0.0, seconds, rows + 1)))


def write_csv(run: EnergyRun, path: Path) -> None:
    """Write t [s], states and energies [J], one row per recorded time."""
    arm, motion = run.scene.robot, run.trajectory
    header = ["t", *arm.coordinates, *arm.rates, "kinetic", "potential", "work", "total"]
    columns = (motion.t, motion.q, motion.qd, motion.kinetic_energy, motion.potential_energy, motion.work)
    values = np.column_stack([*columns, run.total]).tolist()
    write_rows([dict(zip(header, row, strict=True)) for row in values], header, path)
