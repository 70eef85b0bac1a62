"""Numbers as NumPy arrays, elementwise over any shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from redundant_envs.algebra import Primitives, register_numbers
from redundant_envs.tracing.number import exp_of_rest


def exp(x: Any) -> Any:
    """Exponential function to one unit in the last place, of operations that round alike on every machine.

    NumPy's own depends on its version and on the processor. Reduction by multiples of ln 2 held in two parts
    (fdlibm, e_exp.c), and a polynomial.
    """
    inside = np.minimum(np.maximum(x, -746.0), 746.0)
    k = np.rint(inside * 1.4426950408889634)
    r = (inside - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    with np.errstate(invalid="ignore"):  # NaN stays NaN
        return np.ldexp(exp_of_rest(r), np.asarray(k).astype(np.int64))


def _where(condition: Any, a: Any, b: Any) -> Any:
    return np.where(condition, a, b)[()]


register_numbers(
    Primitives(np.sqrt, exp, np.floor, lambda x: (np.sin(x), np.cos(x)), _where, np.logical_not),
    np.ndarray, np.generic,
)  # fmt: skip
