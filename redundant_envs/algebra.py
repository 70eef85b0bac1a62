"""The physics dialect: the mark, the primitives, and a few small functions every file may use.

A function marked with :func:`physics` is written in a small subset of Python: ``+ - * / **``,
``abs``, comparisons, names, numbers, tuples in and out, calls to other marked functions and to the
primitives below. It has no import, branch, loop, subscript or array. Sines and cosines come in as
arguments. The same text therefore runs on floats, NumPy arrays, sympy symbols, mpmath numbers
and, compiled, on the CPU; ``tests/test_dialect.py`` enforces the subset.

Functions are connected by name: an argument named ``s1`` receives the quantity ``s1``, and
``gives`` names what a function returns.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from typing import Any, overload

PRIMITIVES = ("sqrt", "exp", "minimum", "maximum", "where", "floor")
"""Names that each evaluator defines once; those below are the ones for plain floats."""


def sqrt(x: float) -> float:
    """Square root."""
    return math.sqrt(x)


def exp(x: float) -> float:
    """Exponential function."""
    return math.exp(x)


def floor(x: float) -> float:
    """Largest whole number not above ``x``, as a float."""
    return float(math.floor(x))


def where(condition: bool, a: float, b: float) -> float:
    """``a`` where the condition holds, else ``b``."""
    return a if condition else b


def minimum(a: float, b: float) -> float:
    """The smaller of two numbers, ``a`` if they are equal or one is NaN.

    Put the quantity first and the constant second: then a NaN comes through.
    """
    return b if a > b else a


def maximum(a: float, b: float) -> float:
    """The larger of two numbers, ``a`` if they are equal or one is NaN.

    Put the quantity first and the constant second: then a NaN comes through.
    """
    return b if a < b else a


@overload
def physics(function: Callable[..., Any]) -> Callable[..., Any]: ...
@overload
def physics(*, gives: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]: ...
def physics(function: Callable[..., Any] | None = None, *, gives: str = "") -> Any:
    """Mark a function as text of the physics dialect.

    Parameters
    ----------
    gives : str
        Names of the quantities that the function returns, separated by blanks. A function
        without it is a helper, called by other marked functions only.
    """

    def mark(f: Callable[..., Any]) -> Callable[..., Any]:
        f.physics_gives = tuple(gives.split())  # type: ignore[attr-defined]
        return f

    return mark if function is None else mark(function)


def is_physics(function: Any) -> bool:
    """Whether a function is marked with :func:`physics`."""
    return callable(function) and hasattr(function, "physics_gives")


def gives_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the quantities a marked function returns."""
    return function.physics_gives  # type: ignore[attr-defined,no-any-return]


@functools.cache
def arguments_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of a function's arguments, in order."""
    return tuple(inspect.signature(function).parameters)


@physics
def clamp(x, lower, upper):
    return minimum(maximum(x, lower), upper)


@physics
def squash(x, scale):
    """A smooth, strictly increasing map of all numbers onto (-1, 1), with slope 1/scale at 0."""
    return x / sqrt(scale * scale + x * x)


@physics
def saturation(x, scale):
    """From 0 at x = 0, with slope 1/scale, to 1 at infinity: for x of at least 0."""
    return x / (x + scale)


@physics
def tolerance(x, margin):
    """1 at x = 0, falling to 1/2 at x = margin and on like 1/x^2: the one shape of every reward."""
    square = margin * margin
    return square / (square + x * x)
