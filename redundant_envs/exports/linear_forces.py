"""Forces of effects that are linear in the position and the rate of their joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.effects.attached import Attached
from redundant_envs.effects.hooks import Force, states_of
from redundant_envs.exports.affine import Affine, NotAffine, affine
from redundant_envs.exports.links import shares_of_joints
from redundant_envs.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.scene import Scene


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
        force = None if a.has_laws or states_of(a.hook) else _evaluated(a, known)
        if force is None or not isinstance(a.hook.joint, int):
            continue
        slopes = {name: slope for name, slope in force.slopes.items() if slope != 0.0}
        position, rate = (slopes.pop(name, 0.0) for name in a.hook.motion)
        if not slopes and np.isfinite((force.constant, position, rate)).all():
            found[a] = Linear(a.hook.joint, force.constant, -position, -rate)
    return found


def _motion(arm: Arm) -> Iterator[tuple[str, Any]]:
    """Positions and rates of the joints as unknowns, and coordinates and their rates as sums of these."""
    n = len(arm.joints)
    phi, phid = ([Affine(0.0, {f"{name}{k + 1}": 1.0}) for k in range(n)] for name in ("phi", "phid"))
    yield from ((name, x) for row in (phi, phid) for x in row for name in x.slopes)
    try:
        found: Any = arm.coordinates_of_joints(*phi)
        yield from zip(arm.coordinates, found if isinstance(found, tuple) else (found,), strict=True)
    except (NotAffine, TypeError):  # they are no sums
        pass
    for name, row in zip(arm.rates, shares_of_joints(arm).tolist(), strict=True):
        yield name, sum((share * x for share, x in zip(row, phid, strict=True)), Affine(0.0, {}))


def _evaluated(a: Attached[Force], known: Mapping[str, Any]) -> Affine | None:
    """The force on these numbers; None if it is not affine, or takes another quantity."""
    try:
        return affine(a.functions["function"](Quantities(known, (), {})))
    except (NotAffine, ValueError, TypeError, ZeroDivisionError):
        return None
