"""Equations that follow from the positions of an arm's point masses alone, by differentiating them.

The functions that return ``x1 y1 ...`` are run on numbers with derivatives: along one coordinate they yield
a column of every point's Jacobian, along the rates its velocity, twice along the rates its acceleration at
constant rates. A derivative that is 0 in every pose is the float 0.0, and nothing is computed from it.
Sums over the mass points of these are the mass matrix, the bias forces and the gravity forces.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import entries, gives_of, minimum, numbered, physics, sqrt, total
from redundant_envs.dual import Dual, dual, is_zero, times
from redundant_envs.quantities import Quantities
from redundant_envs.robots.derived import identity, rows

Function = Callable[..., Any]


class Points:
    """The mass points of an arm's class as functions of its coordinates, by the functions it has so far."""

    def __init__(self, arm: Any) -> None:
        self.functions, self.sincos = tuple(arm.functions), arm.sincos
        self.coordinates, self.rates = arm.coordinates, arm.rates
        self.count, self.joints = arm.num_masses, len(arm.coordinates)
        self.positions = [f"{axis}{k + 1}" for k in range(self.count) for axis in "xy"]
        self.masses = numbered("m{}", arm.num_masses)
        self.numbers = [*self.masses, *numbered("l{}", arm.num_lengths)]
        self.turning = {angle: pair for angle, pair in arm.sincos.items() if angle in arm.coordinates}
        self.pose = [*self.coordinates, *(name for pair in self.turning.values() for name in pair)]
        """Coordinates, and sines and cosines of those that are angles."""

    def along(self, known: Mapping[str, Any], slopes: Sequence[Any]) -> dict[str, Any]:
        """Known values, those of the pose with derivatives; ``slopes`` are those of the coordinates."""
        moving = dict(zip(self.coordinates, slopes, strict=True))
        made = {**known, **{q: Dual(known[q], slope) for q, slope in moving.items()}}
        for angle, (s, c) in self.turning.items():
            made[s] = Dual(known[s], times(known[c], moving[angle]))
            made[c] = Dual(known[c], times(-known[s], moving[angle]))
        return made

    def moving(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """Known values, those of the pose with derivatives by time."""
        return self.along(known, [known[rate] for rate in self.rates])

    def slopes(self, known: Mapping[str, Any]) -> list[Any]:
        """Derivatives of all positions, x1 y1 x2 ..., of values that :meth:`along` gave."""
        x = Quantities(known, self.functions, self.sincos)
        return [dual(x[name]).slope for name in self.positions]

    def column(self, known: Mapping[str, Any], j: int) -> list[Any]:
        """Derivatives of all positions by coordinate j, counted from 0."""
        return self.slopes(self.along(known, [float(i == j) for i in range(self.joints)]))

    def velocities(self, known: Mapping[str, Any]) -> list[Any]:
        return self.slopes(self.moving(known))

    def accelerations(self, known: Mapping[str, Any]) -> list[Any]:
        """Those at constant rates."""
        return [dual(velocity).slope for velocity in self.velocities(self.moving(known))]


def functions_of(arm: Any, given: set[str]) -> list[Function]:
    """Functions that follow from the mass points of an arm's class, and are not yet ``given``; none if mass
    points are missing. For every point k they give its velocity ``vx<k> vy<k>``, the derivatives of its
    position by the coordinates, ``X<k>1 .. Y<k>1 ..``, and its acceleration at constant rates, ``Xdqd<k>
    Ydqd<k>``."""
    points = Points(arm)
    if not given.issuperset(points.positions):
        return []
    masses, n = points.count, points.joints
    tip = [f"{axis}{masses}{j + 1}" for axis in "XY" for j in range(n)]
    turning = [f"{axis}dqd{k + 1}" for axis in "XY" for k in range(masses)]
    made = {
        "J11": identity(entries("J", 2, n), tip),
        "Jdqd1": identity(("Jdqd1", "Jdqd2"), (f"Xdqd{masses}", f"Ydqd{masses}")),
        "M11": mass_matrix(masses, n), "h1": forces("h{}", masses, n, turning),
        "G1": forces("G{}", masses, n, ("ax", "ay")), "Lz": angular_momentum(masses),
        "C11": coriolis_matrix(points),
    }  # fmt: skip
    pose = [*points.pose, *points.numbers]
    moving, ends = [*pose, *points.rates], points.positions
    motion = [_named([f"v{p}" for p in ends], moving, points.velocities, given)]
    for j in range(n):
        of_column = functools.partial(points.column, j=j)
        motion.append(_named([f"{p.upper()}{j + 1}" for p in ends], pose, of_column, given))
    motion.append(_named([f"{p[0].upper()}dqd{p[1:]}" for p in ends], moving, points.accelerations, given))
    return [*(f for f in motion if gives_of(f)), *(f for name, f in made.items() if name not in given)]


def _named(
    gives: Sequence[str], takes: Sequence[str], function: Callable[[Mapping[str, Any]], list[Any]],
    given: Collection[str],
) -> Function:  # fmt: skip
    """A dialect function from one that takes its arguments by name, without results already ``given``."""
    wanted = [i for i, name in enumerate(gives) if name not in given]

    @physics(gives=[gives[i] for i in wanted], takes=takes)
    def motion_of_points(*values):
        results = function(dict(zip(takes, values, strict=True)))
        return tuple(results[i] for i in wanted)

    return motion_of_points


def mass_matrix(masses: int, n: int) -> Function:
    @physics(gives=entries("M", n, n), takes=_masses_and_slopes(masses, n))
    def mass_matrix(*values):
        """The sum of m_k J_k^T J_k."""
        m, X, Y = _by_point(values, masses, n)
        M = [[0.0] * n for _ in range(n)]
        for i, j in itertools.combinations_with_replacement(range(n), 2):
            squares = [_sum((times(x[i], x[j]), times(y[i], y[j]))) for x, y in zip(X, Y, strict=True)]
            M[i][j] = M[j][i] = _sum(_scaled(m, squares))
        return tuple(itertools.chain(*M))

    return mass_matrix


def forces(form: str, masses: int, n: int, accelerations: Sequence[str]) -> Function:
    """The forces of accelerations (x of all points, then y), or of one that all points have."""
    count = len(accelerations) // 2

    @physics(gives=numbered(form, n), takes=(*_masses_and_slopes(masses, n), *accelerations))
    def forces(*values):
        """The sum of J_k^T m_k a_k."""
        m, X, Y = _by_point(values[: -2 * count], masses, n)
        along = [_scaled(m, a * (masses // count)) for a in rows(values[-2 * count :], count)]
        return tuple(_sum(_scaled(column, (*along[0], *along[1]))) for column in zip(*X, *Y, strict=True))

    return forces


def coriolis_matrix(points: Points) -> Function:
    n, size = points.joints, 2 * points.count
    columns = [f"{p.upper()}{j + 1}" for j in range(n) for p in points.positions]
    takes = [*points.pose, *points.numbers, *points.rates, *columns]

    @physics(gives=entries("C", n, n), takes=takes)
    def coriolis_matrix(*values):
        """The sum of J_k^T m_k J_k', which is the Christoffel form."""
        known = dict(zip(takes, values, strict=True))
        moving, m = points.moving(known), [known[points.masses[k // 2]] for k in range(size)]
        forces = [_scaled(m, [dual(x).slope for x in points.column(moving, j)]) for j in range(n)]
        slopes = rows(values[len(values) - n * size :], size)
        return tuple(_sum(_scaled(column, f)) for column in slopes for f in forces)

    return coriolis_matrix


def angular_momentum(masses: int) -> Function:
    names = [f"{form}{k + 1}" for form in ("m", "x", "y", "vx", "vy") for k in range(masses)]

    @physics(gives="Lz", takes=names)
    def angular_momentum(*values):
        """The sum of m_k (x_k vy_k - y_k vx_k), about the base."""
        m, x, y, vx, vy = rows(values, masses)
        return _sum(_scaled(m, [_sum((times(x[k], vy[k]), -times(y[k], vx[k]))) for k in range(masses)]))

    return angular_momentum


def _masses_and_slopes(masses: int, n: int) -> list[str]:
    return [*numbered("m{}", masses), *entries("X", masses, n), *entries("Y", masses, n)]


def _by_point(values: Sequence[Any], masses: int, n: int) -> tuple[Sequence[Any], list[Any], list[Any]]:
    slopes = rows(values[masses:], n)
    return values[:masses], slopes[:masses], slopes[masses:]


def _scaled(m: Sequence[Any], values: Sequence[Any]) -> list[Any]:
    return [times(mass, value) for mass, value in zip(m, values, strict=True)]


def _sum(terms: Iterable[Any]) -> Any:
    """Without the terms that are 0 in every pose."""
    there = [term for term in terms if not is_zero(term)]
    return total(there) if there else 0.0


# ---- mobilities ------------------------------------------------------------------------------------
#
# Upper bounds of the mobilities of joints in every pose, diag(B^T M^-1 B).
# The mobility of a joint is 1 over the least sum m |v|^2 with which its rate is 1 while the other joints move
# freely. Where the rate is a sum of c_k . v_k over velocities of points in every pose, it is at most the sum
# of |c_k|^2 / m_k, by the inequality of Cauchy and Schwarz. Such sums are found in poses at random, when an
# arm's class is made: two points at a constant distance determine the rate of their line, two such lines the
# rate of a joint between them; and points whose velocities along a slider differ by its rate alone determine
# that rate.

Array = NDArray[np.float64]
POSES = 4
EQUAL = 1e-9
"""Numbers of size 1 that differ by less than this in all these poses are the same in every pose."""


class Line(NamedTuple):
    """Two mass points at a constant distance, counted from 1; 0 is the base."""

    near: int
    far: int
    rate: Array  # of its angle: a sum of rates of the coordinates


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


def joint_rates(arm: Any) -> Array:
    """Rates of the joints as sums of those of the coordinates, (joints, coordinates)."""
    n = len(arm.rates)
    rates = dict(zip(arm.rates, np.eye(n), strict=True))
    found = Quantities(rates, tuple(arm.functions), {}).each(numbered("phid{}", n))
    return np.stack(np.broadcast_arrays(*found))


def _lines(where: Array, slopes: Array) -> Iterator[Line]:
    for a, b in itertools.combinations(range(len(where)), 2):
        (x, y), (dx, dy) = where[b] - where[a], slopes[b] - slopes[a]
        square = (x * x + y * y)[:, None]
        stretch = (x[:, None] * dx + y[:, None] * dy) / square
        turn = (x[:, None] * dy - y[:, None] * dx) / square
        if _is_zero(stretch) and _is_zero(turn - turn[0]):
            yield Line(a, b, np.where(np.abs(turn[0]) < EQUAL, 0.0, turn[0]))


def _is_zero(x: Array) -> bool:
    return bool((np.abs(x) < EQUAL).all())


Bound = Callable[[Sequence[Any], Sequence[Any]], Any]
"""A bound from the masses and the distances of all lines."""


def _between(lines: Sequence[Line], row: Array) -> Iterator[Bound]:
    """Bounds of a revolute joint's mobility, from lines that turn with its rate, alone or relative to
    another."""
    alone = [(k,) for k, line in enumerate(lines) if _is_zero(np.abs(line.rate) - np.abs(row))]
    pairs = itertools.permutations(range(len(lines)), 2)
    both = [(i, k) for i, k in pairs if _is_zero(lines[k].rate - lines[i].rate - row)]
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


def _distances(points: Points, known: dict[str, Any], lines: Sequence[Line]) -> list[Any]:
    """Lengths of lines, from the difference of columns of Jacobians, where nothing cancels."""
    pose = dict.fromkeys(points.pose, 0.0) | {c: 1.0 for _, c in points.turning.values()}
    columns = [points.column({**known, **pose}, j) for j in range(points.joints)]
    made = []
    for near, far, rate in lines:
        if not rate.any():  # it never turns, and no joint's rate follows from it
            made.append(0.0)
            continue
        j = int(np.flatnonzero(rate)[-1])
        moved = [0.0, 0.0, *columns[j]]  # the base, and all points
        x, y = (moved[2 * far + axis] - moved[2 * near + axis] for axis in range(2))
        made.append(sqrt(x * x + y * y) / abs(float(rate[j])))
    return made
