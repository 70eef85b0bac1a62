"""Accuracy and cost of MuJoCo and SciPy on the same arm: the peers of a work-precision study.

Both take a scene's gravity, viscous friction and centring springs, and the efforts of the joints. An effect
without an exact counterpart in a peer is refused, never left out.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import CentringSpring, Gravity, ViscousFriction
from redundant_envs.exports.links import links_of
from redundant_envs.exports.xml import numbers
from redundant_envs.extras import MissingPackage, needs
from redundant_envs.scene import Scene

Array = NDArray[np.float64]
Limits = Mapping[int, tuple[float, float]]
States = tuple[ArrayLike, ArrayLike, ArrayLike]
"""q, qd and efforts of the joints, (n, 4) each."""

MUJOCO_INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4")
INERTIA = 1e-14
"""Moment of inertia of MuJoCo's bodies, kg m^2, which MuJoCo requires to be positive."""
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
    """MuJoCo's model of a scene: a chain of four bodies, and no stage that the scene does not need.

    Parameters
    ----------
    scene : Scene
    integrator : {"Euler", "implicitfast", "implicit", "RK4"}
        "Euler" is MuJoCo's own: semi-implicit, and implicit in the friction.
    dt : float
        Step [s].
    limits : mapping, optional
        Joint (0 to 3) -> ends of its travel, rad or m.
    solref : (float, float)
        Of the limits, in MuJoCo's direct form.

    Returns
    -------
    mujoco.MjModel
        In joint coordinates, B^T q. It has no motors: efforts are passed as ``qfrc_applied``, which costs
        less.
    """
    with needs("verify"):
        import mujoco
    if integrator not in MUJOCO_INTEGRATORS:
        raise ValueError(f"integrator is {integrator!r}; choose {', '.join(MUJOCO_INTEGRATORS)}")
    gravity, damping, stiffness, rest = _forces(scene, limits)
    chain = ""
    for link in links_of(scene.robot):
        ((point, (x, y)),) = link.points.items()  # of these arms each link carries one mass
        kind = (
            f'type="slide" axis="{numbers(*link.axis, 0.0)}"' if link.slides else 'type="hinge" axis="0 0 1"'
        )
        inertia = f'mass="{scene.robot.masses[point]!r}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"'
        chain += f'<body pos="{numbers(*link.place, 0.0)}"><joint {kind}/>'
        chain += f'<inertial pos="{numbers(x, y, 0.0)}" {inertia}/>'
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><compiler inertiafromgeom="false" boundinertia="0"/>'
        f"<worldbody>{chain}{'</body>' * 4}</worldbody></mujoco>"
    )
    model.opt.timestep = dt
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.gravity[:] = (*gravity, 0.0)
    model.dof_damping[:], model.jnt_stiffness[:], model.qpos_spring[:] = damping, stiffness, rest
    for joint, travel in (limits or {}).items():
        if joint not in range(4):
            raise ValueError(f"limits has the joint {joint!r}; joints are 0 to 3")
        model.jnt_limited[joint], model.jnt_range[joint], model.jnt_solref[joint] = True, travel, solref
    idle = [*IDLE, *(() if limits else ("CONSTRAINT", "LIMIT", "WARMSTART"))]
    idle += [name for name, of in (("DAMPER", damping), ("SPRING", stiffness)) if not of.any()]
    for name in idle:
        # A release without a stage cannot skip it.
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0))
    return model


@contextlib.contextmanager
def bare_mujoco() -> Iterator[Any]:
    """MuJoCo as in a C program: without the timers of its Python bindings, and without their log.

    The bindings install a clock that times the stages of every step: in MuJoCo 4.0, 28 readings in an
    Euler step and 98 in RK4, nearly half the cost of an arm this small. ``mujoco.set_mjcb_time(None)``
    does not remove it, so the pointer in the library is cleared here, and restored afterwards. A motion
    that diverges is not logged: it shows in the state.
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


def _states(start: States) -> Array:
    """The three tables as one array, (3, n, 4)."""
    shapes = [np.shape(x) for x in start]
    if len(set(shapes)) > 1 or len(shapes[0]) != 2 or shapes[0][1] != 4:
        raise ValueError(f"q, qd, efforts have shapes {shapes}; give (n, 4) for each, a row per state")
    return np.array(start, dtype=np.float64)


def _at_rest(start: States) -> Array:
    """The same without efforts."""
    states = _states(start)
    states[2] = 0.0
    return states


def _mujoco(scene: Scene, model: Any, start: Array, duration: float) -> tuple[Array, Array, Array]:
    """q and qd after the duration, (n, 4), and the CPU seconds of each state, (n,)."""
    steps = round(duration / model.opt.timestep)
    if steps < 1 or abs(steps * model.opt.timestep - duration) > 1e-9 * duration:
        raise ValueError(f"duration is {duration} s; give a whole number of steps of {model.opt.timestep} s")
    arm: Any = scene.robot
    B = arm.motor_map
    count = start.shape[1]
    ends, spent = np.empty((2, count, 4)), np.empty(count)
    with bare_mujoco() as mujoco:
        data = mujoco.MjData(model)
        for i, (q, qd, efforts) in enumerate(start.swapaxes(0, 1)):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q @ B, qd @ B, efforts
            before = time.process_time()
            mujoco.mj_step(model, data, steps)
            spent[i] = time.process_time() - before
            ends[:, i] = data.qpos, data.qvel
    q_end, qd_end = ends @ np.linalg.inv(B)
    return q_end, qd_end, spent


def mujoco_interval(
    scene: Scene, integrator: str, dt: float, start: States, duration: float,
    limits: Limits | None = None, solref: tuple[float, float] = ELASTIC,
) -> tuple[Array, Array]:  # fmt: skip
    """States (n, 4) after a ``duration`` [s] from ``start``, q, qd and constant joint efforts, by MuJoCo.

    The duration is a whole number of steps. A motion that diverges is returned huge or not finite. The
    other arguments are those of :func:`mujoco_model`.
    """
    model = mujoco_model(scene, integrator, dt, limits, solref)
    return _mujoco(scene, model, _states(start), duration)[:2]


def mujoco_cost(
    scene: Scene, integrator: str, dt: float, start: States, seconds: float = 1.0, repeats: int = 5,
    limits: Limits | None = None, solref: tuple[float, float] = ELASTIC,
) -> float:  # fmt: skip
    """Nanoseconds of one core per simulated second of one arm, by MuJoCo without its Python timers.

    From each state of ``start`` a motion of ``seconds`` without efforts, in one call; the best of ``repeats``
    for each state, and the mean over the states. Use a duration of many steps: a call itself costs about
    a microsecond.
    """
    model = mujoco_model(scene, integrator, dt, limits, solref)
    spent = [_mujoco(scene, model, _at_rest(start), seconds)[2] for _ in range(repeats)]
    return 1e9 * float(np.min(spent, axis=0).mean()) / seconds


def _scipy(
    scene: Scene, method: str, rtol: float, atol: float, start: Array, duration: float, together: bool
) -> tuple[Array, Array, NDArray[np.int64], float]:
    """q and qd after the duration, (n, 4), evaluations for each state, (n,), and the CPU seconds of all."""
    with needs("verify"):
        from scipy.integrate import solve_ivp
    (gx, gy), damping, stiffness, rest = _forces(scene)
    arm: Any = scene.robot
    B = arm.motor_map
    # The model's gravity points along -y: a field turned by an angle is an arm turned back by it.
    g, turn = math.hypot(gx, gy), np.where(arm.prismatic, 0.0, math.atan2(gx, -gy))

    def slope(t: float, y: Array, efforts: Array) -> Array:
        q, qd = y.reshape(2, -1, 4)
        joint = efforts - damping * (qd @ B) - stiffness * (q @ B - rest)
        return np.concatenate([qd, arm.forward_dynamics(q - turn, qd, joint @ B.T, g)]).ravel()

    count = start.shape[1]
    ends, evaluations = np.empty((2, count, 4)), np.empty(count, dtype=np.int64)
    before = time.process_time()
    for rows in [slice(None)] if together else [slice(i, i + 1) for i in range(count)]:
        state, efforts = start[:2, rows].ravel(), start[2, rows]
        motion = solve_ivp(slope, (0.0, duration), state, method, args=(efforts,), rtol=rtol, atol=atol)
        if not motion.success:
            raise ValueError(f"{method} with rtol {rtol}, atol {atol} stopped: {motion.message}")
        ends[:, rows], evaluations[rows] = motion.y[:, -1].reshape(2, -1, 4), motion.nfev
    return ends[0], ends[1], evaluations, time.process_time() - before


def scipy_interval(
    scene: Scene, method: str, rtol: float, atol: float, start: States, duration: float,
    together: bool = False,
) -> tuple[Array, Array, NDArray[np.int64]]:  # fmt: skip
    """States (n, 4) after a ``duration`` [s] from ``start``, q, qd and constant joint efforts, by SciPy.

    Also returns the evaluations of the right-hand side for each state, (n,). The method and its
    tolerances are those of ``solve_ivp``; atol is in rad, m, rad/s and m/s alike. ``together`` makes one
    system of all states: they share steps, SciPy controls a mean of their errors, and each costs far less
    Python. It is meant for explicit methods.
    """
    return _scipy(scene, method, rtol, atol, _states(start), duration, together)[:3]


def scipy_cost(
    scene: Scene, method: str, rtol: float, atol: float, start: States, seconds: float = 1.0,
    repeats: int = 5, together: bool = False,
) -> float:  # fmt: skip
    """Nanoseconds of one core per simulated second of one arm, by SciPy.

    Like :func:`mujoco_cost`, but the best of ``repeats`` is that of all states together.
    """
    states = _at_rest(start)
    spent = [_scipy(scene, method, rtol, atol, states, seconds, together)[3] for _ in range(repeats)]
    return 1e9 * min(spent) / (states.shape[1] * seconds)
