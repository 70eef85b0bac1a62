"""Whose the names are that arms and tasks may not give to quantities of theirs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from redundant_envs.algebra import gives_of
from redundant_envs.lane.memory import ENGINE, Field

OF_THE_FIELD = dict.fromkeys(("ax", "ay"), "minus the gravity vector, m/s^2")
OF_REWARDS = {
    "ended": "whether a fault ends the episode",
    "paid": "what the other terms of the reward have paid in the episode",
}
"""Arguments that functions of a reward may take beside the fields of a lane, and what they mean."""


def owners(fields: Iterable[Field], arguments: Mapping[str, str]) -> dict[str, str]:
    """Names that are taken, and whose they are: fields of lanes, and arguments that the engine gives."""
    found = {name: f"of {ENGINE}: {doc}" for name, doc in arguments.items()}
    return {**found, **{f.name: f.whose for f in fields}}


def names_of_arm(arm: Any) -> set[str]:
    """Quantities that an arm computes, except those that lanes keep under the same names."""
    more = (arm.held_dynamics, arm.slider_mobility, arm.column_norms, arm.mobility_bounds)
    functions = (*arm.functions, *(f for f in more if f is not None))
    kept = {name for f in arm.prepared for name in gives_of(f)}
    angles = {name for pair in arm.sincos.values() for name in pair}
    return ({name for f in functions for name in gives_of(f)} | angles) - kept


def names_of_task(task: Any, scene: Any) -> dict[str, list[str]]:
    """Names that a task gives, by the attributes that give them."""
    given = (name for f in task.functions(scene) for name in gives_of(f))
    begun = (name for f in task.begin_functions for name in gives_of(f))
    return {
        "functions": list(given),
        "begin_functions": list(begun),
        "angles": [name for pair in task.angles.values() for name in pair],
        "parameters": list(task.parameters()),
        "memory": list(task.memory),
    }
