"""Give dialect functions another meaning of the primitives: NumPy, sympy, mpmath, ..."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from redundant_envs.algebra import PRIMITIVES, is_physics
from redundant_envs.dialect import callees, meanings, names_in
from redundant_envs.evaluators.quantities import Call

_bound: dict[tuple[Any, int], tuple[Mapping[str, Any], Any, Callable[..., Any]]] = {}
"""Copies already made, and the meanings of all they reach, by function and identity of the primitives.

The primitives are kept, so the identity stays theirs.
"""


def bind(function: Callable[..., Any], primitives: Mapping[str, Any]) -> Callable[..., Any]:
    """A copy of a dialect function, and of all it calls now, that uses the given primitives."""
    key = (function, id(primitives))
    reached = [(f, meanings(f)) for f in helpers([function])]
    if key not in _bound or _bound[key][1] != reached:
        _bound[key] = primitives, reached, _bind(function, primitives, {})
    return _bound[key][2]


def _bind(
    function: Callable[..., Any], primitives: Mapping[str, Any], done: dict[Any, Callable[..., Any]]
) -> Callable[..., Any]:
    if function in done:
        return done[function]
    source: Any = function
    names: dict[str, Any] = {"abs": abs}
    for name, value in names_in(function).items():
        if name in PRIMITIVES:
            names[name] = primitives[name]
        elif is_physics(value):
            names[name] = _bind(value, primitives, done)
    cells = tuple(types.CellType(names[n]) for n in source.__code__.co_freevars)
    bound = types.FunctionType(source.__code__, names, source.__name__, None, cells)
    done[function] = bound
    return bound


def run(order: Sequence[Call], values: dict[str, Any], primitives: Mapping[str, Any]) -> dict[str, Any]:
    """Evaluate statements; ``values`` is extended in place and returned.

    ``primitives`` also holds "sincos", which returns a pair.
    """
    for call in order:
        arguments = [values[a] for a in call.arguments]
        if call.function is None:
            results = primitives["sincos"](*arguments)
        else:
            results = bind(call.function, primitives)(*arguments)
            if len(call.names) == 1:
                results = (results,)
        values.update(zip(call.names, results, strict=True))
    return values


def helpers(functions: Iterable[Callable[..., Any]]) -> list[Callable[..., Any]]:
    """The functions and all dialect functions they call, callees first."""
    order: list[Callable[..., Any]] = []

    def visit(function: Callable[..., Any]) -> None:
        if function in order:
            return
        for called in callees(function):
            visit(called)
        order.append(function)

    for f in functions:
        visit(f)
    return order
