"""Quantities of a lane: of its arm, in metres at its tip, and how its rates answer impulses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from redundant_envs.language.algebra import ABSENT
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.memory import Lane


def quantities_of_arm(dynamics: Dynamics, lane: Lane, form: str = "{}", *more: Any) -> Quantities:
    """Quantities of the arm from the fields of a form, by its functions and ``more``."""
    arm, states = dynamics.arm, lane.get(dynamics.states, of=form)
    known = dict(zip(dynamics.states, states, strict=True))
    return Quantities(known, (*dynamics.arm_functions, *more), arm.sincos, numbers_of(dynamics, lane))


def tip_norms(dynamics: Dynamics, lane: Lane, form: str = "{}") -> list[Any]:
    """Metres at the tip per unit of each coordinate, from the fields of a form."""
    x = quantities_of_arm(dynamics, lane, form, dynamics.arm.column_norms)
    return x.each(f"n{k + 1}" for k in range(dynamics.count))


def numbers_of(dynamics: Dynamics, x: Any) -> dict[str, Any]:
    """The numbers that are constant in a step, from quantities or a lane."""
    return {name: x[name] for name in dynamics.parameters.numbers}


def response(dynamics: Dynamics, impulse: Sequence[Any], x: Quantities) -> list[Any]:
    """Change of the velocities by a generalized impulse, M^-1 n: accelerations at rest, without a field."""
    arm = dynamics.arm
    still = {q: x[q] for q in arm.coordinates} | dict.fromkeys(arm.rates, 0.0) | {"ax": ABSENT, "ay": ABSENT}
    still |= {f"Q{k + 1}": push for k, push in enumerate(impulse)}
    made = Quantities({**numbers_of(dynamics, x), **still}, dynamics.functions, arm.sincos)
    return made.each(f"qdd{k + 1}" for k in range(dynamics.count))
