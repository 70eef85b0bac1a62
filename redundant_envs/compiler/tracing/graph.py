"""Graphs of recorded operations, constants and loads of traced numbers, without duplicates."""

from __future__ import annotations

import contextlib
import functools
import gc
import itertools
import operator
import struct
import sys
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")
Value = Any
"""An :class:`Operation`, or a float that all lanes share."""

CONDITIONS = ("<", "<=", ">", ">=", "==", "!=", "and", "or", "xor", "not", "bit")
"""Operations whose result is a condition; "bit" asks for bit k of a number's representation."""
COMPARISONS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne,
}  # fmt: skip
FREE = ("neg", "bit", "and", "result", "load")
"""Operations that become part of the instructions that use their results, or only name values."""
LATENCY = {"/": 13, "sqrt": 32, "select": 2, "philox": 80}
"""Cycles until a result can be used, for vectors of 8; those of an addition if not listed."""
ADDITION = 4


class Origin(NamedTuple):
    """Origin of an operation."""

    owner: str  # the part for which it is computed, such as the key of an effect; "" if unknown
    function: str
    file: str
    line: int


_located: ContextVar[bool] = ContextVar("located", default=False)
_owner: ContextVar[str] = ContextVar("owner", default="")
_TRANSPARENT = {str(Path(__file__).parents[2] / f"language/{name}.py") for name in ("algebra", "quantities")}
"""Files whose functions only pass on operations of others; so do those of this folder, except for sines."""


@contextlib.contextmanager
def setting(variable: ContextVar[T], value: T) -> Iterator[None]:
    """Within this context a variable has a value."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


located = functools.partial(setting, _located, True)
"""Within this context graphs keep the origins of their operations."""
owned = functools.partial(setting, _owner)
"""Operations recorded within this context are attributed to an owner, its argument."""


MAX_OPERATIONS = 100_000
"""Operations that a program may record: those of the largest one take some 2 s to trace and half a minute to
compile, and a compiler takes more than twice as long for twice as many."""


class TooManyOperations(Exception):
    """A program has more than :data:`MAX_OPERATIONS` operations."""


_counter: ContextVar[Iterator[int] | None] = ContextVar("counter", default=None)


def counted() -> contextlib.AbstractContextManager[None]:
    """Within this context, and not beyond the outermost one, the operations of all graphs are counted."""
    return setting(_counter, _counter.get() or itertools.count(1))


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Suspend Python's garbage collection: a graph consists of many objects, none of which is garbage, and
    scanning them again and again would take a third of the time of recording it."""
    active = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if active:
            gc.enable()


def _origin() -> Origin:
    frame: Any = sys._getframe(2)
    here = str(Path(__file__).parent)
    while frame.f_back is not None:
        file, name = frame.f_code.co_filename, frame.f_code.co_name
        if name == "sincos" or not (file.startswith(here) or file in _TRANSPARENT):
            break
        frame = frame.f_back
    names = frame.f_code.co_qualname.split(".<locals>.")
    named = [name for name in names if not name.startswith("<")]  # none where a module has a lambda function
    return Origin(_owner.get(), (named or names)[-1], frame.f_code.co_filename, frame.f_lineno)


@dataclass(eq=False, repr=False, slots=True)
class Operation:
    """One operation of a graph."""

    name: str
    arguments: list[Value]
    extra: Any = None  # its data beside the values of its arguments
    origin: Origin | None = None

    def __repr__(self) -> str:
        return f"<{self.name}>"  # its operands are shared, and their texts would grow without end

    @property
    def operands(self) -> list[Operation]:
        """Those of its arguments that are operations."""
        return [a for a in self.arguments if isinstance(a, Operation)]

    @property
    def latency(self) -> int:
        return 0 if self.name in FREE else LATENCY.get(self.name, ADDITION)


bits_of = struct.Struct("<d").pack
"""The bit pattern of a float: 0.0 and -0.0 are two constants."""
LEFT = {("+", bits_of(-0.0)), ("*", bits_of(1.0))}
RIGHT = {*LEFT, ("-", bits_of(0.0)), ("/", bits_of(1.0))}
"""Constants on one side of an operation that leave the value on the other side as it is, bit for bit."""


class Graph:
    """Records operations, equal ones once. Sines and exponentials are operations if it is ``whole``, for an
    interpreter, and otherwise what computes them, so that every machine has the same bits."""

    def __init__(self, whole: bool = False) -> None:
        self.whole = whole
        self._known: dict[Any, Operation] = {}
        self._located = _located.get()
        self._counter = _counter.get()
        self.results: dict[Any, Any] = {}
        """Results of functions with branches (:mod:`ways`), so that equal calls are traced once."""
        self.part = 0
        """Part of the program. Equal products of different parts are recorded separately, so that joining in
        one part does not depend on the other parts; ``shared`` ones are never joined."""

    def record(self, name: str, *arguments: Value, extra: Any = None, shared: bool = False) -> Operation:
        operands = [a if type(a) is Operation else bits_of(a) for a in arguments]
        key = (name, extra, self.part if name == "*" and not shared else 0, *operands)
        operation = self._known.get(key)
        if operation is None:
            origin = _origin() if self._located else None
            operation = self._known[key] = Operation(name, list(arguments), extra, origin)
            if self._counter is not None and next(self._counter) > MAX_OPERATIONS:
                raise TooManyOperations(f"more than {MAX_OPERATIONS} operations")
        return operation

    def load(self, space: str, k: int) -> Operation:
        """Number ``k`` of a space of memory."""
        return self.record("load", extra=(space, k))

    def combine(self, name: str, a: Value, b: Value) -> Value:
        """Record an operation on two values, unless one of them leaves the other as it is."""
        if type(a) is float and (name, bits_of(a)) in LEFT:
            return b
        if type(b) is float and (name, bits_of(b)) in RIGHT:
            return a
        known = self._decided(name, a, b) if name in COMPARISONS and type(b) is float else None
        return self.record(name, a, b) if known is None else known

    def _decided(self, name: str, a: Value, b: float) -> Value | bool | None:
        """A comparison of one of two constants with a third, as the condition that chooses, or as known; of
        three constants, such as those of sides, too. None for any other value."""
        if type(a) is float:
            return bool(COMPARISONS[name](a, b))
        if type(a) is not Operation or a.name != "select" or type(a.arguments[1]) is not float:
            return None
        condition, first, second = a.arguments
        first, second = self._decided(name, first, b), self._decided(name, second, b)
        if second is None or first is second:
            return second
        if type(second) is bool:
            return condition if first else self.record("not", condition)
        if first:
            return self.record("or", condition, second)
        return self.record("and", self.record("not", condition), second)

    def choose(self, condition: Operation, a: Value, b: Value) -> Operation:
        """``a`` where a condition holds, else ``b``; if ``b`` is chosen, too, it does not ask for the same
        condition again: without that, a value between two limits is a minimum and a maximum."""
        if type(b) is Operation and b.name == "select":
            inner, *values = b.arguments
            negation = self._known.get(("not", None, 0, condition))  # if it was recorded
            known = {"or": condition, "and": negation}.get(inner.name)
            rest = [x for x in inner.arguments if x is not known] if known else []
            if len(rest) == 1:
                b = self.record("select", rest[0], *values)
        return self.record("select", condition, a, b)


def reached(results: Iterable[Value]) -> list[Operation]:
    """All operations that some results need, each after its operands."""
    order: list[Any] = []
    seen: set[Operation] = set()
    stack: list[tuple[Operation | None, Iterator[Value]]] = [(None, iter(results))]
    while stack:
        node, rest = stack[-1]
        for a in rest:
            if type(a) is Operation and a not in seen:
                seen.add(a)
                stack.append((a, iter(a.arguments)))
                break
        else:
            order.append(node)
            stack.pop()
    return order[:-1]
