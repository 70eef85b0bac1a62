"""The dialect on NumPy arrays, elementwise over any batch shape."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

import numpy as np

from redundant_envs.evaluators.binding import run
from redundant_envs.evaluators.quantities import Call, calls
from redundant_envs.robots.parameters import Arm


def _minimum(a: Any, b: Any) -> Any:
    return np.where(np.greater(a, b), b, a)[()]


def _maximum(a: Any, b: Any) -> Any:
    return np.where(np.less(a, b), b, a)[()]


PRIMITIVES: dict[str, Any] = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "minimum": _minimum,
    "maximum": _maximum,
    "where": np.where,
    "floor": np.floor,
    "sincos": lambda x: (np.sin(x), np.cos(x)),
}


def evaluate(arm: Arm, wanted: Iterable[str], values: dict[str, Any]) -> list[Any]:
    """Quantities of an arm from known ones (arrays that broadcast), in the order wanted."""
    names = tuple(wanted)
    kind: Any = type(arm)
    result = run(_order(kind, names, frozenset(values)), dict(values), PRIMITIVES)
    return [result[name] for name in names]


@functools.cache
def _order(arm: type[Arm], names: tuple[str, ...], known: frozenset[str]) -> list[Call]:
    """Statements for some quantities; a program asks for the same ones again and again."""
    return calls(names, known, arm.functions, arm.sincos)
