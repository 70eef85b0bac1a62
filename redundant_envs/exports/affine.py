"""Numbers a + b1 x1 + b2 x2 + ... of unknowns: run on them, a function shows that it is linear, or fails.

Samples could not show that: a dead zone beyond all of them would be missed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from redundant_envs.algebra import Primitives, register_numbers


class NotAffine(ArithmeticError):
    """An operation whose result is not affine in the unknowns."""


def _refuse(*_: Any) -> NoReturn:
    raise NotAffine


class Affine:
    """A number that is affine in unknowns; the slopes are by the names of these."""

    __array_ufunc__ = None  # NumPy defers operations with it to this class

    def __init__(self, constant: float, slopes: Mapping[str, float]) -> None:
        self.constant, self.slopes = constant, slopes

    def __add__(self, other: Any) -> Affine:
        if not isinstance(other, Affine):
            return Affine(self.constant + other, self.slopes)
        names = {**self.slopes, **other.slopes}
        slopes = {name: self.slopes.get(name, 0.0) + other.slopes.get(name, 0.0) for name in names}
        return Affine(self.constant + other.constant, slopes)

    def __mul__(self, other: Any) -> Affine:
        if isinstance(other, Affine):
            raise NotAffine
        return Affine(self.constant * other, {name: slope * other for name, slope in self.slopes.items()})

    def __truediv__(self, other: Any) -> Affine:
        if isinstance(other, Affine):
            raise NotAffine
        return Affine(self.constant / other, {name: slope / other for name, slope in self.slopes.items()})

    def __neg__(self) -> Affine:
        return self * -1.0

    def __sub__(self, other: Any) -> Affine:
        return self + -other

    def __rsub__(self, other: Any) -> Affine:
        return -self + other

    __radd__, __rmul__ = __add__, __mul__
    __rtruediv__ = __pow__ = __rpow__ = __abs__ = __bool__ = _refuse
    __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __eq__ = __ne__ = _refuse  # type: ignore[assignment]
    __hash__ = None  # type: ignore[assignment]


_NONE = Primitives(_refuse, _refuse, _refuse, _refuse, _refuse, _refuse, _refuse, expm1=_refuse)
register_numbers(_NONE, Affine)


def affine(value: Any) -> Affine:
    """A number as one that is affine."""
    return value if isinstance(value, Affine) else Affine(float(value), {})
