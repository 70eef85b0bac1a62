"""Numbers as NumPy arrays, elementwise over any shape."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from redundant_envs.algebra import Primitives, register_numbers
from redundant_envs.quantities import Quantities


def _where(condition: Any, a: Any, b: Any) -> Any:
    return np.where(condition, a, b)[()]


register_numbers(
    Primitives(np.sqrt, np.exp, np.floor, lambda x: (np.sin(x), np.cos(x)), _where, np.logical_not),
    np.ndarray, np.generic,
)  # fmt: skip


def evaluate(arm: Any, wanted: Iterable[str], values: Mapping[str, Any]) -> list[Any]:
    """Quantities of an arm from known ones (arrays that broadcast), in the order wanted."""
    return Quantities(values, arm.functions, arm.sincos).each(wanted)
