"""One motion of a scene, or a batch of them, at requested times, and its energies."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.model.batch import BatchSimulator, Event, Numerics, Status
from redundant_envs.model.energy import kinetic_energy, potential_energy, weight_energy
from redundant_envs.model.parameters import numbers
from redundant_envs.robots import drawn
from redundant_envs.scenes.scene import ACCURACIES, Scene, check_scene
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.pieces import renewed
from redundant_envs.support.notebook import as_html, table
from redundant_envs.support.tables import write_rows
from redundant_envs.support.values import shown, warn

Array = NDArray[np.float64]
Efforts = None | ArrayLike | Callable[[float, Array, Array], ArrayLike]
TOLD = "_error_told"  # attribute of a scene whose user knows how inaccurate its steps are
STARTS = {
    **dict.fromkeys(("rprp_report_spring", "rprp_stops", "rprp_limit_springs"), (1.2, 0.25, 0.4, 0.2)),
    "four_r_free": (0.0, -0.3, -0.6, -0.9),
}
"""Scenes of the report's figures 1 and 2, and starts of our own, rad and m: the report states none."""
SAMPLE_INTERVAL = 0.005  # longest time between rows of a recorded motion, s


@dataclass(frozen=True)
class Trajectory:
    """States and energies at the requested times; kinetic + potential - work stays constant."""

    t: Array  # (T,) s
    q: Array  # (T, ..., joints)
    qd: Array
    kinetic_energy: Array  # (T, ...) J
    potential_energy: Array
    work: Array  # (T, ...) J: of the motors and of forces without a potential since the start
    efforts: Array
    """Efforts of the motors, (T, ..., joints), N m or N, applied from t on: behind limits and all else that
    effects put between command and motor. Nothing is applied from the last time on: there a callable is not
    asked for a new interval, and its last command counts."""
    scene: Scene = field(repr=False)
    events: list[Event] = field(default_factory=list)  # at the stops of the sliders, in the order of time
    z: Array | None = field(default=None, repr=False)
    """States of effects, (T, ..., states), in the order of ``Scene.states()``."""

    @property
    def tip(self) -> Array:
        """Position of the tip, (T, ..., 2), m."""
        return self.scene.robot.forward_kinematics(self.q)

    @property
    def total(self) -> Array:
        """Kinetic plus potential energy, (T, ...), J."""
        return self.kinetic_energy + self.potential_energy

    @property
    def balance(self) -> Array:
        """Total energy minus the work done on the arm, (T, ...), J: constant but for integration error."""
        return self.total - self.work

    @property
    def without_springs(self) -> Array | None:
        """Kinetic energy plus that of gravity alone, (T, ...), J; None if that is the total."""
        gravity = weight_energy(self.scene, self.q, self.z)
        return None if np.array_equal(gravity, self.potential_energy) else self.kinetic_energy + gravity

    @property
    def scale(self) -> float:
        """Scale of a drift, J: the energy that was exchanged."""
        return float(max(self.kinetic_energy.max(), np.ptp(self.potential_energy), 1e-300))

    @property
    def relative_error(self) -> Array:
        """Departure of the balance from its start, (T, ...), relative to ``scale``."""
        return (self.balance - self.balance[0]) / self.scale

    @property
    def drift(self) -> float:
        """Largest relative error."""
        return float(np.abs(self.relative_error).max())

    def _repr_html_(self) -> str:
        """The first motions, and their energies, for a notebook; ``rde.animate`` shows how they move."""
        arm = self.scene.robot

        def picture() -> str:
            return drawn.motions(arm, self.q.reshape(len(self.t), -1, len(arm.joints)))

        def facts() -> str:
            rows: dict[str, object] = {"arm": arm.kind, "times": len(self.t)}
            rows |= {"motions": int(np.prod(self.q.shape[1:-1], dtype=int)), "events": len(self.events)}
            rows |= {"energy error / energy exchanged": self.drift} if self.t.size else {}
            return table(("trajectory", ""), rows.items())

        return as_html(self, picture, facts)


def simulate(
    scene: Scene, q: ArrayLike, qd: ArrayLike, times: ArrayLike, efforts: Efforts = None, seed: int = 0
) -> Trajectory:
    """Simulate a scene from t = 0.

    Parameters
    ----------
    scene : Scene
    q, qd : (..., joints) arrays
        State at t = 0.
    times : (T,) array
        Increasing, not negative, s; hit exactly. Asking for more times does not change the motion.
    efforts : None, (joints,) array, or callable
        Joint efforts, N m and N; a callable of (t, q, qd) is called once per control instant.
    seed : int
        Of the draws of effects, as :class:`BatchSimulator` takes it; each motion has draws of its own.

    Returns
    -------
    Trajectory

    Warns
    -----
    UserWarning
        Once for each scene with equal steps of rk8, if their estimate of the tip error of a control interval
        is above 1e-6 m.
    """
    check_scene(scene)
    t = np.atleast_1d(numbers("times", times))
    if t.ndim != 1 or not np.isfinite(t).all() or (t < 0.0).any() or (np.diff(t) <= 0.0).any():
        raise ValueError(
            f"times must be finite, not negative and strictly increasing; they are {shown(times)}"
        )
    if t.size and not t[-1] < 2.0**53 * scene.control_dt:
        raise ValueError(f"times must be shorter than 2^53 control intervals of {scene.control_dt} s")
    joints, commands = len(scene.robot.joints), len(scene.command_units())
    starts = {name: numbers(name, value) for name, value in (("q", q), ("qd", qd))}
    for name, start in starts.items():
        if start.shape[-1:] != (joints,) or not np.isfinite(start).all():
            value = f"{shown(start)} of shape {start.shape}"
            raise ValueError(f"{name} is {value}; give finite numbers, {joints} along the last axis")
    q0, qd0 = np.broadcast_arrays(*starts.values())
    shape, count = q0.shape[:-1], q0.size // joints
    if not count:
        raise ValueError(f"q and qd have the shape {q0.shape} together; give at least one motion")
    batch = BatchSimulator(scene, count, track_work=True, seed=seed)
    batch.set_state(q0.reshape(count, joints), qd0.reshape(count, joints))
    dt, step, events, largest = scene.control_dt, 0, list[Event](), 0.0

    @functools.lru_cache(maxsize=1)
    def command(step: int) -> Array:
        """Commands of a control interval, (count, commands)."""
        value = efforts
        if callable(value):
            value = value(step * dt, *(x.reshape(*shape, joints) for x in (batch.q, batch.qd)))
        table = numbers("efforts", np.zeros(commands) if value is None else value)
        if table.shape != (commands,) and table.shape != (*shape, commands):
            raise ValueError(f"efforts has shape {table.shape}; give ({commands},) or {(*shape, commands)}")
        if not np.isfinite(table).all():
            raise ValueError(f"efforts has non-finite entries at t = {step * dt:.6g} s; give finite numbers")
        return np.broadcast_to(table, (*shape, commands)).reshape(count, commands)

    q_all, qd_all, applied = np.empty((3, len(t), count, joints))
    work, z_all = np.empty((len(t), count)), np.empty((len(t), count, len(scene.states())))
    for k, time in enumerate(t.tolist()):
        while step < _instant(time, dt):
            _check(status := batch.advance(command(step)), step * dt)
            largest = max(largest, float(np.max(status.error_estimate)))  # NaN, which is none, is not larger
            events += batch.events(step * dt)
            step += 1
        rest, here, now = time - step * dt, None, np.zeros((count, commands))
        if rest > 0.0 or time < t[-1] or not callable(efforts):
            now = command(step)
        elif step:
            now = command(step - 1)
        states = batch.z
        if rest > 0.0:
            here = batch.save()
            _check(batch.advance_partly(now, rest), step * dt)
            events += batch.events(step * dt) if time == t[-1] else []
        q_all[k], qd_all[k], z_all[k], work[k] = batch.q, batch.qd, batch.z, batch.work
        applied[k] = _motor_efforts(batch, now, rest, states)
        if here:
            batch.restore(here)
        if not (np.isfinite(q_all[k]).all() and np.isfinite(qd_all[k]).all()):
            raise ValueError(
                f"the motion is not finite at t = {time:.6g} s; take a shorter control_dt, more "
                "substeps, or a softer scene"
            )
    _tell_error(scene, largest)
    arrays = (x.reshape(len(t), *shape, *x.shape[2:]) for x in (q_all, qd_all, applied, z_all, work))
    q_all, qd_all, applied, z_all, work = arrays
    energies = kinetic_energy(scene, q_all, qd_all, z_all), potential_energy(scene, q_all, z_all)
    events.sort(key=lambda e: e.time)
    return Trajectory(t, q_all, qd_all, *energies, work, applied, scene, events, z_all)


def _motor_efforts(batch: BatchSimulator, command: Array, elapsed: float, begun: Array) -> Array:
    """Efforts of the motors, (num_envs, joints), under commands, (num_envs, commands), in the present states,
    ``elapsed`` [s] after the start of a control interval, at which the states of effects were ``begun``."""
    if not any(batch.scene.attached.chains.values()):
        return command
    dynamics = Dynamics(batch.scene, located=False)  # the state selects the laws
    states = dict(zip(dynamics.effect_states, batch.z.T, strict=True))
    # The interval has not ended, although the simulator has advanced to here.
    at_end = {*dynamics.effect_states.updated} - renewed(batch.scene.attached).keys()
    states |= {n: z for n, z in zip(states, begun.T, strict=True) if n in at_end}
    known = fields_of(dynamics)
    for a in batch.scene.attached.instants:
        states[a.passed] = np.where(0.0 <= known[a.instant] <= elapsed, 1.0, 0.0)
    known |= states | dict(zip(dynamics.commands, command.T, strict=True))
    efforts, _ = dynamics.efforts(dynamics.quantities([*batch.q.T, *batch.qd.T], known), "derivative")
    return np.stack([np.broadcast_to(effort, batch.num_envs) for effort in efforts], axis=1)


def _instant(time: float, dt: float) -> int:
    """The last control instant not after a time: the largest k whose ``k * dt``, rounded, is not above it."""
    k = int(time / dt)  # one off where the quotient is rounded over a whole number
    return next(n for n in (k + 1, k, k - 1) if n * dt <= time)


def _check(status: Status, time: float) -> None:
    """Raise an error if an interval was not simulated to the end, or not to the scene's tolerance."""
    if (status.numerics & Numerics.EVENT_BUDGET).any():
        raise ValueError(
            "the motion has more than 256 impacts (1024 with low bounces), or 65536 pieces, in the interval "
            f"at t = {time:.6g} s; take a shorter control_dt, more substeps, or a smaller restitution"
        )
    if (status.numerics & Numerics.NO_STEP_FOUND).any():
        raise ValueError(
            f"dop853 finds no step that is accurate in the interval at t = {time:.6g} s, where the motion is "
            "too stiff or not finite; take softer springs, less friction or smaller efforts"
        )
    if (status.numerics & Numerics.TOLERANCE_NOT_REACHED).any():
        warnings.warn(
            f"the tolerance is not reached in the control interval at t = {time:.6g} s; take a shorter "
            "control_dt or a softer scene",
            stacklevel=3,
        )


def _tell_error(scene: Scene, largest: float) -> None:
    """Tell once for each scene without error control by how much its steps missed the usual tolerance."""
    if scene.controlled or largest <= ACCURACIES["standard"] or vars(scene).get(TOLD):
        return
    vars(scene)[TOLD] = True
    steps = "one step" if scene.substeps == 1 else f"{scene.substeps} equal steps"
    warn(
        f"scene has no tolerance: with {steps} of {scene.integrator} for each control_dt of "
        f"{scene.control_dt:g} s the tip is off by up to {largest:.1g} m after one of them; give "
        f"tolerance={ACCURACIES['standard']:g}, or more substeps"
    )


def default_start(name: str, scene: Scene) -> tuple[float, ...]:
    """Default start of a scene: the known one, else level with sliders in mid travel."""
    if name in STARTS:
        return STARTS[name]
    values, q = scene.parameters(), [0.0] * len(scene.robot.joints)
    for k, (low, high) in scene.travel().items():
        if scene.robot.prismatic[k]:
            q[k] = 0.5 * (values[low] + values[high])
    return tuple(q)


def energy_run(scene: Scene, seconds: float, q: ArrayLike, qd: ArrayLike | None = None) -> Trajectory:
    """The motion of an arm released at q, with velocities qd or at rest, without motor efforts."""
    if not 0.0 < seconds < np.inf:
        raise ValueError(f"seconds is {seconds}; it must be positive and finite")
    rows = max(1, round(seconds / min(scene.control_dt, SAMPLE_INTERVAL)))
    start = np.zeros(len(scene.robot.joints)) if qd is None else qd
    return simulate(scene, q, start, np.linspace(0.0, seconds, rows + 1))


def write_csv(motion: Trajectory, path: Path) -> None:
    """Write t [s], states and energies [J], one row per recorded time."""
    arm = motion.scene.robot
    header = ["t", *arm.coordinates, *arm.rates, "kinetic", "potential", "work", "total"]
    columns = (motion.t, motion.q, motion.qd, motion.kinetic_energy, motion.potential_energy, motion.work)
    values = np.column_stack([*columns, motion.total]).tolist()
    write_rows([dict(zip(header, row, strict=True)) for row in values], header, path)
