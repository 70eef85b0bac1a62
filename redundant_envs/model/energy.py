"""Energies of a scene from its states, effects included."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import arguments_of
from redundant_envs.effects.hooks import SIDE, Actuation, Effect, Field, Force, Point
from redundant_envs.robots.arm import Arm
from redundant_envs.scene import Scene

Array = NDArray[np.float64]


def kinetic_energy(scene: Scene, q: Array, qd: Array) -> Array:
    """Kinetic energy, (...), J."""
    return scene.loaded_robot.kinetic_energy(q, qd)


def potential_energy(scene: Scene, q: Array) -> Array:
    """Potential energy of the field and of all springs, (...), J."""
    arm = scene.loaded_robot
    values: dict[str, Any] = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
    values.update({name: q[..., k] for k, name in enumerate(arm.coordinates)})
    springs: list[Any] = []
    for effect in scene.effects:
        for hook in effect.hooks(arm):
            if isinstance(hook, Field):
                values["ax"], values["ay"] = hook_value(arm, effect, hook, hook.function, values)
            elif isinstance(hook, Force) and hook.potential is not None:
                springs.append(hook_value(arm, effect, hook, hook.potential, values))
    total = arm.evaluate(["U"], values)[0] + sum(springs)
    return np.broadcast_to(total, q.shape[:-1]).astype(np.float64)


def at_joints(
    arm: Arm, effect: Effect, hook: Force, function: Callable[..., Any], values: dict[str, Any]
) -> Array:
    """A force, or its conservative part, as forces at the joints, (..., joints), N m or N."""
    force = hook_value(arm, effect, hook, function, values)
    n, shape = len(arm.joints), np.shape(values[arm.coordinates[0]])
    if not isinstance(hook.joint, Point):
        alone = np.zeros((*shape, n))
        alone[..., hook.joint] = force
        return alone
    k = hook.joint.number + 1
    x, y = (arm.evaluate([f"{axis}{k}{j + 1}" for j in range(n)], values) for axis in "XY")
    at_coordinates = [a * force[0] + b * force[1] for a, b in zip(x, y, strict=True)]
    columns = np.stack([np.broadcast_to(f, shape) for f in at_coordinates], axis=-1)
    return np.asarray(columns @ np.linalg.inv(arm.motor_map).T, dtype=np.float64)


def initial_states(effect: Effect, arm: Arm) -> dict[str, float]:
    """Initial values of the states of an effect, by name; empty for an object that only has numbers."""
    hooks = effect.hooks(arm) if isinstance(effect, Effect) else ()
    return {s.name: s.initial for h in hooks if isinstance(h, Force | Actuation) for s in h.states}


def hook_value(
    arm: Arm, effect: Effect, hook: Field | Force, function: Callable[..., Any], values: dict[str, Any],
    side: float | None = None,
) -> Any:  # fmt: skip
    """Evaluate a function of a hook on known quantities of the arm and the effect's own numbers.

    States of the effect have their initial values. ``side`` chooses the law of a force that has several;
    with None the position chooses it.
    """
    own: dict[str, Any] = {**effect.parameters(), **initial_states(effect, arm)}
    known: dict[str, Any] = {}
    if isinstance(hook, Force) and hook.switch is not None:
        lower, upper = (own[name[1:]] for name in hook.switch)
        position = arm.evaluate([f"phi{cast(int, hook.joint) + 1}"], values)[0]
        known[SIDE] = np.where(position > upper, 1.0, np.where(position < lower, -1.0, 0.0))
        if side is not None:
            known[SIDE] = side
    sources = [hook.bind.get(a, a) for a in arguments_of(function)]
    arguments = [
        own[s[1:]] if s.startswith(".") else known[s] if s in known else arm.evaluate([s], values)[0]
        for s in sources
    ]
    return function(*arguments)
