"""One step of an explicit method: stages, sums and the error estimate, on any kind of numbers."""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, NamedTuple

from redundant_envs.language.algebra import maximum, minimum
from redundant_envs.scenes.tableaus import Tableau

Numbers = Sequence[Any]
Derivative = Callable[[Numbers, float], Numbers]
"""(state, node) -> accelerations, derivatives of other states, and watched quantities; a state has positions,
velocities and others, and the node is the share of the step that has passed."""


class Watched(NamedTuple):
    """A quantity at the stages of a step."""

    first: Any
    last: Any
    least: Any
    most: Any
    middle: Any = 0.0  # at the stage that is nearest to the middle of the step
    inner: Any = 0.0  # the greatest that it may be at and near the stages between the ends of the step


class Step(NamedTuple):
    """A step from a state."""

    state: list[Any]  # the new one
    watched: list[Watched]  # further results of the derivative function, beside derivatives
    errors: Sequence[tuple[list[Any], Any]]  # estimates 6, 5 and 3 of each state, if any, and their factors


def weighted(weights: Sequence[float], terms: Numbers) -> tuple[float, Any]:
    """The first weight that is not 0, and the sum of terms in units of it; terms of equal weights are added
    first, which needs fewer products."""
    parts: dict[float, Any] = {}
    for w, term in zip(weights, terms, strict=False):
        if w != 0.0:
            parts[w] = parts[w] + term if w in parts else term
    (factor, total), *rest = parts.items()
    for w, part in rest:
        total = total + (w / factor) * part
    return factor, total


def stage_slope(weights: Sequence[float], terms: Numbers) -> tuple[float, Any]:
    """The same for a stage; slopes that are one number, as that of a clock, are added as one."""
    if all(t is terms[0] for t in terms):
        return math.fsum(weights), terms[0]
    return weighted(weights, terms)


def watch(values: Numbers, method: Tableau) -> Watched:
    """A quantity from its values at the stages of a method."""
    least, most = reduce(minimum, values), reduce(maximum, values)
    inner, size = least, most - least
    earliest = min((node for node in method.c if node > 0.0), default=1.0)
    for x, node, overshoot in zip(values, method.c, method.overshoots, strict=True):
        if 0.0 < node < 1.0:
            # One that leaves 0 is still near it at the earliest stage: there it counts as it is.
            inner = maximum(inner, x + overshoot * size if node > earliest else x)
    return Watched(values[0], values[-1], least, most, values[method.middle], inner)


def explicit_step(method: Tableau, derivative: Derivative, state: Numbers, n: int, h: Any) -> Step:
    """A step of length ``h`` from a state with ``n`` positions."""
    slopes: list[list[Any]] = [[] for _ in state]
    watched: list[list[Any]] = []
    count = len(state) - n  # of derivatives
    if method.name == "euler":
        results = derivative(state, 0.0)
        new = [s + h * k for s, k in zip(state[n:], results, strict=False)]
        moved = [p + h * v for p, v in zip(state[:n], new, strict=False)]
        return Step([*moved, *new], [watch([w], method) for w in results[count:]], ())
    for row, node in zip(method.a, method.c, strict=True):
        stage = state
        if any(row):
            sums = [stage_slope(row, slope) for slope in slopes]
            stage = [s + (h * f) * total for s, (f, total) in zip(state, sums, strict=True)]
        results = derivative(stage, node)
        for slope, k in zip(slopes, (*stage[n : 2 * n], *results), strict=False):
            slope.append(k)
        watched.append(list(results[count:]))
    totals = [weighted(method.b, slope) for slope in slopes]
    new = [s + (h * f) * total for s, (f, total) in zip(state, totals, strict=True)]
    seen = [watch(values, method) for values in zip(*watched, strict=True)]
    if not method.error5:
        return Step(new, seen, ())
    # The lower of the two embedded methods differs from the method itself in three weights only.
    first = method.b[0]
    lower = [(e - b) / first for e, b in zip(method.error3, method.b, strict=True)]
    (factor6, *_), error6 = zip(*(weighted(method.error6, slope) for slope in slopes), strict=True)
    (factor5, *_), error5 = zip(*(weighted(method.error5, slope) for slope in slopes), strict=True)
    lows = [weighted(lower, slope) for slope in slopes]
    error3 = [whole + f * total for (_, whole), (f, total) in zip(totals, lows, strict=True)]
    factors = h * abs(factor6), h * abs(factor5), h * first
    return Step(new, seen, list(zip(map(list, (error6, error5, error3)), factors, strict=True)))
