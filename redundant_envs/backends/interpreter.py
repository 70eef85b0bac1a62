"""Graphs on arrays, tensors or other numbers: an interpreter, operation by operation."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from typing import Any

from redundant_envs import algebra
from redundant_envs.tracing.graph import Operation, Value, reached
from redundant_envs.tracing.passes.simplify import COMPARISONS

OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "neg": operator.neg,
    "abs": abs, "sqrt": algebra.sqrt, "floor": algebra.floor, "exp": algebra.exp,
    "sin": lambda x: algebra.sincos(x)[0], "cos": lambda x: algebra.sincos(x)[1],
    **COMPARISONS, "and": operator.and_, "or": operator.or_, "xor": operator.xor,
    "not": algebra.logical_not, "select": algebra.where,
}  # fmt: skip
"""Operations of a graph that is recorded with whole functions (:class:`Graph`)."""


def evaluate(results: Iterable[Value], load: Callable[[tuple[str, int]], Any]) -> list[Any]:
    """Values of a graph; ``load`` returns the number at a memory location."""
    results = list(results)
    known: dict[Operation, Any] = {}
    for node in reached(results):
        arguments = [known[a] if isinstance(a, Operation) else a for a in node.arguments]
        if node.name == "load":
            known[node] = load(node.extra)
        elif node.name == "stage":
            known[node] = node.extra.function(*arguments)
        elif node.name == "result":
            known[node] = arguments[0][node.extra]
        else:
            known[node] = OPERATIONS[node.name](*arguments)
    return [known[r] if isinstance(r, Operation) else r for r in results]
