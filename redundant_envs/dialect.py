"""Check that a function belongs to the physics dialect, by running it on traced numbers."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from redundant_envs.algebra import PRIMITIVES, arguments_of, is_physics
from redundant_envs.tracing.graph import Graph
from redundant_envs.tracing.number import Condition, Number

ALLOWED = (
    f"+ - * /, ** 2 to 4, comparisons of two, numbers, tuples, and calls of {', '.join(PRIMITIVES)} "
    "(from redundant_envs.algebra), abs, and functions marked @physics"
)


def check(function: Any) -> None:
    """Refuse a function that is outside the dialect; the message says what to write."""
    results_of(function)


def results_of(function: Any) -> int:
    """Number of values that a function of the dialect returns; ValueError if it is none."""
    if not callable(function):
        raise ValueError(f"{function!r:.80} is no function; write one with 'def', marked @physics")
    name = f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', repr(function))}"
    if not is_physics(function):
        raise ValueError(f"{name} is not marked; write @physics above its 'def'")
    try:
        names = arguments_of(function)
        graph = Graph()
        results = function(*(Number(graph, graph.load("argument", k)) for k in range(len(names))))
    except RecursionError:
        raise ValueError(f"{name} calls itself; write it without recursion") from None
    except Exception as error:
        raise ValueError(
            f"{name}{_place(error, function)} is outside the physics dialect: {error}; write {ALLOWED}"
        ) from None
    values = results if isinstance(results, tuple) else (results,)
    for value in values:
        if isinstance(value, bool | Condition) or not isinstance(value, Number | float | int):
            what = "a condition" if isinstance(value, bool | Condition) else f"a {type(value).__name__}"
            raise ValueError(f"{name} returns {what}; return numbers, such as where(condition, 1.0, 0.0)")
    return len(values)


def _place(error: Exception, function: Callable[..., Any]) -> str:
    """File and line within the function at which it failed."""
    file = getattr(getattr(function, "__code__", None), "co_filename", None)
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    return f" ({file}:{lines[-1]})" if lines else ""
