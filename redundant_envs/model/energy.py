"""Energies of a scene from its states, effects included."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import arguments_of
from redundant_envs.effects.hooks import Field, Force
from redundant_envs.evaluators.arrays import PRIMITIVES, evaluate
from redundant_envs.evaluators.binding import bind
from redundant_envs.scene import Scene

Array = NDArray[np.float64]


def kinetic_energy(scene: Scene, q: Array, qd: Array) -> Array:
    """Kinetic energy, (...), J."""
    return scene.robot.kinetic_energy(q, qd)  # type: ignore[attr-defined,no-any-return]


def potential_energy(scene: Scene, q: Array) -> Array:
    """Potential energy of the field and of all springs, (...), J."""
    arm = scene.robot
    values: dict[str, Any] = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
    values.update({name: q[..., k] for k, name in enumerate(arm.coordinates)})
    springs: list[Any] = []
    for effect in scene.effects:
        own = effect.parameters()
        for hook in effect.hooks(arm):
            if isinstance(hook, Force):
                function = hook.potential
            elif isinstance(hook, Field):
                function = hook.function
            else:
                continue
            if function is None:
                continue
            arguments = []
            for a in arguments_of(function):
                source = hook.bind.get(a, a)
                if source.startswith("."):
                    arguments.append(own[source[1:]])
                else:
                    arguments.append(evaluate(arm, [source], values)[0])
            result = bind(function, PRIMITIVES)(*arguments)
            if isinstance(hook, Field):
                values["ax"], values["ay"] = result
            else:
                springs.append(result)
    total = evaluate(arm, ["U"], values)[0] + sum(springs)
    return np.broadcast_to(total, q.shape[:-1]).astype(np.float64)
