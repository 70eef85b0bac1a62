"""A long step as calls of one right-hand side.

Twelve copies of a right-hand side do not fit into a processor's instruction cache, so it becomes a
separate function, in two parts that do not wait for each other. The later part follows from the
velocities of a stage and is a long chain. The earlier part, the sines above all, follows from its
positions alone; those are known before the accelerations of the stage before are. So a call does the
later part of its stage together with the earlier part of the next one.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.graph import CONDITIONS, Graph, Operation, Value, bits_of, reached
from redundant_envs.compiler.tracing.number import Number, value_of
from redundant_envs.compiler.tracing.passes.simplify import join_products, specialise

RETURNED = 4
"""Results of a call that processors return in registers."""


@dataclass(eq=False)
class Subroutine:
    """A function of numbers that each stage calls."""

    function: Callable[..., Sequence[Any]]
    positions: int  # number of first arguments that do not depend on the results of the stage before
    results: int
    names: Sequence[str] = ()  # of the arguments, for listings
    asides: Sequence[int] = ()  # indices of results that change no bit of the others
    arguments: int = 0

    def __call__(self, *numbers: Any) -> Sequence[Any]:
        traced = next((n for n in numbers if isinstance(n, Number)), None)
        if traced is None:
            return self.function(*numbers)
        graph = traced.graph
        call = graph.record("stage", *(value_of(n) for n in numbers), extra=self)
        self.arguments = len(numbers)
        return [Number(graph, graph.record("result", call, extra=k)) for k in range(self.results)]

    def traced(self) -> tuple[list[Value], list[Operation]]:
        """Its results, and all operations that they need, on arguments "given"."""
        graph = Graph()
        arguments = [Number(graph, graph.load("given", k)) for k in range(self.arguments)]
        results = [value_of(r) for r in self.function(*arguments)]
        return results, reached(results)


class StageResults(NamedTuple):
    """Results of one of the functions that stages call."""

    returned: list[Value]  # in registers
    stores: list[tuple[str, int, Value]]  # in memory: "shared" for all calls, "after" for the next, "told"


class Stages:
    """The calls of a subroutine in a graph, and the functions that they call.

    Arguments that are the same memory location in every call are loaded by the functions; other equal
    arguments are ``kept`` in memory by the caller. Values that follow from both alone are computed by the
    first call for all ("shared"). Results of the earlier part for the later one are carried to the next call
    in memory ("before" to "after").
    """

    def __init__(
        self, calls: list[Operation], spaces: Sequence[str], known: Mapping[tuple[str, int], float]
    ) -> None:
        """``spaces`` are the memories that the functions may load from."""
        self.calls = calls
        self.subroutine: Subroutine = calls[0].extra
        if any(c.extra is not self.subroutine for c in calls):
            raise ValueError("a function calls two subroutines; give it one")
        for before, after in itertools.pairwise(calls):
            if before in reached(after.arguments[: self.subroutine.positions]):
                raise ValueError("positions given to a stage follow from its results in the stage before")
        columns = zip(*(c.arguments for c in calls), strict=True)
        same = [all(a is column[0] for a in column) for column in columns]
        self.passed = [k for k, constant in enumerate(same) if not constant]
        """Numbers of the arguments that a call passes."""
        alike = {k: x for k, x in enumerate(calls[0].arguments) if same[k] and isinstance(x, Operation)}
        candidates = [k for k, x in alike.items() if x.name != "load" or x.extra[0] not in spaces]
        graph = Graph()
        sources = list(calls[0].arguments)
        for k in self.passed:
            sources[k] = graph.load("given", k)
        for j, k in enumerate(candidates):
            sources[k] = graph.load("kept", j)
        results = [value_of(r) for r in self.subroutine.function(*(Number(graph, x) for x in sources))]
        join_products(results, self.subroutine.asides)
        results = specialise(results, known)
        needed = {n.extra[1] for n in reached(results) if n.name == "load" and n.extra[0] == "kept"}
        self.in_memory = {j: k for j, k in enumerate(candidates) if j in needed}
        """Positions in the caller's memory -> numbers of the arguments that it keeps there."""
        self.results, self.carried, carried_on, self.shared = self._split(results)
        # Equal results are passed once.
        keys = [bits_of(r) if isinstance(r, float) else r for r in self.results]  # 0.0 is not -0.0
        self.first = [keys.index(r) for r in keys]
        computed = [k for k, r in enumerate(self.results) if isinstance(r, Operation) and self.first[k] == k]
        self.returned, self.spilled = computed[:RETURNED], computed[RETURNED:]
        later = [self.results[k] for k in self.returned]
        spilled = _stores("told", [self.results[k] for k in self.spilled])
        self.parts = {
            "first": StageResults([], _stores("after", self.carried) + _stores("shared", self.shared)),
            "middle": StageResults(later, _stores("after", carried_on) + spilled),
            "last": StageResults(later, spilled),
        }

    def _split(self, results: list[Value]) -> tuple[list[Any], ...]:
        """The results as functions of velocities, carried and shared values; the carried values, first as
        functions of positions alone, then of these and shared values; and the shared values."""
        early: dict[Operation, bool] = {}
        varying: dict[Operation, bool] = {}
        for n in reached(results):
            varying[n] = _is_given(n) or any(varying[a] for a in n.operands)
            position = _is_given(n) and n.extra[1] < self.subroutine.positions
            early[n] = position if _is_given(n) else all(early[a] for a in n.operands)
        carried: list[Operation] = []
        shared: dict[Operation, int] = {}

        def load_shared(n: Operation, graph: Graph) -> Operation | None:
            if varying[n] or not _kept_in_memory(n):
                return None
            return graph.load("shared", shared.setdefault(n, len(shared)))

        def load(n: Operation, graph: Graph) -> Operation | None:
            if early[n] and (_is_given(n) or (varying[n] and _kept_in_memory(n))):
                carried.append(n)
                return graph.load("before", len(carried) - 1)
            return load_shared(n, graph)

        later = _replaced(results, load)
        return later, carried, _replaced(carried, load_shared), [*shared]

    def in_order(self, results: Iterable[Value]) -> list[Operation]:
        """Operations that some results of the caller need. Sums for the next call come before the present
        one, to fill its waiting times; sums for later calls would fill the registers."""
        nodes = reached(results)
        calls = {c: i for i, c in enumerate(self.calls)}
        # Calls that must be done before an operation, and calls before it is needed.
        ready: dict[Operation, int] = {}
        wanted: dict[Operation, int] = {}
        for n in nodes:
            ready[n] = calls[n] + 1 if n in calls else max((ready[a] for a in n.operands), default=0)
        for n in reversed(nodes):
            for k, a in enumerate(n.arguments):
                if isinstance(a, Operation):
                    call = wanted.get(n, len(calls))
                    if n in calls:
                        call = max(calls[n] - 1, 0) if k < self.subroutine.positions else calls[n]
                    wanted[a] = min(call, wanted.get(a, call))

        def place(n: Operation) -> tuple[int, bool]:
            return calls.get(n, max(ready[n], wanted.get(n, len(calls)) - 1)), n in calls

        return sorted(nodes, key=place)


def _stores(space: str, values: Iterable[Value]) -> list[tuple[str, int, Value]]:
    return [(space, k, value) for k, value in enumerate(values)]


def _is_given(node: Operation) -> bool:
    """Whether an operation loads an argument of a call."""
    return bool(node.name == "load" and node.extra[0] == "given")


def _kept_in_memory(node: Operation) -> bool:
    """Whether an operation is worth storing in memory."""
    return node.name not in (*CONDITIONS, "load", "neg")


def _replaced(nodes: Sequence[Value], instead: Callable[[Operation, Graph], Operation | None]) -> list[Value]:
    """Rebuild operations, with those that ``instead`` returns in place of some of their operands."""
    rebuilt: dict[Operation, Operation] = {}
    graph = Graph()

    def anew(n: Value) -> Value:
        return rebuilt[n] if isinstance(n, Operation) else n

    stack = [(n, False) for n in reversed(nodes) if isinstance(n, Operation)]
    while stack:
        n, complete = stack.pop()
        if complete:
            rebuilt[n] = Operation(n.name, [anew(a) for a in n.arguments], n.extra, n.origin)
        elif n not in rebuilt:
            other = instead(n, graph) or (n if n.name == "load" else None)
            if other is not None:
                rebuilt[n] = other
            else:
                stack.append((n, True))
                stack.extend((a, False) for a in reversed(n.operands))
    return [anew(n) for n in nodes]
