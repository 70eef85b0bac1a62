"""Join products with the sums they go into: one rounding, one instruction, the same on every machine."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Container
from typing import Any

from redundant_envs.tracing.graph import Operation, Value, reached


def join_products(results: list[Value], asides: Container[int] = ()) -> None:
    """Join products that are used once with the sum they go into.

    Of two products the one that is computed later is joined. ``asides`` are the indices of results whose uses
    do not count, so that the other results have the same bits as without them.
    """
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
        ready = (known.get(a, 0) for a in node.operands)
        known[node] = max(ready, default=0) + node.latency
