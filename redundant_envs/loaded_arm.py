"""An arm with the masses and inertias that effects add."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from redundant_envs.effects.attached import Attachments
from redundant_envs.effects.hooks import Inertia, PointMass
from redundant_envs.robots.added_inertia import LARGEST_RATIO, Added, with_inertias
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import positive_numbers


def carried_masses(attached: Attachments) -> dict[str, list[str]]:
    """Masses of the arm to which effects add others: the parameters of those."""
    loads: dict[str, list[str]] = {}
    for a in attached.of(PointMass):
        loads.setdefault(f"m{a.hook.point.number + 1}", []).append(a.parameter(a.hook.mass))
    return loads


def check_inertias(arm: Arm, attached: Attachments, values: Mapping[str, Any]) -> None:
    """ValueError unless inertias are not negative, and not so large that rounding hides the arm.

    ``values`` are all parameters, numbers or arrays of lanes.
    """
    for a in attached.of(Inertia):
        name, slides = a.parameter(a.hook.inertia), arm.prismatic[a.hook.joints[0]]
        least = np.min([values[f"m{k + 1}"] for k in range(arm.num_masses)], axis=0)
        if not slides and arm.num_lengths:
            least = least * np.min([values[f"l{k + 1}"] for k in range(arm.num_lengths)], axis=0) ** 2
        found, most = np.broadcast_arrays(values[name], LARGEST_RATIO * least)
        wrong = np.flatnonzero(~((found >= 0.0) & (found <= most)))
        if wrong.size:
            inertia, allowed = found.flat[wrong[0]], most.flat[wrong[0]]
            raise ValueError(
                f"{name} is {inertia:g}; give 0 to {allowed:g} {'kg' if slides else 'kg m^2'}, a million "
                f"times the lightest mass{'' if slides else ' on the shortest link'}: rounding would "
                "hide the arm behind more"
            )


def added_inertias(attached: Attachments) -> Added:
    """Inertias that effects add to the arm: the joints of each, and the field with its number."""
    return tuple((a.hook.joints, a.parameter(a.hook.inertia)) for a in attached.of(Inertia))


def loaded_arm(arm: Arm, attached: Attachments, values: Mapping[str, float]) -> Arm:
    """The arm with the masses and inertias that effects add to its own, from the values of all parameters.

    ValueError if a mass is not positive then, or an inertia negative.
    """
    loads = carried_masses(attached)
    if loads:
        own = {f"m{k + 1}": mass for k, mass in enumerate(arm.masses)}
        masses = tuple(sum((values[n] for n in loads.get(m, ())), mass) for m, mass in own.items())
        arm = dataclasses.replace(
            arm, masses=positive_numbers("masses with what effects add", masses, arm.num_masses, "kg")
        )
    check_inertias(arm, attached, values)
    found = attached.of(Inertia)
    fields = {a.parameter(a.hook.inertia): values[a.parameter(a.hook.inertia)] for a in found}
    return with_inertias(arm, added_inertias(attached), fields) if fields else arm
