"""Numbers as NumPy arrays, elementwise over any shape."""

from typing import Any

import numpy as np

from redundant_envs.compiler.tracing.number import exponential, exponential_less_one, logarithm
from redundant_envs.language.algebra import Primitives, register_numbers
from redundant_envs.language.philox import LOW
from redundant_envs.language.philox import philox as words_of


def exp(x: Any) -> Any:
    """Exponential function to one unit in the last place, of operations that round alike on every machine:
    NumPy's own depends on its version and on the processor."""
    with np.errstate(invalid="ignore"):  # NaN stays NaN
        return exponential(x, lambda a, b, c: a * b + c, _power_of_two)


def _power_of_two(n: Any) -> Any:
    return np.ldexp(1.0, np.asarray(n).astype(np.int64))


def expm1(x: Any) -> Any:
    """exp(x) - 1 to two units in the last place, likewise."""
    with np.errstate(invalid="ignore"):
        return exponential_less_one(x, lambda a, b, c: a * b + c, _power_of_two)


def log(x: Any) -> Any:
    """Natural logarithm to one unit in the last place, by the same operations as in compiled code."""
    with np.errstate(all="ignore"):  # what is not positive has no logarithm: -inf and NaN
        half, exponent = np.frexp(x)
        return logarithm(x, 2.0 * half, exponent - 1.0)


def philox(counter: float, interval: Any, *key: Any) -> tuple[Any, ...]:
    """Random words, see :func:`algebra.philox`."""
    k0, k1, k2, k3 = (np.asarray(x).astype(np.uint64) for x in key)
    with np.errstate(over="ignore"):
        words = words_of([k0, k1], [int(counter), np.asarray(interval).astype(np.uint64) & LOW, k2, k3])
    return tuple(w.astype(np.float64)[()] for w in words)


def _where(condition: Any, a: Any, b: Any) -> Any:
    return np.where(condition, a, b)[()]


register_numbers(
    Primitives(
        np.sqrt, exp, log, np.floor, lambda x: (np.sin(x), np.cos(x)), _where, np.logical_not, philox, expm1
    ),
    np.ndarray, np.generic,
)  # fmt: skip
