"""Equations that follow from the positions of an arm's point masses alone, by differentiating them.

The functions that return ``x1 y1 ...`` are run on numbers with derivatives: along one coordinate they yield
a column of every point's Jacobian, along the rates its velocity, twice along the rates its acceleration at
constant rates. A derivative that is 0 in every pose is the float 0.0, and nothing is computed from it.
Sums over the mass points of these are the mass matrix, the bias forces and the gravity forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from redundant_envs.algebra import gives_of, numbered, physics
from redundant_envs.dual import Dual, dual, is_zero, times
from redundant_envs.quantities import Quantities

Function = Callable[..., Any]


class Points:
    """The mass points of an arm's class as functions of its coordinates.

    Parameters
    ----------
    arm : subclass of Arm
        Its present functions; those that are added later are not used.
    """

    def __init__(self, arm: Any) -> None:
        self.functions, self.sincos = tuple(arm.functions), arm.sincos
        self.coordinates, self.rates = arm.coordinates, arm.rates
        self.count, self.joints = arm.num_masses, len(arm.coordinates)
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

    def slopes(self, known: Mapping[str, Any]) -> list[Any]:
        """Derivatives of all positions, x1 y1 x2 ..., of values that :meth:`along` gave."""
        x = Quantities(known, self.functions, self.sincos)
        return [dual(x[name]).slope for name in self.positions]

    @property
    def positions(self) -> list[str]:
        return [f"{axis}{k + 1}" for k in range(self.count) for axis in "xy"]

    def column(self, known: Mapping[str, Any], j: int) -> list[Any]:
        """Derivatives of all positions by coordinate j, counted from 0."""
        return self.slopes(self.along(known, [float(i == j) for i in range(self.joints)]))


def functions_of(arm: Any, given: set[str]) -> list[Function]:
    """Functions that follow from the mass points of an arm's class, and are not yet ``given``; none if mass
    points are missing."""
    points = Points(arm)
    if not given.issuperset(points.positions):
        return []
    masses, n = points.count, points.joints
    made = {
        "J11": jacobian(masses, n), "Jdqd1": jacobian_dot_qd(masses), "M11": mass_matrix(masses, n),
        "h1": bias_forces(masses, n), "G1": gravity_forces(masses, n), "Lz": angular_momentum(masses),
        "C11": coriolis_matrix(points),
    }  # fmt: skip
    return [*point_motion(points, given), *(f for name, f in made.items() if name not in given)]


def point_motion(points: Points, given: Iterable[str]) -> list[Function]:
    """For every mass point k, counted from 1, its velocity ``vx<k> vy<k>``, the derivatives of its position
    by the coordinates, ``X<k>1 .. Y<k>1 ..``, and its acceleration at constant rates, ``Xdqd<k> Ydqd<k>``;
    except those that the arm has ``given``."""
    known, given = [*points.pose, *points.numbers], set(given)

    def velocities(values: Mapping[str, Any]) -> list[Any]:
        return points.slopes(points.along(values, [values[rate] for rate in points.rates]))

    def accelerations(values: Mapping[str, Any]) -> list[Any]:
        rates = [values[rate] for rate in points.rates]
        twice = points.slopes(points.along(points.along(values, rates), rates))
        return [dual(velocity).slope for velocity in twice]

    def column(j: int) -> Function:
        def point_jacobian(values: Mapping[str, Any]) -> list[Any]:
            return points.column(values, j)

        return _named([f"{p.upper()}{j + 1}" for p in points.positions], known, point_jacobian, given)

    moving = [*known, *points.rates]
    made = [
        _named([f"v{p}" for p in points.positions], moving, velocities, given),
        *(column(j) for j in range(points.joints)),
        _named([f"{p[0].upper()}dqd{p[1:]}" for p in points.positions], moving, accelerations, given),
    ]
    return [f for f in made if gives_of(f)]


def _named(
    gives: Sequence[str], takes: Sequence[str], function: Callable[[Mapping[str, Any]], list[Any]],
    given: Iterable[str],
) -> Function:  # fmt: skip
    """A dialect function from one that takes its arguments by name; results already ``given`` are left
    out."""
    wanted = [i for i, name in enumerate(gives) if name not in given]

    @physics(gives=" ".join(gives[i] for i in wanted), takes=" ".join(takes))
    def motion_of_points(*values):
        results = function(dict(zip(takes, values, strict=True)))
        return tuple(results[i] for i in wanted)

    return motion_of_points


def mass_matrix(masses: int, n: int) -> Function:
    names = [f"M{i + 1}{j + 1}" for i in range(n) for j in range(n)]

    @physics(gives=" ".join(names), takes=" ".join((*numbered("m{}", masses), *_slopes(masses, n))))
    def mass_matrix(*values):
        """The sum of m_k J_k^T J_k."""
        m, X, Y = _by_point(values, masses, n)
        M = [[0.0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i, n):
                M[i][j] = M[j][i] = _sum(
                    times(m[k], _sum((times(X[k][i], X[k][j]), times(Y[k][i], Y[k][j]))))
                    for k in range(masses)
                )
        return tuple(entry for row in M for entry in row)

    return mass_matrix


def bias_forces(masses: int, n: int) -> Function:
    accelerations = [f"{axis}dqd{k + 1}" for axis in "XY" for k in range(masses)]
    takes = (*numbered("m{}", masses), *_slopes(masses, n), *accelerations)

    @physics(gives=" ".join(numbered("h{}", n)), takes=" ".join(takes))
    def bias_forces(*values):
        """The sum of J_k^T m_k (J_k' qd)."""
        bare, moved = values[: -2 * masses], values[-2 * masses :]
        m, X, Y = _by_point(bare, masses, n)
        fx, fy = (_scaled(m, moved[i * masses : (i + 1) * masses]) for i in range(2))
        return _at_coordinates(X, Y, fx, fy, n)

    return bias_forces


def coriolis_matrix(points: Points) -> Function:
    masses, n = points.count, points.joints
    columns = [f"{p.upper()}{j + 1}" for j in range(n) for p in points.positions]
    takes = [*points.pose, *points.numbers, *points.rates, *columns]

    @physics(gives=" ".join(f"C{i + 1}{j + 1}" for i in range(n) for j in range(n)), takes=" ".join(takes))
    def coriolis_matrix(*values):
        """The sum of J_k^T m_k J_k', which is the Christoffel form."""
        known, size = dict(zip(takes, values, strict=True)), 2 * masses
        moving = points.along(known, [known[rate] for rate in points.rates])
        slopes = values[len(values) - n * size :]
        columns = [slopes[j * size : (j + 1) * size] for j in range(n)]
        m = [known[points.masses[k // 2]] for k in range(size)]
        forces = [_scaled(m, [dual(x).slope for x in points.column(moving, j)]) for j in range(n)]
        return tuple(
            _sum(times(x, f) for x, f in zip(columns[i], forces[j], strict=True))
            for i in range(n)
            for j in range(n)
        )

    return coriolis_matrix


def gravity_forces(masses: int, n: int) -> Function:
    takes = (*numbered("m{}", masses), *_slopes(masses, n), "ax", "ay")

    @physics(gives=" ".join(numbered("G{}", n)), takes=" ".join(takes))
    def gravity_forces(*values):
        """The sum of J_k^T m_k (ax, ay)."""
        *bare, ax, ay = values
        m, X, Y = _by_point(bare, masses, n)
        return _at_coordinates(X, Y, _scaled(m, [ax] * masses), _scaled(m, [ay] * masses), n)

    return gravity_forces


def jacobian(masses: int, n: int) -> Function:
    columns = [f"{axis}{masses}{j + 1}" for axis in "XY" for j in range(n)]

    @physics(gives=" ".join(f"J{i}{j + 1}" for i in (1, 2) for j in range(n)), takes=" ".join(columns))
    def jacobian(*columns):
        """For the last mass point, the tip."""
        return columns

    return jacobian


def jacobian_dot_qd(masses: int) -> Function:
    @physics(gives="Jdqd1 Jdqd2", takes=f"Xdqd{masses} Ydqd{masses}")
    def jacobian_dot_qd(x, y):
        return x, y

    return jacobian_dot_qd


def angular_momentum(masses: int) -> Function:
    names = [f"{form}{k + 1}" for form in ("m", "x", "y", "vx", "vy") for k in range(masses)]

    @physics(gives="Lz", takes=" ".join(names))
    def angular_momentum(*values):
        """The sum of m_k (x_k vy_k - y_k vx_k), about the base."""
        m, x, y, vx, vy = (values[i * masses : (i + 1) * masses] for i in range(5))
        moments = [_sum((times(x[k], vy[k]), -times(y[k], vx[k]))) for k in range(masses)]
        return _sum(_scaled(m, moments))

    return angular_momentum


def _slopes(masses: int, n: int) -> list[str]:
    return [f"{axis}{k + 1}{j + 1}" for axis in "XY" for k in range(masses) for j in range(n)]


def _by_point(values: Sequence[Any], masses: int, n: int) -> tuple[Sequence[Any], list[Any], list[Any]]:
    m, rows = values[:masses], [values[masses + i * n : masses + (i + 1) * n] for i in range(2 * masses)]
    return m, rows[:masses], rows[masses:]


def _scaled(m: Sequence[Any], values: Sequence[Any]) -> list[Any]:
    return [times(mass, value) for mass, value in zip(m, values, strict=True)]


def _at_coordinates(X: Sequence[Any], Y: Sequence[Any], fx: Sequence[Any], fy: Sequence[Any], n: int) -> Any:
    """J^T f, summed over the points."""
    points = range(len(X))
    return tuple(
        _sum((*(times(X[k][j], fx[k]) for k in points), *(times(Y[k][j], fy[k]) for k in points)))
        for j in range(n)
    )


def _sum(terms: Iterable[Any]) -> Any:
    """Without the terms that are 0 in every pose."""
    there = [term for term in terms if not is_zero(term)]
    return sum(there[1:], there[0]) if there else 0.0
