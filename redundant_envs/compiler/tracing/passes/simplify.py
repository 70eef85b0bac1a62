"""Fewer operations: products join the sums they go into, with one rounding and one instruction on every
machine, and known numbers decide what is chosen."""

import itertools
from collections import Counter
from collections.abc import Container, Mapping
from typing import Any

from redundant_envs.compiler.tracing.graph import COMPARISONS, Operation, Value, reached


def join_products(results: list[Value], asides: Container[int] = ()) -> None:
    """Join products that are used once with the sum they go into; of two products the one that is computed
    later. Uses of the results with the indices ``asides`` do not count, so that others have the same bits
    without them."""
    if asides:
        _join([r for k, r in enumerate(results) if k not in asides])
    _join(results)


def _join(results: list[Value]) -> None:
    nodes = reached(results)
    uses = Counter(itertools.chain(results, *(n.arguments for n in nodes)))
    known: dict[Any, int] = {}  # cycles after which a value is available

    def negative(value: Value) -> Value:
        if isinstance(value, float):
            return -value
        result = Operation("neg", [value], None, value.origin)
        known[result] = known.get(value, 0)
        return result

    for node in nodes:
        pair = node.operands if node.name in ("+", "-") else []
        products = [node.arguments.index(a) for a in pair if a.name == "*" and uses[a] == 1]
        if products:
            k = max(products, key=lambda k: known[node.arguments[k]])
            a, b = node.arguments[k].arguments
            c = node.arguments[1 - k]
            if node.name == "-":
                if k == 0:
                    c = negative(c)
                elif isinstance(b, float):
                    b = negative(b)
                else:
                    a = negative(a)
            node.name, node.arguments = "fma", [a, b, c]
        known[node] = max((known.get(a, 0) for a in node.operands), default=0) + node.latency


def specialise(results: list[Value], known: Mapping[tuple[str, int], float]) -> list[Value]:
    """The results if some locations (space, number) hold known numbers, without values that are never chosen.
    Joined products stay joined, so the bits are those of the whole function with these numbers."""
    if not known:
        return results
    values: dict[Operation, Value | bool] = {}

    def folded(node: Operation) -> Value | bool:
        if node.name == "load":
            return known.get(node.extra, node)
        arguments = [values[a] if isinstance(a, Operation) else a for a in node.arguments]
        if node.name == "abs" and isinstance(arguments[0], float):
            return abs(arguments[0])
        if node.name in COMPARISONS and all(isinstance(a, float) for a in arguments):
            return bool(COMPARISONS[node.name](*arguments))
        if node.name == "select" and isinstance(arguments[0], bool):
            return arguments[1 if arguments[0] else 2]
        if node.name in ("and", "or") and any(isinstance(a, bool) for a in arguments):
            first, second = arguments if isinstance(arguments[0], bool) else reversed(arguments)
            return second if first is (node.name == "and") else first
        if node.name == "not" and isinstance(arguments[0], bool):
            return not arguments[0]
        if all(x is y for x, y in zip(arguments, node.arguments, strict=True)):
            return node
        if node.name == "stage":  # the stages know it
            node.arguments = arguments
            return node
        return Operation(node.name, arguments, node.extra, node.origin)

    for node in reached(results):
        values[node] = folded(node)
    return [values[r] if isinstance(r, Operation) else r for r in results]
