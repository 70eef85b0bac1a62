"""Checks of numbers: masses, lengths, strengths and travels, of arms and of effects."""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

from redundant_envs.support.values import shown

LARGEST_RATIO = 1e12
"""Largest allowed ratio of two masses or two lengths: beyond it float64 loses the small one."""

SMALLEST, LARGEST = 1e-30, 1e30
"""Allowed masses and lengths: products of several of them must neither overflow nor vanish."""


STRONGEST = 1e100
"""Largest strength of a field, a force, a spring or a damper: the largest mass times the largest length,
times a factor above any rate; its square still is a float."""


def number(field: str, value: Any) -> float:
    """A finite float, or a ValueError that names the field."""
    numeric = getattr(getattr(value, "dtype", None), "kind", "f") in "iuf"  # NumPy: no bool, no complex
    if isinstance(value, (bool, str, bytes, bytearray)) or not numeric or getattr(value, "ndim", 0) != 0:
        raise ValueError(f"{field} is {shown(value)}; give a finite number")
    try:
        x = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field} is {shown(value)}; give a finite number") from None
    if not math.isfinite(x):
        raise ValueError(f"{field} is {x}; give a finite number")
    return x


def between(field: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """A finite float from ``low`` to ``high``, or a ValueError that names the field."""
    x = number(field, value)
    if not low <= x <= high:
        raise ValueError(f"{field} is {x}{unit}; it must lie in {low:g} to {high:g}{unit}")
    return x


def strength(field: str, value: Any) -> float:
    """A finite float that is no larger than :data:`STRONGEST`, or a ValueError that names the field."""
    return between(field, value, -STRONGEST, STRONGEST)


def travel(form: str, lower: Any, upper: Any) -> tuple[float, float]:
    """Two ends of a travel, the fields ``form.format("lower")`` and ``("upper")``: finite, in order, and at
    least as far apart as the smallest allowed length."""
    first, last = form.format("lower"), form.format("upper")
    low, high = between(first, lower, -LARGEST, LARGEST), between(last, upper, -LARGEST, LARGEST)
    if high - low < SMALLEST:
        ends = f"{first} is {low}, {last.partition('.')[2]} is {high}"
        raise ValueError(f"{ends}; lower must be below, by at least {SMALLEST:g}")
    return low, high


def numbers(field: str, values: Any, count: int | None = None) -> tuple[float, ...]:
    """A tuple of finite floats, ``count`` of them if that is given, or a ValueError that names the field."""
    plain = hasattr(values, "__len__") and hasattr(values, "__getitem__") and not isinstance(values, Mapping)
    if isinstance(values, (str, bytes)) or not plain or getattr(values, "ndim", 1) == 0:
        many = "numbers" if count is None else f"{count} numbers"
        raise ValueError(f"{field} is {shown(values)}; give a sequence of {many}")
    if count is not None and len(values) != count:
        raise ValueError(f"{field} has {len(values)} entries; give {count}")
    return tuple(number(f"{field}[{i}]", v) for i, v in enumerate(values))


def for_sliders(effect: str, arm: str, sliders: list[int], count: int) -> list[int]:
    """The sliders of an arm; ValueError unless an effect has a number for each of them."""
    if not sliders:
        raise ValueError(f"{effect} acts on prismatic joints, and {arm} has none: leave it out")
    if len(sliders) != count:
        raise ValueError(
            f"{effect} has numbers for {count} prismatic joints and {arm} has {len(sliders)}: give as many"
        )
    return sliders


def each(allowed: Callable[[float], bool], said: str, field: str, values: Any) -> float | tuple[float, ...]:
    """A strength, or a sequence of one for each joint, all of them ``allowed``, or a ValueError."""
    one = not hasattr(values, "__len__") or getattr(values, "ndim", 1) == 0
    named = {field: values} if one else {f"{field}[{i}]": x for i, x in enumerate(numbers(field, values))}
    xs = tuple(number(name, value) for name, value in named.items())
    for name, x in zip(named, xs, strict=True):
        if not allowed(x):
            raise ValueError(f"{name} is {x}; {said}")
        strength(name, x)
    return xs[0] if one else xs


strengths = functools.partial(each, lambda x: True, "")
"""From the name of a field and its value to a strength, or a sequence of one for each joint."""
not_negative = functools.partial(each, lambda x: x >= 0.0, "it must not be negative")
share = functools.partial(each, lambda x: 0.0 <= x <= 1.0, "it must lie in 0 to 1")
positive = functools.partial(each, lambda x: x > 0.0, "it must be positive")


def positive_numbers(field: str, values: Any, count: int, unit: str) -> tuple[float, ...]:
    """Positive numbers within a ratio of 1e12 of each other."""
    xs = numbers(field, values, count)
    for i, x in enumerate(xs):
        if x <= 0.0:
            raise ValueError(
                f"{field}[{i}] is {x} {unit}; it must be positive "
                "(a vanishing value makes the mass matrix singular in some pose)"
            )
        if not SMALLEST <= x <= LARGEST:
            raise ValueError(
                f"{field}[{i}] is {x} {unit}; it must lie in {SMALLEST} to {LARGEST}: choose units "
                "in which it does"
            )
    if xs and max(xs) > LARGEST_RATIO * min(xs):
        raise ValueError(
            f"{field} spans a ratio of {max(xs) / min(xs):.1e}; at most {LARGEST_RATIO:.0e} "
            "is supported in float64: raise the smallest or lower the largest"
        )
    return xs
