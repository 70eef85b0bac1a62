"""A scene as rigid links, linear forces at joints, and motors: what MJCF and URDF can express."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.effects import hooks
from redundant_envs.effects.bound_hooks import Attached, field_of
from redundant_envs.effects.effort_limits import EffortLimits
from redundant_envs.effects.hooks import CONTROL_DT, SPEED, Force, Friction, Inertia, PointMass
from redundant_envs.exports.files import Note, named, refuse_inexact
from redundant_envs.exports.linear_forces import Linear, linear_forces
from redundant_envs.exports.links import Array, RigidLink, coordinates_at, links_of
from redundant_envs.language.algebra import arguments_of
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.derived import coordinate_rates, joint_rates
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.base import hard_stops, spring_limits

Travel = dict[int, tuple[float, float]]  # ends of joints
MAX_CHANGED = 1e-10  # share by which the least inertias may change accelerations
POSES, SHARE_OF_POSES = 256, 0.9  # of an arm without bounds, and in how many of them this has to hold
THICKNESS = 0.03  # of drawn links, as a share of the reach
FREE = 1e9  # stands for no limit where a number is required: other end of a travel with one end, m or rad
REASONS: dict[type, str] = {
    hooks.Impact: "stops are only soft there, without restitution and rest",
    hooks.Gap: "contacts are only soft there, without restitution",
    Friction: "a joint that sticks creeps there",
    hooks.Impulse: "it makes velocities jump",
    hooks.Instant: "it acts within a control interval",
    hooks.Sensing: "sensors are no part of a model of the arm",
}
"""Why hooks have no exact counterpart."""


class Format(NamedTuple):
    """What a format can express, beside links, friction and limits of efforts."""

    name: str
    least: float  # mass [kg] and moment of inertia [kg m^2] that a body has at least
    springs: bool
    rotors: bool  # inertias that resist the rate of a joint
    generalized: bool  # motors that act on coordinates
    soft_ends: str  # how it has ends of travel


class Body(NamedTuple):
    """A link and the masses that it carries; positions are in metres from its joint."""

    link: RigidLink
    mass: float  # kg
    centre: Array
    inertia: float  # about the centre of mass, kg m^2


class Mechanism(NamedTuple):
    """Numbers of a scene by joint, from base to tip: N, N m, m, rad."""

    bodies: tuple[Body, ...]
    tip: tuple[int, Array]  # its link, and its place from the joint of that, m
    gravity: Array  # the vector in space, m/s^2
    damping: Array
    stiffness: Array
    rest: Array  # position at which the spring is relaxed
    armature: Array
    limits: Array | None  # of the motors
    coordinates: Array | None  # shares of the joints in the coordinates, if motors act on these
    travel: Travel  # soft ends
    friction: Mapping[int, float]  # regularised dry friction
    notes: tuple[Note, ...]  # what is only approximated, or left out

    @property
    def ends(self) -> list[Array]:
        """Where the bars that show the links end: at the next joint, and of the last link at the tip."""
        places = [body.link.place for body in self.bodies[1:]]
        return [*places, self.tip[1] if self.tip[0] == len(places) else np.zeros(2)]

    @property
    def reach(self) -> float:
        """Length of the stretched arm, with its sliders at 0, m."""
        return float(sum(np.hypot(*end) for end in (self.bodies[0].link.place, *self.ends))) or 1.0

    @property
    def thickness(self) -> float:
        """Of drawn links, m."""
        return THICKNESS * self.reach


def mechanism(scene: Scene, form: Format, approximate: bool) -> Mechanism:
    """The mechanism of a scene; ValueError if the arm is no chain of rigid links, or if something has no
    exact counterpart in the format and the result is not to be ``approximate``."""
    links = links_of(scene.robot)
    # Masses are those with the loads, as laws of effects take them.
    known = scene.parameters() | scene.loaded_robot.parameter_values() | {CONTROL_DT: scene.control_dt}
    forces: dict[Any, Linear] = linear_forces(scene, known)
    _, stiffness, constant = _sums(scene, forces)
    pushed = (stiffness == 0.0) & (constant != 0.0)  # a constant force in all, which no spring has
    reasons = [(a.key, _reason(scene, a, form, forces.get(a), pushed)) for a in scene.attached]
    unfit = {key: reason for key, reason in reversed(reasons) if reason}
    bodies, armature = _bodies(scene, links, known, unfit)
    damping, stiffness, constant = _sums(scene, {a: f for a, f in forces.items() if a.key not in unfit})
    rest = constant / np.where(stiffness == 0.0, 1.0, stiffness)
    notes = _notes(scene, form, unfit)
    refuse_inexact(notes, form.name, approximate)
    fields = [a for a in scene.attached.constant_fields if a.key not in unfit]
    gravity = [-float(a) + 0.0 for a in (*field_of(fields, Quantities(known, (), {})), 0.0)]
    limits = next((np.array(x.limits) for x in scene.effects if isinstance(x, EffortLimits)), None)
    at_joints = scene.actuation == "joint"
    tip = next((k, link.tip) for k, link in enumerate(links) if link.tip is not None)
    return Mechanism(
        tuple(b._replace(mass=max(b.mass, form.least), inertia=max(b.inertia, form.least)) for b in bodies),
        tip, np.array(gravity), damping, stiffness, rest, armature,
        limits if at_joints or form.generalized else None,
        None if at_joints else coordinate_rates(scene.robot), _soft_ends(scene, known, unfit),
        _dry_friction(scene, known), tuple(notes),
    )  # fmt: skip


def _reason(scene: Scene, a: Attached[Any], form: Format, force: Linear | None, pushed: Array) -> str:
    """Why a hook has no exact counterpart; "" if it has one. Its ``force`` is None if it is not linear."""
    hook = a.hook
    if type(hook) in REASONS:
        return REASONS[type(hook)]
    if hooks.states_of(hook):
        return "it has states of its own"
    if a in scene.attached.moving_fields:
        return "its field changes with time"
    if isinstance(hook, PointMass) and hook.mass[1:] not in a.effect.parameters():
        return "its mass changes"
    if isinstance(hook, hooks.Actuation) and not isinstance(a.effect, EffortLimits):
        return "only the limits of a motor's effort can be expressed"
    if isinstance(hook, Inertia) and not _of_link(hook, scene.robot):
        if len(hook.joints) > 1:
            return "it is neither the inertia of a link nor that of a rotor"
        return "" if form.rotors else f"{form.name} has no inertias of rotors"
    if not isinstance(hook, Force):
        return ""
    if force is None:
        return "its force is not linear in the position and the rate of a joint"
    if pushed[force.joint] and force.constant != 0.0:
        return "it is a constant force"
    return f"{form.name} has no springs" if force.stiffness != 0.0 and not form.springs else ""


def _of_link(hook: Inertia, arm: Arm) -> bool:
    """Whether an inertia belongs to the absolute angle of a link."""
    return sorted(hook.joints) == [k for k in range(max(hook.joints) + 1) if not arm.prismatic[k]]


def _bodies(
    scene: Scene, links: tuple[RigidLink, ...], known: Mapping[str, float], unfit: Mapping[str, str]
) -> tuple[list[Body], Array]:
    """Bodies of the links with all that they carry, and inertias of rotors at the joints."""
    masses = dict(enumerate(scene.robot.masses))
    for a in scene.attached.of(PointMass):
        if a.key not in unfit:
            masses[a.hook.point.number] += known[a.parameter(a.hook.mass)]
    of_links, armature = np.zeros((2, len(links)))
    for inertia in scene.attached.of(Inertia):
        if inertia.key not in unfit:
            joints, of_link = inertia.hook.joints, _of_link(inertia.hook, scene.robot)
            (of_links if of_link else armature)[max(joints)] += known[inertia.parameter(inertia.hook.inertia)]
    bodies = []
    for link, added_inertia in zip(links, of_links.tolist(), strict=True):
        carried = [(masses[p], offset) for p, offset in link.points.items()]
        mass = sum(m for m, _ in carried)
        centre = sum((m / mass * offset for m, offset in carried), np.zeros(2))
        spread = sum(m * float(np.sum((offset - centre) ** 2)) for m, offset in carried)
        bodies.append(Body(link, mass, centre, added_inertia + spread))
    return bodies, armature


def _sums(scene: Scene, forces: Mapping[Attached[Force], Linear]) -> Array:
    """Damping, stiffness and constant force of all joints, (3, joints)."""
    sums = np.zeros((3, len(scene.robot.joints)))
    for force in forces.values():
        sums[:, force.joint] += force.damping, force.stiffness, force.constant
    return sums


def _mobility(scene: Scene) -> float:
    """The largest mobility of a joint in all poses, by the bounds of the arm; without these in most poses."""
    arm, travel = scene.loaded_robot, scene.travel()
    numbers = scene.parameters() | arm.parameter_values()
    if (bounds := arm.mobility_bounds) is not None:
        return float(np.max(bounds(*(numbers[name] for name in arguments_of(bounds)))))
    low, high = np.full((2, len(arm.joints)), [[-np.pi], [np.pi]])
    for k in arm.sliders():
        low[k], high[k] = (numbers[name] for name in travel[k]) if k in travel else (0.1, 1.0)
    phi = np.random.default_rng(1).uniform(low, high, (POSES, len(low)))
    rates = joint_rates(arm)
    mobilities = rates @ np.linalg.pinv(arm.mass_matrix(coordinates_at(arm, phi))) @ rates.T
    return float(np.quantile(np.einsum("nkk -> nk", mobilities).max(axis=1), SHARE_OF_POSES))


def _notes(scene: Scene, form: Format, unfit: Mapping[str, str]) -> list[Note]:
    limits = (*spring_limits(scene), *hard_stops(scene))
    notes, limiting = [], {lower.rpartition(".")[0] for _, lower, _ in limits}
    for effect in scene.effects:
        if effect.key in unfit:
            written = "left out"
            if effect.key in limiting:
                written = form.soft_ends
            elif any(a.key == effect.key for a in _constant_frictions(scene)):
                written = "written with its level at rest"
            notes.append(Note(named(effect, scene), unfit[effect.key], written))
    if scene.actuation != "joint" and not form.generalized:
        notes.append(Note("actuation 'generalized'", f"{form.name} has motors at joints alone", "left out"))
    if (changed := form.least * _mobility(scene)) > MAX_CHANGED:
        reason = f"a body has {form.least:g} kg m^2 there, which changes accelerations by {changed:.1g}"
        notes.append(Note(f"the small masses of {scene.robot.kind}", reason, "written with it"))
    return notes


def _soft_ends(scene: Scene, known: Mapping[str, float], unfit: Mapping[str, str]) -> Travel:
    """Ends of travel of the effects that are only approximated; of several, the nearer ones."""
    travel: Travel = {}
    for joint, lower, upper in (*spring_limits(scene), *hard_stops(scene)):
        if lower.rpartition(".")[0] in unfit:  # the key of the effect
            low, high = travel.get(joint, (-FREE, FREE))
            low, high = max(low, known[lower]), min(high, known[upper])
            if (low, high) != (-FREE, FREE):
                travel[joint] = (low, high)
    return travel


def _constant_frictions(scene: Scene) -> list[Attached[Friction]]:
    """Dry friction whose limit takes no state: that of a brake, which closes some time, has no level."""
    states = scene.attached.states.keys()
    return [a for a in scene.attached.of(Friction) if states.isdisjoint(a.functions["limit"].names)]


def _dry_friction(scene: Scene, known: Mapping[str, float]) -> dict[int, float]:
    """Levels at rest of the dry friction in joints."""
    at_rest, friction = Quantities({**known, SPEED: 0.0}, (), {}), dict[int, float]()
    for a in _constant_frictions(scene):
        friction[a.hook.joint] = friction.get(a.hook.joint, 0.0) + float(a.functions["limit"](at_rest))
    return friction
