"""Numbers as CasADi's scalar expressions (needs casadi)."""

from __future__ import annotations

from redundant_envs.language.algebra import Primitives, register_numbers
from redundant_envs.support.extras import needs

with needs("casadi"):
    import casadi as ca

register_numbers(
    Primitives(
        ca.sqrt, ca.exp, ca.log, ca.floor, lambda x: (ca.sin(x), ca.cos(x)), ca.if_else, ca.logic_not,
        expm1=ca.expm1,
    ),
    ca.SX,
)  # fmt: skip
