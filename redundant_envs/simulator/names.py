"""Names that arms and tasks give to their quantities must not be those of numbers that lanes have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from redundant_envs.algebra import gives_of

OF_THE_FIELD = ("ax", "ay")
OF_REWARDS = ("ended", "paid")
"""Arguments that functions of a reward may take beside the fields of a lane."""


def names_of_arm(arm: Any) -> set[str]:
    """Quantities that an arm computes, except those that lanes keep under the same names."""
    more = (arm.held_dynamics, arm.slider_mobility, arm.column_norms, arm.mobility_bounds)
    functions = (*arm.functions, *(f for f in more if f is not None))
    kept = {name for f in arm.prepared for name in gives_of(f)}
    angles = {name for pair in arm.sincos.values() for name in pair}
    return ({name for f in functions for name in gives_of(f)} | angles) - kept


def names_of_task(task: Any, scene: Any) -> set[str]:
    """Quantities that a task gives, but for those that are kept in lanes under the same names."""
    functions = (*task.functions(scene), *task.begin_functions)
    angles = {name for pair in task.angles.values() for name in pair}
    kept = {*task.memory, *task.held_outputs}
    return ({name for f in functions for name in gives_of(f)} | angles) - kept


def check_names(who: str, names: Iterable[str], taken: Iterable[str]) -> None:
    """ValueError if a quantity would be mistaken for something else of its name."""
    clash = sorted(set(names) & set(taken))
    if clash:
        raise ValueError(
            f"{who} calls a quantity {clash[0]!r}, which is the name of a number that every lane has here; "
            "rename it, or it would be taken for that"
        )
