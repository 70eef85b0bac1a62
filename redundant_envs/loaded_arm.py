"""An arm with the masses and inertias that effects add, and the names of the numbers of effects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from redundant_envs.effects import REGISTRY
from redundant_envs.effects.hooks import Effect, Inertia, PointMass, snake_case
from redundant_envs.robots.added_inertia import LARGEST_RATIO, Added, with_inertias
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import positive_numbers

OWN_KEYS = frozenset(
    snake_case(name) for name, kind in REGISTRY.items() if kind.__module__.startswith("redundant_envs.")
)
"""First parts of the parameter names of this package's effects; none is like a name of a field."""


def identifier(parameter: str) -> str:
    """A parameter name as the name of a field of a lane: "gravity.down[0]" -> gravity_down_0.

    Effects of users get two underscores, "my_spring.k" -> my_spring__k, which no generated name has.
    """
    dot = "_" if parameter.partition(".")[0] in OWN_KEYS else "__"
    return parameter.replace(".", dot).replace("[", dot).replace("]", "")


def _hooks(arm: Arm, effects: Sequence[Effect], kind: type) -> Iterator[tuple[Effect, Any]]:
    return ((e, h) for e in effects for h in e.hooks(arm) if isinstance(h, kind))


def carried_masses(arm: Arm, effects: Sequence[Effect]) -> dict[str, list[str]]:
    """Masses of the arm to which effects add others: the parameters of those."""
    loads: dict[str, list[str]] = {}
    for effect, hook in _hooks(arm, effects, PointMass):
        loads.setdefault(f"m{hook.point.number + 1}", []).append(f"{effect.key}{hook.mass}")
    return loads


def inertia_parameters(arm: Arm, effects: Sequence[Effect]) -> list[str]:
    """Parameters that are inertias of the arm."""
    return [f"{effect.key}{hook.inertia}" for effect, hook in _hooks(arm, effects, Inertia)]


def check_inertias(arm: Arm, effects: Sequence[Effect], values: Mapping[str, Any]) -> None:
    """ValueError unless inertias are not negative, and not so large that rounding hides the arm.

    ``values`` are all parameters, numbers or arrays of lanes.
    """
    for effect, hook in _hooks(arm, effects, Inertia):
        name, slides = f"{effect.key}{hook.inertia}", arm.prismatic[hook.joints[0]]
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


def added_inertias(arm: Arm, effects: Sequence[Effect]) -> Added:
    """Inertias that effects add to the arm: the joints of each, and the field with its number."""
    joints = (hook.joints for _, hook in _hooks(arm, effects, Inertia))
    return tuple(zip(joints, map(identifier, inertia_parameters(arm, effects)), strict=True))


def loaded_arm(arm: Arm, effects: Sequence[Effect], values: Mapping[str, float]) -> Arm:
    """The arm with the masses and inertias that effects add to its own, from the values of all parameters.

    Raises
    ------
    ValueError
        If a mass is not positive then, or an inertia negative.
    """
    loads = carried_masses(arm, effects)
    if loads:
        own = {f"m{k + 1}": mass for k, mass in enumerate(arm.masses)}
        masses = tuple(sum((values[n] for n in loads.get(m, ())), mass) for m, mass in own.items())
        arm = dataclasses.replace(
            arm, masses=positive_numbers("masses with what effects add", masses, arm.num_masses, "kg")
        )
    inertias = inertia_parameters(arm, effects)
    check_inertias(arm, effects, values)
    fields = {identifier(name): values[name] for name in inertias}
    return with_inertias(arm, added_inertias(arm, effects), fields) if inertias else arm
