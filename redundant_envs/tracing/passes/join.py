"""Join products with the sums they go into: one rounding, one instruction, the same on every machine."""

from __future__ import annotations

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
    uses = dict.fromkeys(nodes, 0)
    for value in [a for n in nodes for a in n.operands] + [r for r in results if isinstance(r, Operation)]:
        uses[value] += 1
    known: dict[Any, int] = {}  # cycles after which a value is available

    def negative(value: Value) -> Value:
        if isinstance(value, float):
            return -value
        result = Operation("neg", [value], None, value.origin)
        known[result] = known.get(value, 0)
        return result

    for node in nodes:
        products = [
            k
            for k, a in enumerate(node.arguments)
            if isinstance(a, Operation) and a.name == "*" and uses[a] == 1
        ]
        if products and node.name in ("+", "-"):
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
