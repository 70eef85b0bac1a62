"""Ordinary ``if`` on traced numbers: a stretch of Python is run once for each way that its conditions can go.

The results of the ways are merged by selections, so a function with branches becomes straight-line code for
a vector of lanes. On floats the same function simply runs.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from redundant_envs.algebra import logical_not, where
from redundant_envs.tracing.graph import Graph, Operation, bits_of
from redundant_envs.tracing.number import Condition, Number, deciding, outlives

MOST_WAYS = 256
"""With more ways a stretch takes too long to trace, and its code is too long."""

F = TypeVar("F", bound=Callable[..., Any])


class Ways:
    """The answers to the conditions of one run: the given ones first, then true.

    Attributes
    ----------
    graph : of the conditions
    taken : conditions in the order in which they were met, and their answers
    """

    def __init__(self, graph: Graph, ahead: Sequence[bool]) -> None:
        self.graph, self.ahead = graph, ahead
        self.taken: list[tuple[Condition, bool]] = []
        self._known: dict[Operation, bool] = {}

    def answer(self, condition: Condition) -> bool:
        """Whether a condition holds in this run; the same one always has the same answer."""
        if condition.graph is not self.graph:
            outlives()
        node, direct = condition.value, True
        while node.name == "not":
            node, direct = node.arguments[0], not direct
        if node not in self._known:
            k = len(self.taken)
            self._known[node] = self.ahead[k] if k < len(self.ahead) else True
            self.taken.append((Condition(condition.graph, node), self._known[node]))
        return self._known[node] == direct

    @contextlib.contextmanager
    def taken_here(self) -> Iterator[None]:
        """Within this context conditions are answered."""
        token = deciding.set(self.answer)
        try:
            yield
        finally:
            deciding.reset(token)


def every_way(
    graph: Graph, run: Callable[[Ways], Any], merge: Callable[[Condition, Any, Any], Any], what: str
) -> Any:
    """Run a stretch once for each way, and merge the results.

    Parameters
    ----------
    graph : Graph
        Records what the stretch does.
    run : callable
        The stretch; it must do the same as long as its conditions have the same answers.
    merge : callable
        Takes a condition, the result where it holds, and the result elsewhere.
    what : str
        Names the stretch in messages.
    """
    count = 0

    def way(ahead: list[bool]) -> Any:
        nonlocal count
        count += 1
        if count > MOST_WAYS:
            raise ValueError(
                f"{what} has more than {MOST_WAYS} ways; let a function marked with @branches decide a part of "
                "it, whose ways are merged where it returns"
            )
        ways = Ways(graph, ahead)
        with ways.taken_here():
            result = run(ways)
        for k in reversed(range(len(ahead), len(ways.taken))):
            other = way([*(answer for _, answer in ways.taken[:k]), False])
            result = merge(ways.taken[k][0], result, other)
        return result

    return way([])


def branches(function: F) -> F:
    """Mark a function of numbers that may use ``if``, ``and``, ``or`` and ``not`` on conditions.

    On traced numbers all its ways are run and what it returns is merged: numbers, conditions, and tuples or
    named tuples of these. It has no effect beside its result, and equal calls are traced once.
    """

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        graph, key = _key(arguments)
        if graph is None:
            return function(*arguments)
        known = (function, key)
        if known not in graph.results:
            result = every_way(graph, lambda _: function(*arguments), merged, function.__qualname__)
            graph.results[known] = (result, arguments)  # arguments are kept: keys hold identities
        return graph.results[known][0]

    return call  # type: ignore[return-value]


def _key(x: Any) -> tuple[Graph | None, Any]:
    """The graph of the numbers in an argument, and a key that is equal for equal arguments."""
    if isinstance(x, Number | Condition):
        return x.graph, x.value if isinstance(x.value, Operation) else bits_of(x.value)
    if isinstance(x, tuple | list):
        parts = [_key(part) for part in x]
        graph = next((g for g, _ in parts if g is not None), None)
        return graph, (type(x), *(key for _, key in parts))
    if isinstance(x, float):
        return None, bits_of(x)
    if x is None or isinstance(x, str | int):
        return None, x
    return None, (type(x), id(x))


def merged(condition: Condition, a: Any, b: Any) -> Any:
    """``a`` where a condition holds, else ``b``: numbers, conditions, or tuples and lists of them."""
    if a is b or (isinstance(a, Number) and isinstance(b, Number) and a.value is b.value):
        return a
    if isinstance(a, Condition | bool) and isinstance(b, Condition | bool):
        return _merged_conditions(condition, a, b)
    if isinstance(a, Number | float | int) and isinstance(b, Number | float | int):
        return _merged_numbers(condition, a, b)
    if isinstance(a, tuple | list) and type(a) is type(b) and len(a) == len(b):
        parts = [merged(condition, x, y) for x, y in zip(a, b, strict=True)]
        return type(a)(*parts) if hasattr(a, "_fields") else type(a)(parts)
    raise TypeError(
        f"a function with branches returns {a!r} in one way and {b!r} in another; return numbers, or tuples "
        "of numbers, of the same form in every way"
    )


def _merged_conditions(condition: Condition, a: Any, b: Any) -> Any:
    if isinstance(a, bool) and isinstance(b, bool):
        return a if a == b else condition if a else logical_not(condition)
    if isinstance(a, bool):
        return condition | b if a else logical_not(condition) & b
    if isinstance(b, bool):
        return logical_not(condition) | a if b else condition & a
    if a.value is b.value:
        return a
    return where(condition, a, b)


def _merged_numbers(condition: Condition, a: Any, b: Any) -> Any:
    """One selection where ``b`` or ``a`` is itself a selection of the other."""
    if isinstance(a, float | int) and isinstance(b, float | int) and bits_of(a) == bits_of(b):
        return a
    for one, other, here in ((a, b, condition), (b, a, logical_not(condition))):
        value = getattr(other, "value", None)
        if isinstance(value, Operation) and value.name == "select":
            inner, chosen, rest = value.arguments
            inner = Condition(condition.graph, inner)
            if _same(chosen, one):
                return where(here | inner, one, _number(condition.graph, rest))
            if _same(rest, one):
                return where(logical_not(here) & inner, _number(condition.graph, chosen), one)
    return where(condition, a, b)


def _same(value: Any, number: Any) -> bool:
    x = getattr(number, "value", number)
    return value is x or (
        isinstance(value, float) and isinstance(x, float | int) and bits_of(value) == bits_of(x)
    )


def _number(graph: Graph, value: Any) -> Any:
    return value if isinstance(value, float) else Number(graph, value)
