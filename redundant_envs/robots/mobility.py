"""Upper bounds of the mobilities of joints in every pose, diag(B^T M^-1 B), from the point masses alone.

The mobility of a joint is 1 over the least sum m |v|^2 with which its rate is 1 while the other joints move
freely. Where the rate is a sum of c_k . v_k over velocities of points in every pose, it is at most the sum
of |c_k|^2 / m_k, by the inequality of Cauchy and Schwarz. Such sums are found in poses at random, when an
arm's class is made: two points at a constant distance determine the rate of their line, two such lines the
rate of a joint between them; and points whose velocities along a slider differ by its rate alone determine
that rate.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.language.algebra import minimum, numbered, physics, sqrt, total
from redundant_envs.language.quantities import Function, Quantities
from redundant_envs.robots.derived import joint_rates
from redundant_envs.robots.from_points import Points

Array = NDArray[np.float64]
POSES = 4
EQUAL = 1e-9
"""Numbers of size 1 that differ by less than this in all these poses are the same in every pose."""


class Rod(NamedTuple):
    """Two mass points at a constant distance, counted from 1; 0 is the base."""

    near: int
    far: int
    rate: tuple[float, ...]  # of its angle: a sum of rates of the coordinates


def mobility_bounds(arm: Any) -> Function | None:
    """``W1 .. Wn`` of masses and lengths; None if the mass points do not determine the rate of a joint."""
    points = Points(arm)
    with np.errstate(all="ignore"):
        try:
            where, slopes = _in_poses(points)
        except (ArithmeticError, ValueError):
            return None
        if not (np.isfinite(where).all() and np.isfinite(slopes).all()):
            return None  # not defined in these poses
        lines = [*_lines(where, slopes)]
    choices = [
        [*(_along(slopes, j, row) if arm.prismatic[j] else _between(lines, row))]
        for j, row in enumerate(joint_rates(arm))
    ]
    if not all(choices):
        return None

    @physics(gives=numbered("W{}", points.joints), takes=points.numbers)
    def mobility_bounds(*values):
        known = dict(zip(points.numbers, values, strict=True))
        m, distances = [known[name] for name in points.masses], _distances(points, known, lines)
        return tuple(reduce(minimum, [bound(m, distances) for bound in of_joint]) for of_joint in choices)

    return mobility_bounds


def _in_poses(points: Points) -> tuple[Array, Array]:
    """Positions of the base and all points in random poses of random arms, (points, 2, poses), and their
    derivatives by the coordinates, (points, 2, poses, coordinates)."""
    rng = np.random.default_rng(0)
    known: dict[str, Any] = {name: rng.uniform(0.5, 1.5, POSES) for name in points.numbers}
    known |= {name: rng.uniform(-1.5, 1.5, POSES) for name in points.coordinates}
    for angle, (s, c) in points.turning.items():
        known[s], known[c] = np.sin(known[angle]), np.cos(known[angle])

    def stacked(values: Sequence[Any]) -> Array:
        rows = (np.broadcast_to(np.asarray(x, dtype=np.float64), POSES) for x in (0.0, 0.0, *values))
        return np.stack([*rows]).reshape(-1, 2, POSES)

    where = stacked(Quantities(known, points.functions, points.sincos).each(points.positions))
    return where, np.stack([stacked(points.column(known, j)) for j in range(points.joints)], axis=-1)


def _lines(where: Array, slopes: Array) -> Iterator[Rod]:
    for a, b in itertools.combinations(range(len(where)), 2):
        (x, y), (dx, dy) = where[b] - where[a], slopes[b] - slopes[a]
        square = (x * x + y * y)[:, None]
        stretch = (x[:, None] * dx + y[:, None] * dy) / square
        turn = (x[:, None] * dy - y[:, None] * dx) / square
        if _is_zero(stretch) and _is_zero(turn - turn[0]):
            yield Rod(a, b, tuple(np.where(np.abs(turn[0]) < EQUAL, 0.0, turn[0]).tolist()))


def _is_zero(x: Array) -> bool:
    return bool((np.abs(x) < EQUAL).all())


Bound = Callable[[Sequence[Any], Sequence[Any]], Any]
"""A bound from the masses and the distances of all lines."""


def _between(lines: Sequence[Rod], row: Array) -> Iterator[Bound]:
    """Bounds of a revolute joint's mobility, from lines that turn with its rate, alone or relative to
    another."""
    alone = [(k,) for k, line in enumerate(lines) if _is_zero(np.abs(line.rate) - np.abs(row))]
    pairs = itertools.permutations(range(len(lines)), 2)
    both = [(i, k) for i, k in pairs if _is_zero(np.subtract(lines[k].rate, lines[i].rate) - row)]
    for chosen in (*alone, *both):
        ends = [(k, point) for k in chosen for point in (lines[k].near, lines[k].far) if point]

        def bound(m: Sequence[Any], distances: Sequence[Any], ends: Any = ends) -> Any:
            by_point: dict[int, list[Any]] = {}
            for k, point in ends:
                by_point.setdefault(point, []).append(1.0 / distances[k])
            return total([total(shares) * total(shares) / m[point - 1] for point, shares in by_point.items()])

        yield bound


def _along(slopes: Array, j: int, row: Array) -> Iterator[Bound]:
    """Bounds of a slider's mobility, from points whose velocities along it differ by its rate. Points with
    the same velocity along it count with their total mass."""
    moved = [k for k in range(len(slopes)) if not _is_zero(slopes[k, ..., j])]
    if not moved:
        return
    direction = slopes[moved[0], ..., j]
    if not _is_zero(np.square(direction).sum(axis=0) - 1.0):
        return
    speeds = np.einsum("ap,kapj->kpj", direction, slopes)
    groups: list[list[int]] = []
    for k, speed in enumerate(speeds):
        group = next((g for g in groups if _is_zero(speeds[g[0]] - speed)), [])
        if not group:
            groups.append(group)
        group.append(k)
    for near, far in itertools.permutations(groups, 2):
        if not _is_zero(speeds[far[0]] - speeds[near[0]] - row):
            continue

        def bound(m: Sequence[Any], distances: Sequence[Any], two: Any = (near, far)) -> Any:
            return total([1.0 / total([m[k - 1] for k in group]) for group in two if 0 not in group])

        yield bound


def _distances(points: Points, known: dict[str, Any], lines: Sequence[Rod]) -> list[Any]:
    """Lengths of lines, from the difference of columns of Jacobians, where nothing cancels."""
    pose = dict.fromkeys(points.pose, 0.0) | {c: 1.0 for _, c in points.turning.values()}
    columns = [points.column({**known, **pose}, j) for j in range(points.joints)]
    distances = []
    for near, far, rate in lines:
        if not any(rate):  # it never turns, and no joint's rate follows from it
            distances.append(0.0)
            continue
        j = int(np.flatnonzero(rate)[-1])
        moved = [0.0, 0.0, *columns[j]]  # the base, and all points
        x, y = (moved[2 * far + axis] - moved[2 * near + axis] for axis in range(2))
        distances.append(sqrt(x * x + y * y) / abs(float(rate[j])))
    return distances
