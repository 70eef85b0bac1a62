"""The equations of an arm as sympy expressions, from the same source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from redundant_envs.algebra import entries, gives_of, numbered
from redundant_envs.extras import needs


def symbols_of(arm: Any) -> dict[str, Any]:
    """Expressions by the names that :meth:`redundant_envs.Arm.symbols` lists."""
    with needs("verify"):
        import sympy as sp
    import redundant_envs.backends.sympy  # noqa: F401 - lets expressions be numbers

    n = len(arm.coordinates)
    parameters = {name: sp.Symbol(name, positive=True) for name in arm.parameter_values()}
    of_motion = (arm.coordinates, arm.rates, numbered("Q{}", n))
    q, qd, forces = ({name: sp.Symbol(name, real=True) for name in names} for names in of_motion)
    field = {"ax": sp.Integer(0), "ay": sp.Symbol("g", real=True)}
    state = {**parameters, **q, **qd, **field}
    given = {name for f in arm.functions for name in gives_of(f)}

    def matrix(letter: str, rows: int) -> Any:
        names = entries(letter, rows, n)
        return sp.Matrix(rows, n, arm.evaluate(names, state)) if names[0] in given else None

    def column(letter: str, extra: Mapping[str, Any] | None = None) -> Any:
        return sp.Matrix(arm.evaluate(numbered(f"{letter}{{}}", n), {**state, **(extra or {})}))

    made = {
        "q": list(q.values()),
        "qd": list(qd.values()),
        "Q": list(forces.values()),
        "parameters": {**parameters, "g": field["ay"]},
        "M": matrix("M", n),
        "C": matrix("C", n),
        "J": matrix("J", 2),
        "h": column("h"),
        "G": column("G"),
        "qdd": column("qdd", forces),
        "tip": sp.Matrix(arm.evaluate(("tip_x", "tip_y"), state)),
        "Jdot_qd": sp.Matrix(arm.evaluate(("Jdqd1", "Jdqd2"), state)),
    }
    made |= {
        name: arm.evaluate((name,), state)[0] for name in ("T", "U", "Lz", "manipulability") if name in given
    }
    return {name: value for name, value in made.items() if value is not None}
