"""Equations that follow from the positions of an arm's point masses alone, by differentiating them.

The functions that return ``x1 y1 ...`` are run on numbers with derivatives: along one coordinate they yield
a column of every point's Jacobian, along the rates its velocity, twice along the rates its acceleration at
constant rates. A derivative that is 0 in every pose is the float 0.0, and nothing is computed from it.
Sums over the mass points of these are the mass matrix, the bias forces and the gravity forces.
"""

import functools
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from redundant_envs.language.algebra import entries, gives_of, numbered, physics, total
from redundant_envs.language.dual import Dual, dual, is_zero, times
from redundant_envs.language.quantities import Function, Quantities
from redundant_envs.robots.derived import identity, rows


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
        values = {**known, **{q: Dual(known[q], slope) for q, slope in moving.items()}}
        for angle, (s, c) in self.turning.items():
            values[s] = Dual(known[s], times(known[c], moving[angle]))
            values[c] = Dual(known[c], times(-known[s], moving[angle]))
        return values

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


def functions_of(arm: Any, existing: set[str]) -> list[Function]:
    """Functions that follow from the mass points of an arm's class, and are not yet ``existing``; none if
    mass points are missing. For every point k they give its velocity ``vx<k> vy<k>``, the derivatives of its
    position by the coordinates, ``X<k>1 .. Y<k>1 ..``, and its acceleration at constant rates, ``Xdqd<k>
    Ydqd<k>``."""
    points = Points(arm)
    if not existing.issuperset(points.positions):
        return []
    masses, n = points.count, points.joints
    tip = [f"{axis}{masses}{j + 1}" for axis in "XY" for j in range(n)]
    turning = [f"{axis}dqd{k + 1}" for axis in "XY" for k in range(masses)]
    by_name = {
        "J11": identity(entries("J", 2, n), tip),
        "Jdqd1": identity(("Jdqd1", "Jdqd2"), (f"Xdqd{masses}", f"Ydqd{masses}")),
        "M11": mass_matrix(masses, n), "h1": forces("h{}", masses, n, turning),
        "G1": forces("G{}", masses, n, ("ax", "ay")), "Lz": angular_momentum(masses),
        "C11": coriolis_matrix(points),
    }  # fmt: skip
    pose = [*points.pose, *points.numbers]
    moving, ends = [*pose, *points.rates], points.positions
    motion = [_named([f"v{p}" for p in ends], moving, points.velocities, existing)]
    for j in range(n):
        of_column = functools.partial(points.column, j=j)
        motion.append(_named([f"{p.upper()}{j + 1}" for p in ends], pose, of_column, existing))
    motion.append(_named([f"{p[0].upper()}dqd{p[1:]}" for p in ends], moving, points.accelerations, existing))
    return [*(f for f in motion if gives_of(f)), *(f for name, f in by_name.items() if name not in existing)]


def _named(
    gives: Sequence[str], takes: Sequence[str], function: Callable[[Mapping[str, Any]], list[Any]],
    existing: Collection[str],
) -> Function:  # fmt: skip
    """A dialect function from one that takes its arguments by name, without results already ``existing``."""
    wanted = [i for i, name in enumerate(gives) if name not in existing]

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
