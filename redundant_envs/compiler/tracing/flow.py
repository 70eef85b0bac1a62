"""Loops, branches and calls of compiled functions, recorded as a tree: the part of a kernel around its lanes.

A kernel is written with a :class:`Kernel` ``p``: ``with p.each(count) as i``, ``with p.loop_while(...)``,
``with p.when(condition)``, ``p.call(function, ...)``. Its scalars are whole numbers, floats and truths.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

INT, FLOAT, TRUTH = "int", "float", "truth"
ELEMENTS = {"f64": FLOAT, "f32": FLOAT, "i64": INT, "u32": INT, "i8": INT}
"""Types of the elements of arrays, and the types as which they are loaded."""
LANES = 8
"""Lanes of a block, unless a target has narrower vectors: a power of two."""


class Output(NamedTuple):
    """A result that goes to an array."""

    array: str
    element: str  # its type
    column: int
    columns: int  # of a table with a row for each lane; 0 if lanes are contiguous
    value: Any


@dataclass
class LaneFunction:
    """Straight-line code for a block of lanes, from values of a graph; a location is a space and a number."""

    name: str
    spaces: tuple[str, ...]  # names of the memories of the lanes
    stores: list[tuple[str, int, Any]]  # values stored in them: space, number, value
    outputs: list[Output] = field(default_factory=list)  # values stored in arrays
    inputs: dict[str, tuple[str, int]] = field(default_factory=dict)
    """Element type and columns of tables with a row for each lane: loads from a space of that name read
    them."""
    known: Mapping[tuple[str, int], float] = field(default_factory=dict)  # numbers that locations hold
    asides: frozenset[tuple[str, int]] = frozenset()  # locations whose values change no bit of other results
    whole_blocks: bool = False  # whether it computes all lanes of a block also in a program for few lanes
    joins: bool = True  # whether products may join their sums: without, the bits are those of NumPy

    @property
    def results(self) -> list[Any]:
        """All values that the function computes for its results."""
        return [v for _, _, v in self.stores] + [o.value for o in self.outputs]

    @property
    def aside_results(self) -> list[int]:
        """Numbers of the results that go to ``asides``."""
        return [k for k, (*place, _) in enumerate(self.stores) if tuple(place) in self.asides]


def _operator(name: str, kind: str | None = None, swapped: bool = False) -> Callable[[Scalar, Any], Scalar]:
    """The operator of scalars that records an instruction."""

    def method(self: Scalar, other: Any) -> Scalar:
        a, b = (other, self) if swapped else (self, other)
        return self.kernel.record(name, a, b, kind=kind or self.kind)

    return method


@dataclass(eq=False)
class Scalar:
    """An instruction of a kernel, and its result. The kind is that of a number, or of the elements of memory
    whose address it is; an address + n is that of the element n elements on."""

    kernel: Kernel
    index: int  # of the instruction
    name: str
    arguments: tuple[Any, ...]
    kind: str
    extra: Any
    bodies: tuple[list[Scalar], ...]  # of a loop or a branch

    __add__, __radd__ = _operator("+"), _operator("+", swapped=True)
    __sub__, __rsub__ = _operator("-"), _operator("-", swapped=True)
    __mul__, __rmul__ = _operator("*"), _operator("*")
    __and__, __or__, __xor__ = _operator("and"), _operator("or"), _operator("xor")
    __rshift__, __lshift__ = _operator(">>"), _operator("<<")
    __lt__, __le__, __gt__ = _operator("<", TRUTH), _operator("<=", TRUTH), _operator(">", TRUTH)
    __ge__, __eq__, __ne__ = _operator(">=", TRUTH), _operator("==", TRUTH), _operator("!=", TRUTH)  # type: ignore[assignment]

    def __invert__(self) -> Scalar:
        return self.kernel.record("not", self, kind=self.kind)

    def __bool__(self) -> bool:
        raise TypeError("a scalar of a kernel is not known yet: write with p.when(condition)")


class Counter:
    """A whole number that changes."""

    def __init__(self, kernel: Kernel, initial: Any) -> None:
        self._kernel, self._place = kernel, kernel.space(1, "i64")
        self.value = initial

    @property
    def value(self) -> Scalar:
        return self._kernel.load(self._place)

    @value.setter
    def value(self, new: Any) -> None:
        self._kernel.store(self._place, 0, new)


class Kernel:
    """A function that other programs call: its arguments by name, and the tree of its instructions, for
    blocks of ``lanes`` in memory."""

    def __init__(self, name: str, arguments: Mapping[str, str], lanes: int = LANES) -> None:
        self.name, self.lanes = name, lanes
        self.arguments = dict(arguments)
        self.functions: dict[str, LaneFunction] = {}
        self.body: list[Scalar] = []
        self._open = [self.body]
        self._count = 0
        places = enumerate(arguments.items())
        self._given = {n: self.record("argument", kind=t, extra=k) for k, (n, t) in places}

    def __getitem__(self, name: str) -> Scalar:
        """An argument: a whole number, or the address of an array."""
        return self._given[name]

    def record(
        self, name: str, *arguments: Any, kind: str = INT, extra: Any = None,
        bodies: tuple[list[Scalar], ...] = (),
    ) -> Scalar:  # fmt: skip
        scalar = Scalar(self, self._count, name, arguments, kind, extra, bodies)
        self._open[-1].append(scalar)
        self._count += 1
        return scalar

    # ---- scalars ---------------------------------------------------------------------------------

    def variable(self, initial: Any) -> Counter:
        return Counter(self, initial)

    def load(self, array: Scalar, index: Any = 0) -> Scalar:
        return self.record("load", array, index, kind=ELEMENTS[array.kind], extra=array.kind)

    def store(self, array: Scalar, index: Any, value: Any) -> None:
        self.record("store", array, index, value, extra=array.kind)

    def select(self, condition: Scalar, a: Any, b: Any, kind: str = INT) -> Scalar:
        return self.record("select", condition, a, b, kind=kind)

    def number(self, value: Scalar) -> Scalar:
        """A whole number or a truth as a float."""
        return self.record("float", value, kind=FLOAT)

    def whole(self, value: Scalar) -> Scalar:
        """A float, or a truth, as a whole number."""
        return self.record("int", value, kind=INT)

    def space(self, count: int, element: str = "f64") -> Scalar:
        """Local memory of the kernel for some elements, at the beginning of a cache line."""
        return self.record("space", kind=element, extra=count)

    def mask(self, block: Scalar, row: int) -> Scalar:
        """Lanes of a block whose number in a row is not 0, as the bits of a whole number."""
        return self.record("mask", block, extra=row)

    # ---- loops, branches and calls ---------------------------------------------------------------

    @contextlib.contextmanager
    def _inside(self) -> Iterator[list[Scalar]]:
        body: list[Scalar] = []
        self._open.append(body)
        try:
            yield body
        finally:
            self._open.pop()

    @contextlib.contextmanager
    def each(self, count: Any, start: Any = 0) -> Iterator[Scalar]:
        """for i in range(start, count)"""
        i = self.variable(start)
        with self.loop_while(lambda: i.value < count):
            yield i.value
            i.value = i.value + 1

    @contextlib.contextmanager
    def each_set(self, mask: Scalar) -> Iterator[Scalar]:
        """for i in the indices of the bits that are set in a mask"""
        rest = self.variable(mask)
        with self.loop_while(lambda: rest.value != 0):
            yield self.record("lowest", rest.value)
            rest.value = rest.value & (rest.value - 1)

    @contextlib.contextmanager
    def loop_while(self, condition: Callable[[], Scalar]) -> Iterator[None]:
        """while condition(): ..."""
        with self._inside() as head:
            goes_on = condition()
        with self._inside() as body:
            yield
        self.record("while", goes_on, bodies=(head, body))

    @contextlib.contextmanager
    def when(self, condition: Scalar) -> Iterator[None]:
        """if condition: ..."""
        with self._inside() as body:
            yield
        self.record("when", condition, bodies=(body,))

    def leave(self) -> None:
        """Return from the kernel."""
        self.record("leave")

    def call(self, function: LaneFunction, **pointers: Scalar) -> None:
        """Run a function on a block; ``pointers`` are the addresses of its spaces and arrays for that block,
        and the strides of columns."""
        self.functions[function.name] = function
        self.record("call", *pointers.values(), extra=(function.name, tuple(pointers)))


@dataclass
class Program:
    """Kernels and the functions they call, for the first ``few`` lanes of each block if that is not 0."""

    kernels: list[Kernel]
    few: int = 0

    @property
    def width(self) -> int:
        """Lanes of a block in memory."""
        (lanes,) = {kernel.lanes for kernel in self.kernels}
        return lanes

    @property
    def lanes(self) -> int:
        """Lanes that it computes."""
        return self.few or self.width

    @property
    def functions(self) -> dict[str, LaneFunction]:
        return {name: f for k in self.kernels for name, f in k.functions.items()}
