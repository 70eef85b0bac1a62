"""Derivatives of a control interval by the state before it and the efforts: x' = A x + B u near a motion.

Two ways that agree where both apply: the differentiable step (torch), which refuses hard stops, and central
differences of the compiled interval, in which a slider that rests on a stop stays there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import stops
from redundant_envs.effects import EffortLimits
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import needs

Array = NDArray[np.float64]
Jacobians = Callable[[Array, Array], tuple[Array, Array]]
"""Of states x = (q, qd), (..., 2 n), and efforts (..., n), N m and N: A (..., 2 n, 2 n), B (..., 2 n, n)."""
STEP = 1e-4  # of differences, rad, m, rad/s, m/s, N m, N: errors of 1e-8 and of the tolerance / STEP


def unlimited(scene: Scene) -> Scene:
    """The scene without its limits of efforts, for those who obey them anyway: a cut has no derivative."""
    rest = tuple(x for x in scene.effects if not isinstance(x, EffortLimits))
    if names := tuple(scene.states()):
        raise ValueError(
            f"scene has effects with the states {', '.join(names)}; give one whose state is q, qd"
        )
    return dataclasses.replace(scene, effects=rest)


def from_torch(scene: Scene) -> Jacobians:
    """Derivatives from :func:`redundant_envs.torch_step`, of two steps of rk4: stiff friction (0.2 N m s/rad
    at links of 0.25 m and 0.5 kg) makes errors of 1e-3. MissingPackage without torch; a ValueError
    for hard stops, dry friction, and effects with states."""
    model = dataclasses.replace(unlimited(scene), integrator="rk4", tolerance=None, substeps=2)
    with needs("train"):
        from redundant_envs.compiler.backends.torch import torch
        from redundant_envs.model.torch_step import torch_step
    step, n = torch_step(model), len(scene.robot.joints)

    def at(states: Array, efforts: Array) -> tuple[Array, Array]:
        x, u = (torch.tensor(values, requires_grad=True) for values in (states, efforts))
        after = torch.cat(step(x[..., :n], x[..., n:], u), -1)
        rows = torch.eye(2 * n, dtype=after.dtype).reshape(2 * n, *[1] * (x.ndim - 1), 2 * n)
        parts = torch.autograd.grad(after, (x, u), rows.expand(-1, *after.shape), is_grads_batched=True)
        a, b = (part.movedim(0, -2).numpy() for part in parts)
        return a, b

    return at


def from_differences(scene: Scene) -> Jacobians:
    """Derivatives by central differences of the compiled interval; at a stop to the inner side alone. A
    ValueError for effects with states."""
    model, n = unlimited(scene), len(scene.robot.joints)
    b, travel = scene.robot.motor_map, stops(scene)
    inverse, ways = np.linalg.inv(b), STEP * np.eye(3 * n)
    batches: dict[int, BatchSimulator] = {}

    def at(states: Array, efforts: Array) -> tuple[Array, Array]:
        points = np.concatenate([states, efforts], axis=-1).reshape(-1, 1, 3 * n)
        sides = np.stack([points + ways, points - ways])  # (2, points, 3 n, 3 n): side, point, way, entry
        joints = sides[..., :n] @ b
        for k, (low, high) in travel.items():
            joints[..., k] = np.clip(joints[..., k], low, high)
        sides[..., :n] = np.where(joints == sides[..., :n] @ b, sides[..., :n], joints @ inverse)
        q, qd, u = np.split(sides.reshape(-1, 3 * n), 3, axis=-1)
        batch = batches.setdefault(len(q), BatchSimulator(model, len(q)))
        batch.set_state(q, qd)
        batch.advance(u)
        after = np.concatenate([batch.q, batch.qd], axis=-1).reshape(2, -1, 3 * n, 2 * n)
        width = np.diagonal(sides[0] - sides[1], axis1=-2, axis2=-1)
        slope = ((after[0] - after[1]) / width[..., None]).swapaxes(-1, -2).reshape(*states.shape, 3 * n)
        return slope[..., : 2 * n], slope[..., 2 * n :]

    return at
