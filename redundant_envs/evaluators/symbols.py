"""The dialect on sympy expressions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from redundant_envs.evaluators.binding import run
from redundant_envs.evaluators.quantities import calls
from redundant_envs.extras import needs
from redundant_envs.robots.parameters import Arm


def primitives() -> dict[str, Any]:
    """The primitives on sympy expressions (needs sympy)."""
    with needs("verify"):
        import sympy as sp

    return {
        "sqrt": sp.sqrt,
        "exp": sp.exp,
        "minimum": lambda a, b: sp.Piecewise((b, a > b), (a, True)),
        "maximum": lambda a, b: sp.Piecewise((b, a < b), (a, True)),
        "where": lambda condition, a, b: sp.Piecewise((a, condition), (b, True)),
        "floor": sp.floor,
        "sincos": lambda x: (sp.sin(x), sp.cos(x)),
    }


def evaluate(arm: Arm, wanted: Iterable[str], values: dict[str, Any]) -> list[Any]:
    """Quantities of an arm as expressions in the given symbols."""
    names = list(wanted)
    order = calls(names, values, arm.functions, arm.sincos)
    result = run(order, dict(values), primitives())
    return [result[name] for name in names]
