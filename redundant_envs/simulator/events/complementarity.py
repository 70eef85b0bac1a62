"""Which of several stops act on their coordinates, and with what force: linear complementarity problems.

The mobility w of the coordinates is symmetric and positive definite: w[i][j] is the velocity of coordinate i
by a unit impulse along coordinate j, so each problem has one solution. One or two coordinates are solved by
formulas; for more, the set of stops that act is searched.
"""

import itertools
import operator
from collections.abc import Sequence
from functools import reduce
from typing import Any

from redundant_envs.language.algebra import all_of, cases, logical_not, maximum, total

Matrix = Sequence[Sequence[Any]]


def solution(w: Matrix, b: Sequence[Any], unsigned: Matrix | None = None) -> list[Any]:
    """x of w x = b, w symmetric and positive definite: by elimination without pivoting. ``unsigned`` is w
    with two rows and columns of other signs, which have the same determinant."""
    if len(b) == 1:
        return [b[0] * (1.0 / w[0][0])]
    if len(b) == 2:
        m = w if unsigned is None else unsigned
        per_det = 1.0 / (m[0][0] * m[1][1] - m[0][1] * m[0][1])
        return [(w[1][1] * b[0] - w[0][1] * b[1]) * per_det, (w[0][0] * b[1] - w[0][1] * b[0]) * per_det]
    share = [row[0] * (1.0 / w[0][0]) for row in w]
    rest = [[w[i][j] - share[i] * w[0][j] for j in range(1, len(b))] for i in range(1, len(b))]
    x = solution(rest, [b[i] - share[i] * b[0] for i in range(1, len(b))])
    return [(b[0] - total(map(operator.mul, w[0][1:], x))) * (1.0 / w[0][0]), *x]


def solutions(w: Matrix, b: Sequence[Any]) -> list[dict[int, Any]]:
    """x of w x = b for each set of coordinates alone, by their numbers; the smaller sets first."""
    count, solutions = len(b), []
    for some in (s for n in range(1, count + 1) for s in itertools.combinations(range(count), n)):
        x = solution([[w[i][j] for j in some] for i in some], [b[i] for i in some])
        solutions.append(dict(zip(some, x, strict=True)))
    return solutions


def outward_mobilities(w: Matrix, sides: Sequence[Any]) -> list[list[Any]]:
    """Mobilities of outward directions."""
    n = range(len(sides))
    return [[w[i][i] if i == j else sides[min(i, j)] * sides[max(i, j)] * w[i][j] for j in n] for i in n]


def impulses(speeds: Sequence[Any], sides: Sequence[Any], w: Matrix, restitution: Sequence[Any]) -> list[Any]:
    """Impulses at the stops: u+ = -e u for coordinates that moved out, u+ <= 0 for others, and no stop pulls;
    exactly one set of struck stops does so. ``speeds`` are outward, ``sides`` those of stops that are
    touched."""
    n = range(len(speeds))
    outward = outward_mobilities(w, sides)
    at = [s != 0.0 for s in sides]
    d = [u + e * maximum(u, 0.0) for u, e in zip(speeds, restitution, strict=True)]
    choices = []
    for p in solutions(outward, d)[:-1]:
        good = [at[i] & (x >= 0.0) for i, x in p.items()]
        for j in n:
            if j not in p:
                left = reduce(operator.sub, (outward[j][i] * x for i, x in p.items()), d[j])
                good.append(logical_not(at[j]) | (left <= 0.0))
        choices.append((all_of(good), p))
    result = solution(outward, d, w)
    return [cases(*((good, p.get(i, 0.0)) for good, p in choices), default=result[i]) for i in n]


def halting(velocities: Sequence[Any], still: Sequence[Any], w: Matrix) -> list[Any]:
    """Impulses that stop some coordinates; 0 for a coordinate that need not stop."""
    choices: list[list[tuple[Any, Any]]] = [[] for _ in velocities]
    for p in reversed(solutions(w, [-v for v in velocities])):
        if len(velocities) == len(p) == 2:  # the bits of the formula without a change of signs
            (va, vb), per_det = velocities, 1.0 / (w[0][0] * w[1][1] - w[0][1] * w[0][1])
            p = {0: (w[0][1] * vb - w[1][1] * va) * per_det, 1: (w[0][1] * va - w[0][0] * vb) * per_det}
        these = all_of(still[i] for i in p)
        for i, impulse in p.items():
            choices[i].append((these, impulse))
    return [cases(*largest_first, default=0.0) for largest_first in choices]


def pressed(accelerations: Sequence[Any], sides: Sequence[Any], mobilities: Matrix) -> list[Any]:
    """Which of the coordinates at rest at stops of some sides are pressed onto them, from the outward
    ``accelerations`` without stops: in exactly one set no stop pulls and no coordinate moves into one."""
    count, w = len(accelerations), outward_mobilities(mobilities, sides)
    if count == 1:
        return [accelerations[0] > 0.0]
    if count == 2:
        fa, fb = accelerations
        pa = w[1][1] * fa - w[0][1] * fb
        pb = w[0][0] * fb - w[0][1] * fa
        both = (pa >= 0.0) & (pb >= 0.0)
        one_a = (fa > 0.0) & (pb <= 0.0)
        one_b = (fb > 0.0) & (pa <= 0.0)
        some = maximum(fa, fb) > 0.0
        return [some & (both | one_a), some & (both | (logical_not(one_a) & one_b))]
    settled: Any = all_of(f <= 0.0 for f in accelerations)
    result: list[Any] = [False] * count
    for p in solutions(w, accelerations):
        idle = [j for j in range(count) if j not in p]
        good = [x >= 0.0 for x in p.values()]
        good += [accelerations[j] - total(w[j][i] * x for i, x in p.items()) <= 0.0 for j in idle]
        these = logical_not(settled) & all_of(good)
        result = [r | these if i in p else r for i, r in enumerate(result)]
        settled = settled | these
    return result
