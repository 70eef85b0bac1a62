"""Forces of effects that are linear in the position and the rate of their joint: their operations show it.

Samples could not: a dead zone beyond all of them would be missed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.compiler.tracing.graph import Graph, Operation, Value, reached
from redundant_envs.compiler.tracing.number import Number, value_of
from redundant_envs.effects.bound_hooks import Attached
from redundant_envs.effects.hooks import Force, states_of
from redundant_envs.exports.links import shares_of_joints
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene

Affine = dict[str, float]  # a constant, and slopes by the names of unknowns
CONSTANT = ""


class Linear(NamedTuple):
    """A force on a joint, constant - stiffness * position - damping * rate; N m and rad, or N and m."""

    joint: int
    constant: float
    stiffness: float
    damping: float


def linear_forces(scene: Scene, numbers: Mapping[str, float]) -> dict[Attached[Force], Linear]:
    """The forces of a scene that are linear in the position and the rate of their own joint alone."""
    known = {**numbers, **dict(_motion(scene.robot))}
    found = {}
    for a in scene.attached.of(Force):
        if a.has_laws or states_of(a.hook) or not isinstance(a.hook.joint, int):
            continue
        try:  # a force that takes another quantity, or is no function of traced numbers, is not linear
            force = _affine(value_of(a.functions["function"](Quantities(known, (), {}))))
        except (ValueError, TypeError, ZeroDivisionError):
            continue
        if force is None:
            continue
        constant = force.pop(CONSTANT, 0.0)
        slopes = {name: slope for name, slope in force.items() if slope != 0.0}
        position, rate = (slopes.pop(name, 0.0) for name in a.hook.motion)
        if not slopes and np.isfinite((constant, position, rate)).all():
            found[a] = Linear(a.hook.joint, constant, -position, -rate)
    return found


def _motion(arm: Arm) -> Iterator[tuple[str, Number]]:
    """Positions and rates of the joints as unknowns, and coordinates and their rates as what follows."""
    joints, graph = range(1, len(arm.joints) + 1), Graph(whole=True)
    phi, phid = ([Number(graph, graph.load(f"{name}{k}", 0)) for k in joints] for name in ("phi", "phid"))
    yield from zip((f"phi{k}" for k in joints), phi, strict=True)
    yield from zip((f"phid{k}" for k in joints), phid, strict=True)
    found: Any = arm.coordinates_of_joints(*phi)
    yield from zip(arm.coordinates, found if isinstance(found, tuple) else (found,), strict=True)
    for name, row in zip(arm.rates, shares_of_joints(arm).tolist(), strict=True):
        yield name, sum(share * x for share, x in zip(row, phid, strict=True))


def _affine(force: Value) -> Affine | None:
    """A traced value as an affine function of the unknowns; None if an operation has another result."""
    rows: dict[Operation, Affine] = {}

    def row(x: Value) -> Affine:
        return rows[x] if isinstance(x, Operation) else {CONSTANT: x}

    for node in reached([force]):
        given = [row(x) for x in node.arguments]
        constants = [x[CONSTANT] for x in given if x.keys() == {CONSTANT}]
        if node.name == "load":
            rows[node] = {node.extra[0]: 1.0}
        elif node.name == "neg":
            rows[node] = {name: -slope for name, slope in given[0].items()}
        elif node.name in ("+", "-"):
            a, b = given
            sign = 1.0 if node.name == "+" else -1.0
            rows[node] = {name: a.get(name, 0.0) + sign * b.get(name, 0.0) for name in {**a, **b}}
        elif node.name == "*" and constants:
            other = given[1] if given[0].keys() == {CONSTANT} else given[0]
            rows[node] = {name: slope * constants[0] for name, slope in other.items()}
        elif node.name == "/" and given[1].keys() == {CONSTANT}:
            rows[node] = {name: slope / given[1][CONSTANT] for name, slope in given[0].items()}
        else:
            return None
    return row(force)
