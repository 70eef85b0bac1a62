"""Numbers with a derivative: equations that are run on them give their own derivatives, to rounding."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from redundant_envs.language import algebra
from redundant_envs.language.algebra import Primitives, register_numbers


def is_zero(x: Any) -> bool:
    """Whether a number is the float 0.0: an absent derivative."""
    return isinstance(x, float) and x == 0.0


def _plus(a: Any, b: Any) -> Any:
    return b if is_zero(a) else a if is_zero(b) else a + b


def times(a: Any, b: Any) -> Any:
    """A product; if a factor is the float 0.0, nothing is computed."""
    return 0.0 if is_zero(a) or is_zero(b) else a * b


def _comparison(of: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda self, other: of(self.value, dual(other).value)


class Dual:
    """A number and its derivative: 0.0 if it has none, so that nothing is computed for it."""

    __slots__ = ("slope", "value")
    __array_ufunc__ = None  # NumPy defers operations with these numbers to their class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: Any, slope: Any = 0.0) -> None:
        self.value, self.slope = value, slope

    def __add__(self, other: Any) -> Dual:
        o = dual(other)
        return Dual(self.value + o.value, _plus(self.slope, o.slope))

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, times(-1.0, self.slope))

    def __sub__(self, other: Any) -> Dual:
        return self + (-dual(other))

    def __rsub__(self, other: Any) -> Dual:
        return dual(other) + (-self)

    def __mul__(self, other: Any) -> Dual:
        o = dual(other)
        slope = _plus(times(self.slope, o.value), times(self.value, o.slope))
        return Dual(self.value * o.value, slope)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        o = dual(other)
        ratio = self.value / o.value
        slope = _plus(self.slope, -times(ratio, o.slope))
        return Dual(ratio, 0.0 if is_zero(slope) else slope / o.value)

    def __rtruediv__(self, other: Any) -> Dual:
        return dual(other) / self

    def __pow__(self, exponent: int) -> Dual:
        factor = float(exponent)
        for _ in range(exponent - 1):
            factor = factor * self.value
        return Dual(self.value**exponent, times(factor, self.slope))

    def __abs__(self) -> Dual:
        return where(self < 0.0, -self, self)

    __lt__, __le__ = _comparison(operator.lt), _comparison(operator.le)
    __gt__, __ge__ = _comparison(operator.gt), _comparison(operator.ge)
    __eq__, __ne__ = _comparison(operator.eq), _comparison(operator.ne)


def dual(x: Any) -> Dual:
    """A number with a derivative unchanged, any other number with the derivative 0.0."""
    return x if isinstance(x, Dual) else Dual(x)


def where(condition: Any, a: Any, b: Any) -> Dual:
    a, b = dual(a), dual(b)
    return Dual(algebra.where(condition, a.value, b.value), algebra.where(condition, a.slope, b.slope))


def _derived(function: Callable[[Any], Any], slope: Callable[[Any, Any], Any]) -> Callable[[Dual], Dual]:
    """A function with the derivative ``slope(x, function(x))``."""

    def apply(x: Dual) -> Dual:
        y = function(x.value)
        return Dual(y, times(slope(x.value, y), x.slope))

    return apply


def _sincos(x: Dual) -> tuple[Dual, Dual]:
    s, c = algebra.sincos(x.value)
    return Dual(s, times(c, x.slope)), Dual(c, times(-s, x.slope))


register_numbers(
    Primitives(
        _derived(algebra.sqrt, lambda x, y: 0.5 / y), _derived(algebra.exp, lambda x, y: y),
        _derived(algebra.log, lambda x, y: 1.0 / x),
        _derived(algebra.floor, lambda x, y: 0.0), _sincos, where, algebra.logical_not,
        expm1=_derived(algebra.expm1, lambda x, y: 1.0 + y),
    ),
    Dual, wrap=True,
)  # fmt: skip
