"""A form of a graph for lanes whose memory is known to hold some numbers."""

from __future__ import annotations

import operator
from collections.abc import Mapping

from redundant_envs.tracing.graph import Operation, Value, reached

COMPARISONS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne,
}  # fmt: skip


def specialise(results: list[Value], known: Mapping[tuple[str, int], float]) -> list[Value]:
    """The results if some memory locations (space, number) hold known numbers: values never chosen are
    dropped.

    Joined products stay joined, so the bits are those of the whole function with these numbers.
    """
    if not known:
        return results
    made: dict[Operation, Value | bool] = {}

    def folded(node: Operation) -> Value | bool:
        if node.name == "load":
            return known.get(node.extra, node)
        arguments = [made[a] if isinstance(a, Operation) else a for a in node.arguments]
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
        made[node] = folded(node)
    return [made[r] if isinstance(r, Operation) else r for r in results]
