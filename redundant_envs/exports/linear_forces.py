"""Forces of effects that are linear in the position and the rate of their joint: their derivatives show it.

Samples could not: a dead zone beyond all of them would be missed.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.compiler.tracing.graph import Graph, reached
from redundant_envs.compiler.tracing.number import Number, value_of
from redundant_envs.effects.bound_hooks import Attached
from redundant_envs.effects.hooks import Force, states_of
from redundant_envs.language.algebra import numbered
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.derived import coordinate_rates
from redundant_envs.scenes.scene import Scene

ARITHMETIC = {"load", "neg", "+", "-", "*", "/"}
"""Operations whose derivatives show a force everywhere. Beyond a comparison, a selection or a step it may be
another one, of which derivatives show nothing."""


class Linear(NamedTuple):
    """A force on a joint, constant - stiffness * position - damping * rate; N m and rad, or N and m."""

    joint: int
    constant: float
    stiffness: float
    damping: float


def linear_forces(scene: Scene, numbers: Mapping[str, float]) -> dict[Attached[Force], Linear]:
    """The forces of a scene that are linear in the position and the rate of their own joint alone."""
    n = len(scene.robot.joints)
    at_rest = {**numbers, **_motion(scene.robot, [0.0] * 2 * n)}
    forces = {}
    for a in scene.attached.of(Force):
        if a.has_laws or states_of(a.hook) or not isinstance(a.hook.joint, int):
            continue
        force = a.functions["function"]
        try:  # a force that takes another quantity, or is no function of such numbers, is not linear
            constant = float(force(Quantities(at_rest, (), {})))
            slopes = [_slope(scene.robot, force, numbers, k) for k in range(2 * n)]
        except (ValueError, TypeError, ZeroDivisionError):
            continue
        indices = a.hook.joint, n + a.hook.joint
        others = [slope for k, slope in enumerate(slopes) if k not in indices]
        if not any(others) and np.isfinite((constant, *slopes)).all():
            forces[a] = Linear(a.hook.joint, constant, *(-slopes[k] for k in indices))
    return forces


def _slope(arm: Arm, force: Any, numbers: Mapping[str, float], k: int) -> float:
    """The derivative of a force by one of the positions and rates of the joints; TypeError if it depends on
    the motion."""
    graph, count = Graph(whole=True), 2 * len(arm.joints)
    motion = [Dual(Number(graph, graph.load("motion", i)), float(i == k)) for i in range(count)]
    result = dual(force(Quantities({**numbers, **_motion(arm, motion)}, (), {})))
    if not ARITHMETIC.issuperset(operation.name for operation in reached([value_of(result.value)])):
        raise TypeError("it may have another law elsewhere")
    return float(result.slope)


def _motion(arm: Arm, motion: Sequence[Any]) -> dict[str, Any]:
    """Positions and rates of the joints by name, and the coordinates and their rates, which follow."""
    n = len(arm.joints)
    q: Any = arm.coordinates_of_joints(*motion[:n])
    values = dict(zip((*numbered("phi{}", n), *numbered("phid{}", n)), motion, strict=True))
    values |= zip(arm.coordinates, q if isinstance(q, tuple) else (q,), strict=True)
    for name, row in zip(arm.rates, coordinate_rates(arm).tolist(), strict=True):
        values[name] = sum(share * x for share, x in zip(row, motion[n:], strict=True))
    return values
