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
import operator
from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any, NamedTuple, NoReturn

from redundant_envs.language.philox import LOW
from redundant_envs.language.philox import philox as words_of

PRIMITIVES = ("sqrt", "exp", "expm1", "log", "minimum", "maximum", "where", "floor")
"""Names that functions of the dialect may call beside each other."""


def _no_words(*_: Any) -> NoReturn:
    raise TypeError("there are no draws of numbers of this kind")


class Primitives(NamedTuple):
    """Operations of a kind of numbers, beside arithmetic and comparisons; where kinds meet, the highest rank
    takes over."""

    sqrt: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    log: Callable[[Any], Any]
    floor: Callable[[Any], Any]
    sincos: Callable[[Any], Any]
    where: Callable[[Any, Any, Any], Any]
    logical_not: Callable[[Any], Any]
    philox: Callable[..., tuple[Any, ...]] = _no_words
    expm1: Callable[[Any], Any] | None = None  # by default exp(x) - 1, for numbers that are exact
    rank: int = 0


def _words_of_floats(counter: float, interval: float, *key: float) -> tuple[float, ...]:
    k0, k1, k2, k3 = map(int, key)
    return tuple(map(float, words_of([k0, k1], [int(counter), int(interval) & LOW, k2, k3])))


FLOATS = Primitives(
    math.sqrt,
    math.exp,
    math.log,
    lambda x: float(math.floor(x)),
    lambda x: (math.sin(x), math.cos(x)),
    lambda condition, a, b: a if condition else b,
    operator.not_,
    _words_of_floats,
    math.expm1,
)
_registered: dict[type, Primitives] = {float: FLOATS, int: FLOATS, bool: FLOATS}
_found: dict[type, Primitives] = {}
"""Operations of every class met so far, found by searching its bases."""


def _as_zero(compare: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda self, other: compare(0.0, other)


class Absent:
    """An absent number, such as the field of a scene without gravity.

    A sum with it is the other term, and a product with it is absent, too, so no operation is left. Where a
    number is needed, it is 0.
    """

    __slots__ = ()
    __array_ufunc__ = None  # NumPy defers operations with it to this class

    def _same(self, other: Any = None) -> Absent:
        return self

    def __add__(self, other: Any) -> Any:
        return other

    def __sub__(self, other: Any) -> Any:
        return -other

    def __float__(self) -> float:
        return 0.0

    __lt__, __le__ = _as_zero(operator.lt), _as_zero(operator.le)
    __gt__, __ge__ = _as_zero(operator.gt), _as_zero(operator.ge)
    __eq__, __ne__ = _as_zero(operator.eq), _as_zero(operator.ne)
    __hash__ = None  # type: ignore[assignment]
    __radd__ = __rsub__ = __add__
    __mul__ = __rmul__ = __truediv__ = __pow__ = __neg__ = __abs__ = _same


ABSENT = Absent()


def register_numbers(primitives: Primitives, *kinds: type, wrap: bool = False) -> None:
    """Let objects of some classes, and of classes derived from them, be numbers or conditions here.

    With ``wrap`` they hold numbers of any other kind, and conditions on those may choose between them.
    """
    _registered.update(dict.fromkeys(kinds, primitives._replace(rank=2 if wrap else 1)))
    _found.clear()


def _primitives_of(x: Any) -> Primitives:
    kind = type(x)
    if kind not in _found:
        _found[kind] = next((_registered[base] for base in kind.__mro__ if base in _registered), FLOATS)
    return _found[kind]


_rank = operator.attrgetter("rank")


def sqrt(x: Any) -> Any:
    """Square root."""
    return _primitives_of(x).sqrt(x)


def exp(x: Any) -> Any:
    """Exponential function."""
    return _primitives_of(x).exp(x)


def expm1(x: Any) -> Any:
    """exp(x) - 1, which keeps all its digits where x is small."""
    primitives = _primitives_of(x)
    return primitives.exp(x) - 1.0 if primitives.expm1 is None else primitives.expm1(x)


def log(x: Any) -> Any:
    """Natural logarithm; -inf at 0, and NaN below."""
    return _primitives_of(x).log(x)


def floor(x: Any) -> Any:
    """Largest whole number not above ``x``, as a float."""
    return _primitives_of(x).floor(x)


def where(condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition holds, else ``b``."""
    if condition is True:
        return a
    if condition is False:
        return b
    a, b = [0.0 if isinstance(x, Absent) else x for x in (a, b)]
    return max(map(_primitives_of, (condition, a, b)), key=_rank).where(condition, a, b)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of two numbers, ``a`` if they are equal or one is NaN.

    Put the quantity first and the constant second: then a NaN is passed on.
    """
    return where(a > b, b, a)


def maximum(a: Any, b: Any) -> Any:
    """The larger of two numbers, ``a`` if they are equal or one is NaN; see :func:`minimum`."""
    return where(a < b, b, a)


def sincos(x: Any) -> tuple[Any, Any]:
    """Sine and cosine. The dialect takes them as arguments; the code that computes quantities calls this."""
    return _primitives_of(x).sincos(x)  # type: ignore[no-any-return]


def philox(counter: float, interval: Any, *key: Any) -> tuple[Any, ...]:
    """Four random words of 32 bits as numbers, from whole numbers: a word of the counter that is known, the
    number of an interval, and the four words of a key. The code that computes draws calls this."""
    return max(map(_primitives_of, (interval, *key)), key=_rank).philox(counter, interval, *key)


def logical_not(condition: Any) -> Any:
    """Negation of a condition."""
    return _primitives_of(condition).logical_not(condition)


def cases(*choices: tuple[Any, Any], default: Any) -> Any:
    """The value of the first of some (condition, value) whose condition holds, else the default."""
    for condition, value in reversed(choices):
        default = where(condition, value, default)
    return default


def any_of(conditions: Iterable[Any]) -> Any:
    """Whether at least one of some conditions holds."""
    return functools.reduce(operator.or_, conditions, False)


def total(terms: Iterable[Any]) -> Any:
    """The sum of some terms, from left to right."""
    return functools.reduce(operator.add, terms)


def all_of(conditions: Iterable[Any]) -> Any:
    """Whether all of some conditions hold."""
    return functools.reduce(operator.and_, conditions, True)


def physics(
    function: Callable[..., Any] | None = None,
    *,
    gives: str | Iterable[str] = "",
    takes: str | Iterable[str] | None = None,
) -> Any:
    """Mark a function as text of the physics dialect.

    Parameters
    ----------
    gives : str or iterable of str
        Names of the quantities that the function returns, separated by blanks if in one text. A function
        without it is a helper, called by other marked functions only.
    takes : str or iterable of str, optional
        Names of its arguments, if it takes any number of them (``*values``).
    """

    def mark(f: Callable[..., Any]) -> Callable[..., Any]:
        for attribute, names in (("physics_gives", gives), ("physics_takes", takes)):
            if names is not None:
                setattr(f, attribute, tuple(names.split() if isinstance(names, str) else names))
        return f

    return mark if function is None else mark(function)


@functools.cache
def identity(quantity: str) -> Callable[..., Any]:
    """The marked function that takes a quantity, and returns it."""

    @physics(takes=quantity)
    def identity(value: Any) -> Any:
        return value

    return identity  # type: ignore[no-any-return]


def is_physics(function: Any) -> bool:
    """Whether a function is marked with :func:`physics`."""
    return callable(function) and hasattr(function, "physics_gives")


def gives_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the quantities a marked function returns."""
    return function.physics_gives  # type: ignore[attr-defined,no-any-return]


def arguments_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of a function's arguments, in order."""
    if hasattr(function, "physics_takes"):
        return function.physics_takes  # type: ignore[no-any-return]
    if type(function) is FunctionType:
        code = function.__code__
        if not (code.co_flags & MANY or function.__dict__.keys() & OTHERS):
            return code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    return tuple(inspect.signature(function).parameters)  # of whatever can be called, in 0.1 ms


OTHERS = {"__wrapped__", "__signature__"}
MANY = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS


def numbered(form: str, count: int) -> list[str]:
    """Names with the numbers from 1 on: ``numbered("phi{}", 2)`` is phi1, phi2."""
    return [form.format(k + 1) for k in range(count)]


def entries(letter: str, rows: int, columns: int) -> list[str]:
    """Names of the entries of a matrix, row by row: ``entries("J", 2, 2)`` is J11, J12, J21, J22."""
    return [f"{letter}{i + 1}{j + 1}" for i in range(rows) for j in range(columns)]


def name_of(function: Any) -> str:
    """Name of a function in messages."""
    return getattr(function, "__qualname__", repr(function))


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
