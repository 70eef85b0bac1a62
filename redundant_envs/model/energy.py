"""Energies of a scene from its states, effects included."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects.bound_hooks import Attached, field_of
from redundant_envs.effects.hooks import CONTROL_DT, Force, Point
from redundant_envs.language.quantities import Quantities
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]


def kinetic_energy(scene: Scene, q: Array, qd: Array, z: Array | None = None) -> Array:
    """Kinetic energy, (...), J; masses may follow from the states of effects ``z``, (..., states)."""
    if z is None or not scene.attached.changing:
        return scene.loaded_robot.kinetic_energy(q, qd)
    x = scene_quantities(scene, q, qd, _masses(scene, z))
    return np.broadcast_to(x["T"], q.shape[:-1]).astype(np.float64)


def weight_energy(scene: Scene, q: Array, z: Array | None = None) -> Array:
    """Potential energy of the fields that follow from parameters alone, (...), J."""
    x = scene_quantities(scene, q, parameters=_masses(scene, z))
    return np.broadcast_to(x["U"], q.shape[:-1]).astype(np.float64)


def potential_energy(scene: Scene, q: Array, z: Array | None = None) -> Array:
    """The same, and the potential energy of all springs, (...), J."""
    x = scene_quantities(scene, q, parameters=_masses(scene, z))
    springs = [a.functions["potential"](x) for a in scene.attached if "potential" in a.functions]
    return np.broadcast_to(x["U"] + sum(springs), q.shape[:-1]).astype(np.float64)


def _masses(scene: Scene, z: Array | None) -> dict[str, Array]:
    """Masses of the arm that effects change, from states of effects, (..., states)."""
    if z is None or not scene.attached.changing:
        return {}
    states = {name: z[..., k] for k, name in enumerate(scene.attached.states)}
    return scene.attached.moving_masses(scene.parameters(), states)


def scene_quantities(
    scene: Scene, q: Array, qd: Array | None = None, parameters: Mapping[str, Any] = MappingProxyType({})
) -> Quantities:
    """Quantities that the functions of a scene's hooks take, in motions or at rest, with other ``parameters``
    if given, in the fields that have a potential. States of effects have their initial values, and no instant
    has passed; positions choose between the laws of a force."""
    arm = scene.loaded_robot
    still = dict.fromkeys((*arm.rates, "ax", "ay", *(a.passed for a in scene.attached.instants)), 0.0)
    effect_values = {name: value for name, value in scene.parameters().items() if "." in name}
    known: dict[str, Any] = arm.parameter_values() | still | effect_values | {**parameters}
    known |= scene.attached.states.initial | {CONTROL_DT: scene.control_dt}
    for names, numbers in ((arm.coordinates, q), (arm.rates, qd)):
        known |= {} if numbers is None else {name: numbers[..., k] for k, name in enumerate(names)}
    x = Quantities(known, arm.functions, arm.sincos)
    for a in scene.attached.of(Force):
        if a.law or "conservative" in a.functions:
            a.settle_law(x)
    if scene.attached.constant_fields:
        x["ax"], x["ay"] = field_of(scene.attached.constant_fields, x)
    return x


def at_joints(scene: Scene, a: Attached[Force], field: str, x: Quantities) -> Array:
    """A force, or its "conservative" part, as forces at the joints, (..., joints), N m or N."""
    arm, force = scene.robot, a.functions[field](x)
    n, shape = len(arm.joints), np.shape(x[arm.coordinates[0]])
    if not isinstance(a.hook.joint, Point):
        alone = np.zeros((*shape, n))
        alone[..., a.hook.joint] = force
        return alone
    along = (x.each(f"{axis}{a.hook.joint.number + 1}{j + 1}" for j in range(n)) for axis in "XY")
    at_coordinates = [dx * force[0] + dy * force[1] for dx, dy in zip(*along, strict=True)]
    columns = np.stack([np.broadcast_to(f, shape) for f in at_coordinates], axis=-1)
    return np.asarray(columns @ np.linalg.inv(arm.motor_map).T, dtype=np.float64)
