"""MuJoCo and SciPy on the same arm, with a scene's gravity, viscous friction and centring springs, and the
efforts of the joints. An effect without an exact counterpart in a peer is refused, never left out."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import CentringSpring, Gravity, ViscousFriction
from redundant_envs.exports.files import document
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import MissingPackage, needs
from redundant_envs.support.timing import seconds

Array = NDArray[np.float64]
Limits = Mapping[int, tuple[float, float]]
States = tuple[ArrayLike, ArrayLike, ArrayLike]
"""q, qd and efforts of the joints, (n, 4) each."""

MUJOCO_INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4")
SHOWN = "geom", "site", "light", "camera", "actuator"
"""Parts of the exporter's model that no motion of it needs."""
ELASTIC = (-1e5, 0.0)
"""MuJoCo's solref of a stop: minus its stiffness, 1/s^2, and minus its damping, 1/s."""
IDLE = ("CONTACT", "EQUALITY", "FRICTIONLOSS", "SENSOR", "MIDPHASE", "ACTUATION", "AUTORESET")
"""Stages of a MuJoCo step that no scene needs."""


def _forces(scene: Scene, limits: Limits | None = None) -> tuple[Array, Array, Array, Array]:
    """Gravity (2,), m/s^2; for each joint its damping, spring stiffness and rest position, (4,)."""
    if scene.actuation != "joint":
        raise ValueError(f"scene.actuation is {scene.actuation!r}; the peers take efforts of the joints")
    gravity, damping, stiffness, rest = np.zeros(2), np.zeros(4), np.zeros(4), np.zeros(4)
    slides = np.array(scene.robot.prismatic)
    for effect in scene.effects:
        if isinstance(effect, Gravity):
            gravity = np.multiply(effect.g, effect.down)
        elif isinstance(effect, ViscousFriction):
            damping = np.array(effect.coefficients)
        elif isinstance(effect, CentringSpring):
            stiffness[slides] = np.multiply(2.0, effect.stiffness)
            rest[slides] = np.add(effect.lower, effect.upper) / 2.0
        elif effect.key != "prismatic_stop" or not limits:
            raise ValueError(
                f"scene has the effect {type(effect).__name__}, which the peer cannot express; it knows "
                "Gravity, ViscousFriction and CentringSpring, and MuJoCo a PrismaticStop whose travel is "
                "given as limits"
            )
    return gravity, damping, stiffness, rest


def mujoco_model(
    scene: Scene, integrator: str, dt: float, limits: Limits | None = None,
    solref: tuple[float, float] = ELASTIC,
) -> Any:  # fmt: skip
    """MuJoCo's model of a scene in joint coordinates, B^T q: that of the exporter, without any part or stage
    that a motion does not need. Efforts are passed as ``qfrc_applied``, which costs less than motors.

    ``dt`` is the step [s], ``limits`` has ends of travel by joint (0 to 3), rad or m, and ``solref`` is
    MuJoCo's direct form of theirs. MuJoCo's own "Euler" is semi-implicit, and implicit in the friction.
    """
    with needs("verify"):
        import mujoco
    if integrator not in MUJOCO_INTEGRATORS:
        raise ValueError(f"integrator is {integrator!r}; choose {', '.join(MUJOCO_INTEGRATORS)}")
    _forces(scene, limits)
    free = dataclasses.replace(scene, effects=tuple(e for e in scene.effects if e.key != "prismatic_stop"))
    root = ET.fromstring(document(free, "mjcf", approximate=True).content)
    for parent in list(root.iter()):
        for child in [child for child in parent if child.tag in SHOWN]:
            parent.remove(child)
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    model.opt.timestep = dt
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    for joint, travel in (limits or {}).items():
        if joint not in range(4):
            raise ValueError(f"limits has the joint {joint!r}; joints are 0 to 3")
        model.jnt_limited[joint], model.jnt_range[joint], model.jnt_solref[joint] = True, travel, solref
    idle = [*IDLE, *(() if limits else ("CONSTRAINT", "LIMIT", "WARMSTART"))]
    forces = {"DAMPER": model.dof_damping, "SPRING": model.jnt_stiffness}
    idle += [name for name, numbers in forces.items() if not numbers.any()]
    for name in idle:
        # A release without a stage cannot skip it.
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0))
    return model


@contextlib.contextmanager
def bare_mujoco() -> Iterator[Any]:
    """MuJoCo as in a C program: without the timers of its Python bindings, and without their log.

    The clock of the bindings takes nearly half the cost of an arm this small, and
    ``mujoco.set_mjcb_time(None)`` does not remove it, so the pointer in the library is cleared here, and
    restored afterwards.
    """
    with needs("verify"):
        import mujoco
    folder = Path(mujoco.__file__).parent
    library = next((p for n in ("libmujoco.*", "mujoco.dll") for p in folder.glob(n)), None)
    if library is None:
        raise MissingPackage(f"{folder} has no libmujoco.*; reinstall mujoco")
    clock = ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mjcb_time")
    installed, warn = clock.value, mujoco.get_mju_user_warning()
    clock.value = None
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield mujoco
    finally:
        clock.value = installed
        mujoco.set_mju_user_warning(warn)


def states_of(start: States) -> Array:
    """The three tables as one array, (3, n, 4)."""
    shapes = [np.shape(x) for x in start]
    if len(set(shapes)) > 1 or len(shapes[0]) != 2 or shapes[0][1] != 4:
        raise ValueError(f"q, qd, efforts have shapes {shapes}; give (n, 4) for each, a row per state")
    return np.array(start, dtype=np.float64)


def mujoco_motion(scene: Scene, model: Any, start: States, duration: float) -> tuple[Array, Array, Array]:
    """States (n, 4) after a ``duration`` [s], a whole number of steps, from ``start``, q, qd and constant
    joint efforts, by a model of :func:`mujoco_model`, and the CPU seconds of each, (n,). A call costs a
    microsecond."""
    states, steps = states_of(start), round(duration / model.opt.timestep)
    if steps < 1 or abs(steps * model.opt.timestep - duration) > 1e-9 * duration:
        raise ValueError(f"duration is {duration} s; give a whole number of steps of {model.opt.timestep} s")
    arm: Any = scene.robot
    ends, spent = np.empty_like(states[:2]), np.empty(states.shape[1])
    with bare_mujoco() as mujoco:
        data = mujoco.MjData(model)
        for i, (q, qd, efforts) in enumerate(states.swapaxes(0, 1)):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q @ arm.motor_map, qd @ arm.motor_map, efforts
            spent[i] = seconds(mujoco.mj_step, model, data, steps)
            ends[:, i] = data.qpos, data.qvel
    q_end, qd_end = ends @ np.linalg.inv(arm.motor_map)
    return q_end, qd_end, spent


def scipy_motion(
    scene: Scene, method: str, rtol: float, start: States, duration: float, together: bool = False
) -> tuple[Array, Array, NDArray[np.int64]]:
    """States (n, 4) after a ``duration`` [s] from ``start``, q, qd and constant joint efforts, by a method of
    ``solve_ivp`` with equal tolerances, and evaluations of the right-hand side, (n,). ``together`` makes one
    system of all states: they share steps, SciPy controls a mean of their errors, and each costs far less
    Python."""
    with needs("verify"):
        from scipy.integrate import solve_ivp
    (gx, gy), damping, stiffness, rest = _forces(scene)
    arm, states = scene.robot, states_of(start)
    B: Any = arm.motor_map
    # The model's gravity points along -y: a field turned by an angle is an arm turned back by it.
    g, turn = math.hypot(gx, gy), np.where(arm.prismatic, 0.0, math.atan2(gx, -gy))

    def slope(t: float, y: Array, efforts: Array) -> Array:
        q, qd = y.reshape(2, -1, 4)
        joint = efforts - damping * (qd @ B) - stiffness * (q @ B - rest)
        return np.concatenate([qd, arm.forward_dynamics(q - turn, qd, joint @ B.T, g)]).ravel()  # type: ignore[attr-defined]

    count = states.shape[1]
    ends, evaluations = np.empty((2, count, 4)), np.empty(count, dtype=np.int64)
    for rows in [slice(None)] if together else [slice(i, i + 1) for i in range(count)]:
        state, efforts = states[:2, rows].ravel(), states[2, rows]
        motion = solve_ivp(slope, (0.0, duration), state, method, args=(efforts,), rtol=rtol, atol=rtol)
        if not motion.success:
            raise ValueError(f"{method} with rtol {rtol} stopped: {motion.message}")
        ends[:, rows], evaluations[rows] = motion.y[:, -1].reshape(2, -1, 4), motion.nfev
    return ends[0], ends[1], evaluations
