"""Numbers as sympy expressions (needs sympy)."""

from __future__ import annotations

from redundant_envs.algebra import Primitives, register_numbers
from redundant_envs.extras import needs

with needs("verify"):
    import sympy as sp
    from sympy.logic.boolalg import Boolean

register_numbers(
    Primitives(
        sp.sqrt,
        sp.exp,
        sp.floor,
        lambda x: (sp.sin(x), sp.cos(x)),
        lambda condition, a, b: sp.Piecewise((a, condition), (b, True)),
        sp.Not,
    ),
    sp.Basic,
    Boolean,
)
