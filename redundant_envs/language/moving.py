"""Numbers that know whether they move, and where results computed with them have kinks.

A function that is run on them returns, beside its results, a value for each of its kinks that changes its
sign there: the difference of two numbers that are compared, the argument of ``abs``; the argument of
``floor`` passes a whole number at each kink.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from redundant_envs.language import algebra
from redundant_envs.language.algebra import Absent, Primitives, register_numbers


class Kink:
    """Where a result has a kink: ``value`` changes its sign there; with ``levels`` also wherever it passes a
    whole number."""

    __slots__ = ("levels", "value")

    def __init__(self, value: Any, levels: bool = False) -> None:
        self.value = 0.0 if isinstance(value, Absent) else value
        self.levels = levels

    def where(self, condition: Any, holds: bool) -> Kink:
        """The kink of a branch, which is absent where the other branch is taken."""
        branches = (self.value, 1.0) if holds else (1.0, self.value)
        return Kink(algebra.where(condition, *branches), self.levels)


Kinks = tuple[Kink, ...]
Operator = Callable[[Any, Any], Any]


def _union(*kinks: Kinks) -> Kinks:
    return tuple({id(k): k for some in kinks for k in some}.values())


def _arithmetic(of: Callable[[Any, Any], Any]) -> tuple[Operator, Operator]:
    """An operation on numbers, and the same with exchanged sides."""

    def operation(one: Any, other: Any) -> Moving:
        a, b = moving(one), moving(other)
        return Moving(of(a.value, b.value), a.moves or b.moves, _union(a.kinks, b.kinks))

    return operation, lambda self, other: operation(other, self)


def _comparison(of: Callable[[Any, Any], Any]) -> Operator:
    def compare(self: Moving, other: Any) -> MovingCondition:
        o = moving(other)
        kinks = (Kink(self.value - o.value),) if self.moves or o.moves else ()
        return MovingCondition(of(self.value, o.value), kinks)

    return compare


def _connection(of: Callable[[Any, Any], Any]) -> Operator:
    def connect(self: MovingCondition, other: Any) -> MovingCondition:
        o = _choice(other)
        return MovingCondition(of(self.condition, o.condition), _union(self.kinks, o.kinks))

    return connect


def _smooth(function: Callable[[Any], Any]) -> Callable[[Moving], Moving]:
    return lambda x: Moving(function(x.value), x.moves, x.kinks)


class Moving:
    """A number of any kind: whether it ``moves``, that is changes with the motion, and the kinks of it."""

    __slots__ = ("kinks", "moves", "value")
    __array_ufunc__ = None  # NumPy defers operations with these numbers to their class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: Any, moves: bool = False, kinks: Kinks = ()) -> None:
        self.value, self.moves, self.kinks = value, moves, kinks

    __add__, __radd__ = _arithmetic(operator.add)
    __sub__, __rsub__ = _arithmetic(operator.sub)
    __mul__, __rmul__ = _arithmetic(operator.mul)
    __truediv__, __rtruediv__ = _arithmetic(operator.truediv)
    __lt__, __le__ = _comparison(operator.lt), _comparison(operator.le)
    __gt__, __ge__ = _comparison(operator.gt), _comparison(operator.ge)
    __eq__, __ne__ = _comparison(operator.eq), _comparison(operator.ne)
    __neg__ = _smooth(operator.neg)

    def __pow__(self, exponent: int) -> Moving:
        return Moving(self.value**exponent, self.moves, self.kinks)

    def __abs__(self) -> Moving:
        new_kinks = (Kink(self.value),) if self.moves else ()
        return Moving(abs(self.value), self.moves, (*self.kinks, *new_kinks))


class MovingCondition:
    """A condition, and where it changes; kinks of the numbers compared do not matter elsewhere."""

    __slots__ = ("condition", "kinks")
    __array_ufunc__ = None

    def __init__(self, condition: Any, kinks: Kinks) -> None:
        self.condition, self.kinks = condition, kinks

    __and__ = __rand__ = _connection(operator.and_)
    __or__ = __ror__ = _connection(operator.or_)
    __xor__ = __rxor__ = _connection(operator.xor)


def moving(x: Any) -> Moving:
    """Such a number as it is, any other as one that does not move."""
    return x if isinstance(x, Moving) else Moving(x)


def _choice(x: Any) -> MovingCondition:
    return x if isinstance(x, MovingCondition) else MovingCondition(x, ())


def kinks_in(results: Any) -> Kinks:
    """Kinks of the results of a function."""
    return _union(*(moving(value).kinks for value in (results if isinstance(results, tuple) else (results,))))


def where(condition: Any, a: Any, b: Any) -> Any:
    choice = _choice(condition)
    if isinstance(a, MovingCondition | bool) and isinstance(b, MovingCondition | bool):
        one, other = _choice(a), _choice(b)
        chosen = algebra.where(choice.condition, one.condition, other.condition)
        return MovingCondition(chosen, _union(choice.kinks, one.kinks, other.kinks))
    a, b = moving(a), moving(b)
    everywhere = {id(k) for k in (*choice.kinks, *a.kinks)} & {id(k) for k in (*choice.kinks, *b.kinks)}
    branches = [
        k if id(k) in everywhere else k.where(choice.condition, holds)
        for some, holds in ((a.kinks, True), (b.kinks, False))
        for k in some
    ]
    return Moving(
        algebra.where(choice.condition, a.value, b.value),
        a.moves or b.moves or bool(choice.kinks),
        _union(choice.kinks, tuple(branches)),
    )


def _floor(x: Moving) -> Moving:
    return Moving(algebra.floor(x.value), x.moves, (Kink(x.value, levels=True),) if x.moves else ())


def _sincos(x: Moving) -> tuple[Moving, Moving]:
    s, c = algebra.sincos(x.value)
    return Moving(s, x.moves, x.kinks), Moving(c, x.moves, x.kinks)


register_numbers(
    Primitives(
        _smooth(algebra.sqrt), _smooth(algebra.exp), _smooth(algebra.log), _floor, _sincos, where,
        lambda x: MovingCondition(algebra.logical_not(x.condition), x.kinks),
        expm1=_smooth(algebra.expm1),
    ),
    Moving, MovingCondition, wrap=True,
)  # fmt: skip
