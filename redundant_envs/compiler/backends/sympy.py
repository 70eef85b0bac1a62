"""Numbers as sympy expressions (needs sympy)."""

from redundant_envs.language.algebra import Primitives, register_numbers
from redundant_envs.support.extras import needs

with needs("verify"):
    import sympy as sp
    from sympy.logic.boolalg import Boolean


def _where(condition: sp.Basic, a: sp.Basic, b: sp.Basic) -> sp.Basic:
    return sp.Piecewise((a, condition), (b, True))


register_numbers(
    Primitives(sp.sqrt, sp.exp, sp.log, sp.floor, lambda x: (sp.sin(x), sp.cos(x)), _where, sp.Not),
    sp.Basic, Boolean,
)  # fmt: skip
