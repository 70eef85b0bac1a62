"""One motion of a scene, or a batch of them, at requested times."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.lane.direct import fields_of
from redundant_envs.model.batch import BatchSimulator, Event, Numerics, Status
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.model.parameters import numbers
from redundant_envs.scene import Scene, check_scene
from redundant_envs.values import shown

Array = NDArray[np.float64]
Efforts = None | ArrayLike | Callable[[float, Array, Array], ArrayLike]


@dataclass(frozen=True)
class Trajectory:
    """States and energies at the requested times.

    Attributes
    ----------
    t : (T,) s
    q, qd : (T, ..., joints)
    kinetic_energy, potential_energy : (T, ...) J
    work : (T, ...) J
        Work of the motors and of forces without a potential since the start:
        kinetic + potential - work stays constant.
    efforts : (T, ..., joints) N m or N
        Efforts of the motors, applied from t on: behind limits and all else that effects put between
        command and motor. Nothing is applied from the last time on: there a callable is not asked for a new
        interval, and its last command counts.
    scene : Scene
    events : list of Event
        Events at the stops of the sliders, in the order of time.
    """

    t: Array
    q: Array
    qd: Array
    kinetic_energy: Array
    potential_energy: Array
    work: Array
    efforts: Array
    scene: Scene = field(repr=False)
    events: list[Event] = field(default_factory=list)

    @property
    def tip(self) -> Array:
        """Position of the tip, (T, ..., 2), m."""
        return self.scene.robot.forward_kinematics(self.q)


def simulate(
    scene: Scene, q: ArrayLike, qd: ArrayLike, times: ArrayLike, efforts: Efforts = None
) -> Trajectory:
    """Simulate a scene from t = 0.

    Parameters
    ----------
    scene : Scene
    q, qd : (..., joints) arrays
        State at t = 0.
    times : (T,) array
        Increasing, not negative, s; hit exactly. Asking for more times does not change the motion.
    efforts : None, (joints,) array, or callable(t, q, qd)
        Joint efforts, N m and N; a callable is called once per control instant.

    Returns
    -------
    Trajectory
    """
    check_scene(scene)
    t = np.atleast_1d(numbers("times", times))
    if t.ndim != 1 or not np.isfinite(t).all() or (t < 0.0).any() or (np.diff(t) <= 0.0).any():
        raise ValueError(
            f"times must be finite, not negative and strictly increasing; they are {shown(times)}"
        )
    if t.size and not t[-1] < 2.0**53 * scene.control_dt:
        raise ValueError(f"times must be shorter than 2^53 control intervals of {scene.control_dt} s")
    joints = len(scene.robot.joints)
    starts = [numbers(name, given) for name, given in (("q", q), ("qd", qd))]
    for name, start in zip(("q", "qd"), starts, strict=True):
        if start.shape[-1:] != (joints,):
            raise ValueError(f"{name} has shape {start.shape}; the last axis must have {joints} entries")
    try:
        q0, qd0 = np.broadcast_arrays(*starts)
    except ValueError:
        raise ValueError(
            f"q and qd have shapes {np.shape(q)} and {np.shape(qd)}, which do not broadcast; give equal ones"
        ) from None
    if not (np.isfinite(q0).all() and np.isfinite(qd0).all()):
        raise ValueError("q or qd has non-finite entries; give finite numbers")
    shape, count = q0.shape[:-1], int(np.prod(q0.shape[:-1], dtype=int))
    if not count:
        raise ValueError(f"q and qd have the shape {q0.shape} together; give at least one motion")
    batch = BatchSimulator(scene, count, track_work=True)
    batch.set_state(q0.reshape(count, joints), qd0.reshape(count, joints))
    dt = scene.control_dt
    qs: list[Array] = []
    qds: list[Array] = []
    works: list[Array] = []
    applied: list[Array] = []
    events: list[Event] = []
    step, command = 0, np.zeros((count, joints))
    commanded = -1
    for time in t:
        target = _instant(float(time), dt)
        while step < target:
            command, commanded = _command(efforts, step, dt, batch, shape, command, commanded)
            _check(batch.advance(command), step * dt)
            events += batch.events(step * dt)
            step += 1
        rest = float(time) - step * dt
        if rest > 0.0:
            command, commanded = _command(efforts, step, dt, batch, shape, command, commanded)
            here = batch.save()
            _check(batch.advance_partly(command, rest), step * dt)
            state = batch.q, batch.qd, batch.work, motor_efforts(batch, command)
            if time == t[-1]:
                events += batch.events(step * dt)
            batch.restore(here)
        else:
            if time < t[-1] or not callable(efforts):
                command, commanded = _command(efforts, step, dt, batch, shape, command, commanded)
            state = batch.q, batch.qd, batch.work, motor_efforts(batch, command)
        if not (np.isfinite(state[0]).all() and np.isfinite(state[1]).all()):
            raise ValueError(
                f"the motion is not finite at t = {time:.6g} s; take a shorter control_dt, more "
                "substeps, or a softer scene"
            )
        for store, value in zip((qs, qds, works, applied), state, strict=True):
            store.append(value)
    q_all = np.array(qs).reshape(len(t), *shape, joints)
    qd_all = np.array(qds).reshape(len(t), *shape, joints)
    return Trajectory(
        t=t,
        q=q_all,
        qd=qd_all,
        kinetic_energy=kinetic_energy(scene, q_all, qd_all),
        potential_energy=potential_energy(scene, q_all),
        work=np.array(works).reshape(len(t), *shape),
        efforts=np.array(applied).reshape(len(t), *shape, joints),
        scene=scene,
        events=sorted(events, key=lambda e: e.time),
    )


def motor_efforts(batch: BatchSimulator, command: Array) -> Array:
    """Efforts of the motors under commands, (num_envs, joints) both, in the present states."""
    dynamics = batch.simulator.dynamics
    if not any(batch.scene.attached.chains.values()):
        return command
    states = dict(zip(dynamics.effect_states, batch.z.T, strict=True))
    numbers = {**fields_of(dynamics), **states, **dict(zip(dynamics.commands, command.T, strict=True))}
    found, _ = dynamics.efforts(dynamics.quantities([*batch.q.T, *batch.qd.T], numbers), "derivative")
    return np.stack([np.broadcast_to(effort, batch.num_envs) for effort in found], axis=1)


def _instant(time: float, dt: float) -> int:
    """The last control instant not after a time: the largest k whose ``k * dt``, rounded, is not above it."""
    k = int(time / dt)  # one off where the quotient is rounded over a whole number
    if k * dt > time:
        return k - 1
    return k + 1 if (k + 1) * dt <= time else k


def _check(status: Status, time: float) -> None:
    """Raise an error if an interval was not simulated to the end, or not to the scene's tolerance."""
    if (status.numerics & Numerics.EVENT_BUDGET).any():
        raise ValueError(
            "the motion has more than 256 impacts, or 65536 pieces, in the control interval at "
            f"t = {time:.6g} s; take a shorter control_dt, more substeps, or a smaller restitution"
        )
    if (status.numerics & Numerics.NO_STEP_FOUND).any():
        raise ValueError(
            f"dop853 finds no step that is accurate in the control interval at t = {time:.6g} s: the motion "
            "is too stiff or ends there; take softer springs or less friction, or efforts that keep it finite"
        )
    if (status.numerics & Numerics.TOLERANCE_NOT_REACHED).any():
        warnings.warn(
            f"the tolerance is not reached in the control interval at t = {time:.6g} s; take a shorter "
            "control_dt or a softer scene",
            stacklevel=3,
        )


def _command(
    efforts: Efforts, step: int, dt: float, batch: BatchSimulator, shape: tuple[int, ...],
    last: Array, commanded: int,
) -> tuple[Array, int]:  # fmt: skip
    """Efforts of the control interval ``step``; a callable is called once for each."""
    if commanded == step:
        return last, commanded
    joints = len(batch.scene.robot.joints)
    if efforts is None:
        return np.zeros((batch.num_envs, joints)), step
    value = efforts
    if callable(efforts):
        value = efforts(step * dt, batch.q.reshape(*shape, joints), batch.qd.reshape(*shape, joints))
    table = numbers("efforts", value)
    if table.shape != (joints,) and table.shape != (*shape, joints):
        raise ValueError(f"efforts has shape {table.shape}; give ({joints},) or {(*shape, joints)}")
    if not np.isfinite(table).all():
        raise ValueError(f"efforts has non-finite entries at t = {step * dt:.6g} s; give finite numbers")
    return np.broadcast_to(table, (*shape, joints)).reshape(batch.num_envs, joints), step
