"""A scene as rigid links, linear forces at joints, and motors: what MJCF and URDF can express."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects.attached import Attached, field_of
from redundant_envs.effects.effort_limits import EffortLimits
from redundant_envs.effects.hooks import (
    CONTROL_DT,
    SPEED,
    Actuation,
    Effect,
    Field,
    Force,
    Friction,
    Gap,
    Impact,
    Impulse,
    Inertia,
    Instant,
    PointMass,
    Sensing,
    states_of,
)
from redundant_envs.exports.affine import Affine, NotAffine, affine
from redundant_envs.exports.document import Note, settled
from redundant_envs.exports.links import Link, links_of
from redundant_envs.quantities import Quantities
from redundant_envs.robots.mobility import joint_rates
from redundant_envs.scene import Scene

Array = NDArray[np.float64]
MOST_CHANGED = 1e-11
"""Largest share by which the least inertias of bodies may change accelerations."""
POSES = 256
THICKNESS = 0.03
"""Of drawn links, as a share of the reach."""
REASONS: dict[type, str] = {
    Impact: "stops are soft there, without restitution and rest",
    Gap: "contact is soft there, without restitution",
    Friction: "dry friction is regularised there: a joint that sticks creeps",
    Impulse: "impulses have no counterpart",
    Instant: "nothing changes within an interval there",
    Sensing: "sensors are no part of a model",
}
"""Why hooks have no exact counterpart."""


class Body(NamedTuple):
    """A link and the masses that it carries; positions are in metres from its joint."""

    link: Link
    mass: float  # kg
    centre: Array
    inertia: float  # about the centre of mass, kg m^2


class Mechanism(NamedTuple):
    """Numbers of a scene by joint, from base to tip: N, N m, m, rad."""

    bodies: tuple[Body, ...]
    tip: Array  # from the last joint, m
    gravity: Array  # the vector, m/s^2
    damping: Array
    stiffness: Array
    rest: Array  # position at which the spring is relaxed
    armature: Array
    limits: Array | None  # of the motors
    coordinates: Array | None  # rows of the joints' shares in them, if motors act on them
    travel: Mapping[int, tuple[float, float]]  # soft ends
    friction: Mapping[int, float]  # regularised dry friction
    notes: tuple[Note, ...]  # effects that are only approximated, or left out

    @property
    def reach(self) -> float:
        """Length of the stretched arm, with its sliders at 0, m."""
        places = [*(body.link.place for body in self.bodies), self.tip]
        return float(sum(np.hypot(*place) for place in places)) or 1.0

    @property
    def thickness(self) -> float:
        """Of drawn links, m."""
        return THICKNESS * self.reach


def _of_joints(scene: Scene) -> Array:
    """The coordinates as sums of joint positions, which are small whole numbers of these."""
    return np.asarray(np.linalg.inv(joint_rates(scene.robot)).round(12), dtype=np.float64)


def _nothing(scene: Scene, a: Attached[Any]) -> str:
    return ""


def mechanism(
    scene: Scene, form: str, approximate: bool, least: float,
    lacks: Callable[[Scene, Attached[Any]], str] = _nothing,
) -> Mechanism:  # fmt: skip
    """The mechanism of a scene.

    ``form`` is the name of the format in messages; ``least`` is the least mass [kg] and moment of inertia
    [kg m^2] that a body may have there; ``lacks`` says why it has no counterpart of a hook that
    rigid links and linear forces express, "" if it has one.

    Raises
    ------
    ValueError
        If the arm is no chain of rigid links, or effects have no exact counterpart and the result is not to
        be ``approximate``.
    """
    links = links_of(scene.robot)
    unfit = dict(reversed([*_unfit(scene, lacks)]))  # the first reason of each
    notes = _notes(scene, unfit, least)
    settled(notes, form, approximate)
    bodies, armature = _bodies(scene, links, unfit, least)
    fields = [a for a in scene.attached.constant_fields if a.key not in unfit]
    gravity = [-float(a) for a in field_of(fields, Quantities(_numbers(scene), (), {}))]
    limits = next((np.array(x.limits) for x in scene.effects if isinstance(x, EffortLimits)), None)
    return Mechanism(
        bodies,
        _tip(scene, links),
        np.array(gravity),
        *_springs(scene, unfit),
        armature,
        limits,
        None if scene.actuation == "joint" else _of_joints(scene),
        _soft_ends(scene, unfit),
        _dry_friction(scene, unfit),
        tuple(notes),
    )


def _notes(scene: Scene, unfit: Mapping[str, str], least: float) -> list[Note]:
    """What is not exact."""
    unlike = [effect for effect in scene.effects if effect.key in unfit]
    notes = [Note(type(e).__name__, unfit[e.key], _counterpart(scene, e)) for e in unlike]
    changed = least * _mobility(scene)
    if changed > MOST_CHANGED:
        reason = f"bodies have {least:g} kg m^2 there, which may change accelerations by {changed:.1g}"
        notes.append(Note(f"the light arm {scene.robot.kind}", reason, "written with it"))
    return notes


def _springs(scene: Scene, unfit: Mapping[str, str]) -> tuple[Array, Array, Array]:
    """Damping, stiffness and position at rest of all joints."""
    known, n = _numbers(scene), len(scene.robot.joints)
    damping, stiffness, constant = np.zeros(n), np.zeros(n), np.zeros(n)
    for a in scene.attached.of(Force):
        force, joint = _affine_force(scene, a, known), a.hook.joint
        if a.key not in unfit and force is not None and isinstance(joint, int):
            constant[joint] += force.constant
            stiffness[joint] -= force.slopes.get(f"phi{joint + 1}", 0.0)
            damping[joint] -= force.slopes.get(f"phid{joint + 1}", 0.0)
    return damping, stiffness, constant / np.where(stiffness == 0.0, 1.0, stiffness)


def _unfit(scene: Scene, lacks: Callable[[Scene, Attached[Any]], str]) -> Iterator[tuple[str, str]]:
    """Keys of effects without an exact counterpart, and why."""
    for a in scene.attached:
        reason = _reason(scene, a) or lacks(scene, a)
        if reason:
            yield a.key, reason


def _reason(scene: Scene, a: Attached[Any]) -> str:
    """Why a hook has no counterpart among linear forces on rigid links; "" if it has one."""
    hook, arm = a.hook, scene.robot
    if type(hook) in REASONS:
        return REASONS[type(hook)]
    if states_of(hook):
        return "states have no counterpart"
    if isinstance(hook, Field) and a not in scene.attached.constant_fields:
        return "gravity is constant there"
    if isinstance(hook, PointMass) and hook.mass not in {f".{name}" for name in a.effect.parameters()}:
        return "masses are constant there"
    if isinstance(hook, Actuation) and not isinstance(a.effect, EffortLimits):
        return "of a motor only the limits of its effort have a counterpart"
    if isinstance(hook, Inertia) and len(hook.joints) > 1 and not of_link(hook, arm.prismatic):
        return "it is neither the inertia of a link nor that of a rotor"
    if isinstance(hook, Force) and _affine_force(scene, a, _numbers(scene)) is None:
        return "forces are linear in a joint's position and rate there"
    return ""


def _numbers(scene: Scene) -> dict[str, float]:
    own = {**scene.loaded_robot.parameter_values(), **scene.parameters()}
    return {**own, CONTROL_DT: scene.control_dt}


def _affine_force(scene: Scene, a: Attached[Force], known: Mapping[str, float]) -> Affine | None:
    """The force of a hook if it is linear in the position and the rate of its joint alone."""
    joint = a.hook.joint
    if not isinstance(joint, int) or a.has_laws:
        return None
    names = f"phi{joint + 1}", f"phid{joint + 1}"
    x = Quantities({**known, **{name: Affine(0.0, {name: 1.0}) for name in names}}, (), {})
    try:
        force = affine(a.functions["function"](x))
    except (NotAffine, ValueError, TypeError, ZeroDivisionError):  # or it takes another quantity
        return None
    numbers = (force.constant, *force.slopes.values())
    at_rest = force.slopes.get(names[0], 0.0) == 0.0 and force.constant != 0.0
    return None if at_rest or not np.isfinite(numbers).all() else force


def stiffness_of(scene: Scene, a: Attached[Force]) -> float:
    """The stiffness of a linear force, N m/rad or N/m."""
    force = _affine_force(scene, a, _numbers(scene))
    return 0.0 if force is None else -force.slopes.get(f"phi{int(a.hook.joint) + 1}", 0.0)  # type: ignore[arg-type]


def of_link(hook: Inertia, prismatic: tuple[bool, ...]) -> bool:
    """Whether it belongs to the absolute angle of a link."""
    last = max(hook.joints)
    return hook.joints == tuple(k for k in range(last + 1) if not prismatic[k]) and not prismatic[last]


def _bodies(
    scene: Scene, links: tuple[Link, ...], unfit: Mapping[str, str], least: float
) -> tuple[tuple[Body, ...], Array]:
    """Bodies of the links with all that they carry, and inertias of rotors at the joints."""
    arm, known = scene.robot, _numbers(scene)
    masses = dict(enumerate(arm.masses))
    for a in scene.attached.of(PointMass):
        if a.key not in unfit:
            masses[a.hook.point.number] += known[a.parameter(a.hook.mass)]
    of_links, armature = np.zeros(len(links)), np.zeros(len(links))
    for inertia in scene.attached.of(Inertia):
        if inertia.key in unfit:
            continue
        hook, value = inertia.hook, known[inertia.parameter(inertia.hook.inertia)]
        if of_link(hook, arm.prismatic):
            of_links[max(hook.joints)] += value
        else:
            armature[hook.joints[0]] += value
    made = []
    for link, own in zip(links, of_links.tolist(), strict=True):
        carried = [(masses[p], offset) for p, offset in link.points.items()]
        mass = sum(m for m, _ in carried)
        centre = sum((m / mass * offset for m, offset in carried), np.zeros(2))
        spread = sum(m * float(np.sum((offset - centre) ** 2)) for m, offset in carried)
        made.append(Body(link, max(mass, least), centre, max(own + spread, least)))
    return tuple(made), armature


def _mobility(scene: Scene) -> float:
    """The largest mobility of a joint in poses at random, 1/kg or 1/(kg m^2)."""
    arm = scene.loaded_robot
    R, n = joint_rates(scene.robot), len(arm.joints)
    phi = np.random.default_rng(1).uniform(-np.pi, np.pi, (POSES, n))
    M = arm.mass_matrix(phi @ np.linalg.inv(R).T)
    return float(np.einsum("ki, nij, kj -> nk", R, np.linalg.inv(M), R).max())


def _tip(scene: Scene, links: tuple[Link, ...]) -> Array:
    """The tip, which is the last point mass, from the last joint."""
    arm = scene.robot
    q = np.stack([np.asarray(x) for x in _zero(arm)])
    place = sum((link.place for link in links), np.zeros(2))
    return np.asarray(arm.forward_kinematics(q) - place, dtype=np.float64)


def _zero(arm: Any) -> tuple[float, ...]:
    found = arm.coordinates_of_joints(*[0.0] * len(arm.joints))
    return found if isinstance(found, tuple) else (found,)


def _soft_ends(scene: Scene, unfit: Mapping[str, str]) -> dict[int, tuple[float, float]]:
    """Ends of travel of the effects that are only approximated."""
    known, travel = _numbers(scene), {}
    for effect in scene.effects:
        if effect.key in unfit:
            for joint, (low, high) in effect.travel(scene.robot).items():
                travel[joint] = (known[f"{effect.key}.{low}"], known[f"{effect.key}.{high}"])
    return travel


def _dry_friction(scene: Scene, unfit: Mapping[str, str]) -> dict[int, float]:
    """Levels at rest of the dry friction in joints."""
    at_rest, friction = Quantities({**_numbers(scene), SPEED: 0.0}, (), {}), dict[int, float]()
    for a in scene.attached.of(Friction):
        level = float(a.functions["limit"](at_rest))
        friction[a.hook.joint] = friction.get(a.hook.joint, 0.0) + level
    return friction


def _counterpart(scene: Scene, effect: Effect) -> str:
    """What an approximate model has of an effect."""
    if effect.travel(scene.robot):
        return "written as soft ends of travel"
    if any(isinstance(h, Friction) for h in effect.hooks(scene.robot)):
        return "written with its level at rest"
    return "left out"
