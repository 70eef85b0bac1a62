"""Ordinary ``if`` on traced numbers: a stretch of Python is run once for each way that its conditions can go.

The results of the ways are merged by selections, so a function with branches becomes straight-line code for
a vector of lanes. On floats the same function simply runs.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from redundant_envs.compiler.tracing.graph import Graph, Operation, bits_of, setting
from redundant_envs.compiler.tracing.number import Condition, Number, Traced, deciding, outlives
from redundant_envs.language.algebra import any_of, logical_not, where

MAX_WAYS = 256
"""With more ways a stretch takes too long to trace, and its code is too long."""

MERGING = ("select", "and", "or", "not")
"""Operations that merge ways."""

F = TypeVar("F", bound=Callable[..., Any])


class Ways:
    """The answers to the conditions of one run: the given ones first, then true."""

    def __init__(self, graph: Graph, ahead: Sequence[bool]) -> None:
        self.graph, self.ahead = graph, ahead
        self.taken: list[tuple[Condition, bool]] = []
        """Conditions in the order in which they were met, and their answers."""
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


@dataclass(eq=False)
class Way:
    """One way of a stretch, and its result."""

    result: Any

    @property
    def leaves(self) -> list[Way]:
        return [self]

    def within(self, some: frozenset[Way]) -> bool:
        return self in some


class Fork:
    """The ways of a stretch in which a condition holds, and the others."""

    def __init__(self, condition: Any, yes: Tree, no: Tree) -> None:
        self.condition, self.yes, self.no = condition, yes, no
        self.leaves: list[Way] = [*yes.leaves, *no.leaves]
        self.known: dict[frozenset[Way], Any] = {}

    def within(self, some: frozenset[Way]) -> Any:
        """The condition under which one of some ways is taken."""
        some = some.intersection(self.leaves)
        if len(some) in (0, len(self.leaves)):
            return bool(some)
        if some not in self.known:
            self.known[some] = self._within(some)
        return self.known[some]

    def _within(self, some: frozenset[Way]) -> Any:
        return either(self.condition, self.yes.within(some), self.no.within(some))


class Exclusive(Fork):
    """Ways of which those under one condition are taken if it holds; at most one of the conditions does. If
    none holds an empty way is taken."""

    def __init__(self, parts: Sequence[tuple[Any, Tree]]) -> None:
        tree: Tree = (none := Way({}))
        for condition, part in reversed(parts):
            tree = Fork(condition, part, tree)
        assert isinstance(tree, Fork)
        super().__init__(tree.condition, tree.yes, tree.no)
        self.parts, self.none = parts, none

    def _within(self, some: frozenset[Way]) -> Any:
        if self.none in some:
            return logical_not(self.within(frozenset(self.leaves) - some))
        return any_of(c & part.within(some) for c, part in self.parts)


Tree = Way | Fork


def ending(trees: list[Tree]) -> tuple[Condition, Way, list[Tree]] | None:
    """If several stretches begin with one fork, and on one side of it do the same at once: the condition of
    that side, its way, and the other side of each."""
    forks = [tree for tree in trees if isinstance(tree, Fork)]
    if len(forks) != len(trees) or len(trees) < 2 or len({tree.condition.value for tree in forks}) > 1:
        return None
    condition = forks[0].condition
    sides = [tree.yes for tree in forks], [tree.no for tree in forks]
    for (ends, rest), end in ((sides, condition), (sides[::-1], logical_not(condition))):
        written = [sorted(way.result.items()) for way in ends if isinstance(way, Way)]
        if len(written) == len(ends) and all(same(w, written[0]) for w in written):
            return end, ends[0], rest  # type: ignore[return-value]
    return None


def every_way(graph: Graph, run: Callable[[Ways], Any], what: str) -> Tree:
    """Run a stretch, which ``what`` names in messages, once for each way, recorded in a graph. It must do the
    same as long as its conditions have the same answers."""
    count = itertools.count(1)

    def way(ahead: list[bool]) -> Tree:
        if next(count) > MAX_WAYS:
            raise ValueError(
                f"{what} has more than {MAX_WAYS} ways; let a function marked with @branches decide a part "
                "of it, whose ways are merged where it returns"
            )
        ways = Ways(graph, ahead)
        with setting(deciding, ways.answer):
            tree: Tree = Way(run(ways))
        for k in reversed(range(len(ahead), len(ways.taken))):
            tree = Fork(ways.taken[k][0], tree, way([*(answer for _, answer in ways.taken[:k]), False]))
        return tree

    return way([])


def branches(function: F) -> F:
    """Mark a function of numbers that may use ``if``, ``and``, ``or`` and ``not`` on conditions.

    On traced numbers all its ways are run and what it returns is merged: numbers, conditions, and tuples or
    named tuples of these. It has no effect beside its result, and equal calls are traced once.
    """

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        graph = _graph_of(arguments)
        if graph is None:
            return function(*arguments)
        known = (function, _key(arguments))
        if known not in graph.results:
            tree = every_way(graph, lambda _: function(*arguments), function.__qualname__)
            # Arguments are kept, too: keys hold identities.
            graph.results[known] = merged(tree, [way.result for way in tree.leaves]), arguments
        return graph.results[known][0]

    return call  # type: ignore[return-value]


def _graph_of(x: Any) -> Graph | None:
    """The graph of the numbers in an argument."""
    if isinstance(x, Traced):
        return x.graph
    return next(filter(None, map(_graph_of, x)), None) if isinstance(x, tuple | list) else None


def _key(x: Any) -> Any:
    """A key that is equal for equal arguments."""
    if isinstance(x, Traced):
        return x.value if type(x.value) is Operation else bits_of(x.value)
    if isinstance(x, float):
        return bits_of(x)
    if isinstance(x, tuple | list):
        return type(x), *map(_key, x)
    return x if x is None or isinstance(x, str | int) else (type(x), id(x))


def merged(tree: Tree, values: Sequence[Any]) -> Any:
    """The value, of one for each leaf of a tree, of the way that is taken: numbers, conditions, or tuples and
    lists of them."""
    first = values[0]
    if all(isinstance(x, Condition | bool) for x in values):
        return _folded(tree, iter(values), either)
    if all(isinstance(x, Number | float | int) for x in values):
        return _folded(tree, iter(values), _selection)
    alike = all(type(x) is type(first) for x in values)
    if alike and isinstance(first, tuple | list) and len({len(x) for x in values}) == 1:
        parts = [merged(tree, part) for part in zip(*values, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else type(first)(parts)
    if all(x is first for x in values):
        return first
    other = next(x for x in values if x is not first)
    raise TypeError(
        f"a function with branches returns {first!r} in one way and {other!r} in another; return numbers, or "
        "tuples of numbers, of the same form in every way"
    )


def _folded(tree: Tree, values: Iterator[Any], choice: Callable[[Any, Any, Any], Any]) -> Any:
    """One value from those of all leaves, by a choice at each fork."""
    if isinstance(tree, Way):
        return next(values)
    return choice(tree.condition, _folded(tree.yes, values, choice), _folded(tree.no, values, choice))


def either(condition: Any, a: Any, b: Any) -> Any:
    """The condition ``a`` where another one holds, else ``b``."""
    if isinstance(a, bool) and isinstance(b, bool):
        return a if a == b else condition if a else logical_not(condition)
    if isinstance(a, bool):
        return condition | b if a else logical_not(condition) & b
    if isinstance(b, bool):
        return logical_not(condition) | a if b else condition & a
    return a if a.value is b.value else where(condition, a, b)


def _selection(condition: Any, a: Any, b: Any) -> Any:
    return a if same(a, b) else where(condition, a, b)


def same(a: Any, b: Any) -> bool:
    """Whether two numbers are one value of a graph, or one constant."""
    return bool(_key(a) == _key(b))


def merged_fields(tree: Tree, fields: dict[str, list[Any]]) -> dict[str, Any]:
    """Of the numbers of several fields in all leaves of a tree, those of the way that is taken. Fields that
    are equal in the same ways are merged alike, in the form that needs fewer operations: a selection at each
    fork, or one for each different number but one, by shared conditions that its ways are taken."""
    alike: dict[Any, list[str]] = {}
    for name, values in fields.items():
        first: dict[Any, int] = {}
        keys = (_key(float(x) if isinstance(x, int) else x) for x in values)
        alike.setdefault(tuple(first.setdefault(key, k) for k, key in enumerate(keys)), []).append(name)
    total: dict[str, Any] = {}
    used: set[Operation] = set()
    for partition, names in sorted(alike.items(), key=lambda item: -len(item[1])):
        forms = (
            {name: _folded(tree, iter(fields[name]), _selection) for name in names},
            {name: _by_number(tree, partition, fields[name]) for name in names},
        )
        counted = ((_operations(form.values(), used), form) for form in forms)
        needed, form = min(counted, key=lambda n: len(n[0]))
        used |= needed
        total |= form
    return total


def _by_number(tree: Tree, partition: Sequence[int], values: Sequence[Any]) -> Any:
    groups: dict[int, list[Way]] = {}
    for way, k in zip(tree.leaves, partition, strict=True):
        groups.setdefault(k, []).append(way)
    # The last selection decides between two numbers, and the others come after it.
    *others, last = sorted(groups, key=lambda k: len(groups[k]))
    result = values[last]
    for k in reversed(others):
        result = where(tree.within(frozenset(groups[k])), values[k], result)
    return result


def _operations(values: Iterable[Any], known: set[Operation]) -> set[Operation]:
    """Operations that decide and select, and that some values need beside known ones."""
    nodes: set[Operation] = set()
    stack = [x.value for x in values if isinstance(x, Number)]
    while stack:
        node = stack.pop()
        if isinstance(node, Operation) and node.name in MERGING and node not in known and node not in nodes:
            nodes.add(node)
            stack += node.arguments
    return nodes
