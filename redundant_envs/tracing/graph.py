"""Graphs of recorded operations, constants and loads of traced numbers, without duplicates."""

from __future__ import annotations

import contextlib
import gc
import struct
import sys
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NamedTuple

Value = Any
"""An :class:`Operation`, or a float that all lanes share."""

CONDITIONS = ("<", "<=", ">", ">=", "==", "!=", "and", "or", "xor", "not", "bit")
"""Operations whose result is a condition; "bit" asks for one bit of a number's representation."""
FREE = ("neg", "and", "result", "load")
"""Operations that become part of the instructions that use their results, or only name values."""
LATENCY = {"/": 24, "sqrt": 32, "select": 2}
"""Cycles until a result can be used, for vectors of 8; those of an addition if not listed."""
ADDITION = 4


class Origin(NamedTuple):
    """Origin of an operation.

    Attributes
    ----------
    owner : the part for which it is computed, such as the key of an effect; "" if unknown
    function, file, line : its position in the source
    """

    owner: str
    function: str
    file: str
    line: int


_located: ContextVar[bool] = ContextVar("located", default=False)
_owner: ContextVar[str] = ContextVar("owner", default="")
_TRANSPARENT = {str(Path(__file__).parents[1] / name) for name in ("algebra.py", "quantities.py")}
"""Files whose functions only pass on operations of others; so do those of this folder, except for sines."""


@contextlib.contextmanager
def located() -> Iterator[None]:
    """Within this context graphs keep the origins of their operations."""
    token = _located.set(True)
    try:
        yield
    finally:
        _located.reset(token)


@contextlib.contextmanager
def owned(owner: str) -> Iterator[None]:
    """Operations recorded within this context are attributed to an owner."""
    token = _owner.set(owner)
    try:
        yield
    finally:
        _owner.reset(token)


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
    return Origin(_owner.get(), frame.f_code.co_qualname, frame.f_code.co_filename, frame.f_lineno)


class Operation:
    """One operation of a graph; ``extra`` is its data beside the values of its arguments."""

    __slots__ = ("arguments", "extra", "name", "origin")

    def __init__(self, name: str, arguments: list[Value], extra: Any = None, origin: Any = None) -> None:
        self.name = name
        self.arguments = arguments
        self.extra = extra
        self.origin = origin
        """Its origin, a :class:`Origin`, if the graph keeps origins."""

    @property
    def operands(self) -> list[Operation]:
        """Those of its arguments that are operations."""
        return [a for a in self.arguments if isinstance(a, Operation)]

    @property
    def latency(self) -> int:
        return 0 if self.name in FREE else LATENCY.get(self.name, ADDITION)

    @property
    def is_condition(self) -> bool:
        return self.name in CONDITIONS


def bits_of(x: float) -> bytes:
    """The bit pattern of a float: 0.0 and -0.0 are two constants."""
    return struct.pack("<d", x)


def is_zero(value: Value, sign: float) -> bool:
    """Whether a value is the constant 0.0 or -0.0, of the same sign as ``sign``."""
    return isinstance(value, float) and bits_of(value) == bits_of(sign * 0.0)


class Graph:
    """Records operations; equal operations are recorded once.

    Parameters
    ----------
    whole : bool
        Whether sines and exponentials are operations, for an interpreter; otherwise they are recorded as the
        operations that compute them, so that every machine has the same bits.
    """

    def __init__(self, whole: bool = False) -> None:
        self.whole = whole
        self._known: dict[Any, Operation] = {}
        self._located = _located.get()
        self.results: dict[Any, Any] = {}
        """Results of functions with branches (:mod:`ways`), so that equal calls are traced once."""
        self.part = 0
        """Start a new part of the program. Equal products of different parts are recorded separately, so that
        joining in one part does not depend on the other parts."""

    def record(self, name: str, *arguments: Value, extra: Any = None) -> Operation:
        key = (
            name,
            extra,
            self.part if name == "*" else 0,
            *[a if type(a) is Operation else bits_of(a) for a in arguments],
        )
        found = self._known.get(key)
        if found is None:
            origin = _origin() if self._located else None
            found = self._known[key] = Operation(name, list(arguments), extra, origin)
        return found

    def load(self, space: str, k: int) -> Operation:
        """Number ``k`` of a space of memory."""
        return self.record("load", extra=(space, k))

    # x + (-0), x - 0, x * 1 and x / 1 are x, bit for bit.

    def add(self, a: Value, b: Value) -> Value:
        if is_zero(a, -1.0):
            return b
        return a if is_zero(b, -1.0) else self.record("+", a, b)

    def subtract(self, a: Value, b: Value) -> Value:
        return a if is_zero(b, 1.0) else self.record("-", a, b)

    def multiply(self, a: Value, b: Value) -> Value:
        if isinstance(a, float) and a == 1.0:
            return b
        return a if isinstance(b, float) and b == 1.0 else self.record("*", a, b)

    def divide(self, a: Value, b: Value) -> Value:
        return a if isinstance(b, float) and b == 1.0 else self.record("/", a, b)


def reached(results: Iterable[Value]) -> list[Operation]:
    """All operations that some results need, each after its operands."""
    order: list[Operation] = []
    seen: set[Operation] = set()
    for result in results:
        if type(result) is not Operation or result in seen:
            continue
        seen.add(result)
        stack = [(result, iter(result.arguments))]
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
    return order
