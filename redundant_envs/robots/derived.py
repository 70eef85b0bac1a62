"""Quantities that follow from the definitions of an arm, for any number of joints.

An arm may compute each of these in a better form, as the arms of this package do.
"""

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.language.algebra import entries, numbered, physics, sqrt, total, where
from redundant_envs.language.quantities import Function, Quantities

Array = NDArray[np.float64]
WHOLE = 1e-12
"""A share of a rate that is nearer than this to a whole number is that number."""


def identity(gives: Sequence[str], takes: Sequence[str]) -> Function:
    """The same values under other names."""

    @physics(gives=gives, takes=takes)
    def identity(*values):
        return values

    return identity


def functions_of(arm: Any, existing: set[str]) -> list[Function]:
    """Functions that follow from the mass points, the Jacobian, the mass matrix and the forces of an arm's
    class, and are not yet ``existing``."""
    n, last = len(arm.coordinates), arm.num_masses
    functions = {
        "tip_x": identity(("tip_x", "tip_y"), (f"x{last}", f"y{last}")),  # report 1.2.1 and 2.2.1
        "tip_vx": tip_velocity(arm.rates), "manipulability": manipulability(n),
        "U": potential_energy(last), "T": kinetic_energy(arm.rates), "qdd1": forward_dynamics(n),
    }  # fmt: skip
    return [function for name, function in functions.items() if name not in existing]


def following(function: Function) -> Function:
    """Mark a function as derived, not defined by the arm."""
    function.follows = True  # type: ignore[attr-defined]
    return function


def follows(function: Function) -> bool:
    """Whether a function was derived from other functions of an arm."""
    return getattr(function, "follows", False)


def is_derived(function: Function) -> bool:
    """Whether a function was made here, from matrices and Jacobians, which effects may change."""
    return getattr(function, "__module__", None) == __name__


def tip_velocity(rates: Sequence[str]) -> Function:
    n = len(rates)

    @physics(gives="tip_vx tip_vy", takes=(*entries("J", 2, n), *rates))
    def tip_velocity(*values):
        """J qd: report eq. (2) and (5)."""
        return _dot(values[:n], values[2 * n :]), _dot(values[n : 2 * n], values[2 * n :])

    return tip_velocity


def potential_energy(masses: int) -> Function:
    names = [f"{letter}{k + 1}" for letter in "mxy" for k in range(masses)]

    @physics(gives="U", takes=(*names, "ax", "ay"))
    def potential_energy(*values):
        """Report 1.1 and 2.1, PE, in any uniform field."""
        *masses_and_points, ax, ay = values
        m, x, y = rows(masses_and_points, masses)
        return _dot(m, [ax * p + ay * q for p, q in zip(x, y, strict=True)])

    return potential_energy


def manipulability(n: int) -> Function:
    @physics(gives="manipulability", takes=entries("J", 2, n))
    def manipulability(*jacobian):
        """sqrt(det J J^T), a sum of squares by the theorem of Binet and Cauchy."""
        x, y = jacobian[:n], jacobian[n:]
        if n == 1:
            return 0.0
        minors = [x[i] * y[j] - x[j] * y[i] for i, j in itertools.combinations(range(n), 2)]
        return sqrt(_dot(minors, minors))

    return manipulability


def column_norms(n: int) -> Function:
    @physics(gives=numbered("n{}", n), takes=entries("J", 2, n))
    def column_norms(*jacobian):
        """Metres at the tip per unit of each coordinate."""
        return tuple(sqrt(x * x + y * y) for x, y in zip(jacobian[:n], jacobian[n:], strict=True))

    return column_norms


def kinetic_energy(rates: Sequence[str]) -> Function:
    n = len(rates)

    @physics(gives="T", takes=(*entries("M", n, n), *rates))
    def kinetic_energy(*values):
        M, qd = rows(values[: n * n], n), values[n * n :]
        return 0.5 * _dot(qd, [_dot(row, qd) for row in M])

    return kinetic_energy


def forward_dynamics(n: int, sliders: Sequence[int] = ()) -> Function:
    """Accelerations, while sliders with held > 0 rest on their links, and the forces that hold these [N]."""
    held, hold = ([f"{name}{k + 1}" for k in sliders] for name in ("held", "hold"))

    @physics(gives=(*numbered("qdd{}", n), *hold), takes=(*_of_motion(n), *held))
    def forward_dynamics(*values):
        """M qdd = Q - h - G, by L D L^T."""
        M, forces, flags = _system(values, n)
        rests = dict(zip(sliders, (flag > 0.0 for flag in flags), strict=True))
        left = [[*row] for row in M]
        for i, j in itertools.product(range(n), range(n)):
            left[i][j] = _unless(rests.get(i), _unless(rests.get(j), M[i][j], float(i == j)), float(i == j))
        qdd = solved(left, [_unless(rests.get(i), f, 0.0) for i, f in enumerate(forces)])
        return (*qdd, *(_dot(M[k], qdd) - forces[k] for k in sliders))

    return forward_dynamics


@functools.lru_cache(maxsize=64)
def held_joint_dynamics(arm: Any, joints: tuple[int, ...]) -> Function:
    """Accelerations of the coordinates of an arm's class while joints with held > 0 keep their rates, the
    accelerations of these joints, and the forces that hold them [N m or N].

    With the rates of the joints u and qd = T u, the mass matrix of the joints is T^T M T and the forces on
    them are T^T (Q - h - G). Held joints are left out of that system. The coordinates of a held joint have
    accelerations that are equal to the last bit, so that its rate stays exactly 0 where it was.
    """
    n, T = len(arm.coordinates), coordinate_rates(arm)
    gives = [*numbered("qdd{}", n), *(f"{name}{k + 1}" for name in ("alpha", "hold") for k in joints)]

    @physics(gives=gives, takes=(*_of_motion(n), *(f"held{k + 1}" for k in joints)))
    def held_joint_dynamics(*values):
        """T^T M T a = T^T (Q - h - G), by L D L^T, and qdd = T a."""
        M, forces, flags = _system(values, n)
        forces = _summed(T.T, forces)
        half = [_summed(T.T, row) for row in M]  # M T, row by row
        of_joints = [_summed(T.T, column) for column in zip(*half, strict=True)]
        rests = dict(zip(joints, (flag > 0.0 for flag in flags), strict=True))
        left = [[*row] for row in of_joints]
        for i, j in itertools.product(range(n), range(n)):
            for k in {i, j} & rests.keys():
                left[i][j] = where(rests[k], float(i == j), left[i][j])
        alpha = solved(left, [_unless(rests.get(k), f, 0.0) for k, f in enumerate(forces)])
        hold = [_dot(of_joints[k], alpha) - forces[k] for k in joints]
        return (*_summed(T, alpha), *(alpha[k] for k in joints), *hold)

    return held_joint_dynamics


def _of_motion(n: int) -> list[str]:
    return [*entries("M", n, n), *(f"{letter}{k + 1}" for letter in "hGQ" for k in range(n))]


def _system(values: Sequence[Any], n: int) -> tuple[list[Sequence[Any]], list[Any], Sequence[Any]]:
    """M and Q - h - G, of values of these names, and the values behind them."""
    h, G, Q = rows(values[n * n : n * n + 3 * n], n)
    forces = [q - a - b for q, a, b in zip(Q, h, G, strict=True)]
    return rows(values[: n * n], n), forces, values[n * n + 3 * n :]


def _summed(matrix: Array, terms: Sequence[Any]) -> list[Any]:
    """A matrix of small whole numbers times terms, each sum from left to right."""
    pairs = ([(float(s), t) for s, t in zip(row, terms, strict=True) if s != 0.0] for row in matrix)
    return [total(t if share == 1.0 else share * t for share, t in row) for row in pairs]


def joint_rates(arm: Any) -> Array:
    """Rates of the joints as sums of those of the coordinates, (joints, coordinates)."""
    n = len(arm.rates)
    rates = dict(zip(arm.rates, np.eye(n), strict=True))
    values = Quantities(rates, tuple(arm.functions), {}).each(numbered("phid{}", n))
    return np.stack(np.broadcast_arrays(*values))


def coordinate_rates(arm: Any) -> Array:
    """Rates of the coordinates as sums of those of the joints, (coordinates, joints)."""
    exact = np.linalg.inv(joint_rates(arm))
    whole = exact.round()
    return np.asarray(np.where(np.abs(exact - whole) < WHOLE, whole, exact), dtype=np.float64)


def slider_mobility(n: int, sliders: Sequence[int]) -> Function:
    """Columns of M^-1: the change of the velocities by a unit impulse along each slider."""

    @physics(gives=[f"W{i + 1}{k + 1}" for k in sliders for i in range(n)], takes=entries("M", n, n))
    def slider_mobility(*matrix):
        columns = (solved(rows(matrix, n), [float(i == k) for i in range(n)]) for k in sliders)
        return tuple(itertools.chain.from_iterable(columns))

    return slider_mobility


def solved(matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
    """x of matrix x = right, for a symmetric and positive definite matrix: L D L^T, without pivoting."""
    n = len(right)
    L = [[0.0] * n for _ in range(n)]
    pivots: list[Any] = []
    for j in range(n):
        shares = [L[j][k] * pivots[k] for k in range(j)]
        pivots.append(matrix[j][j] - _dot(L[j][:j], shares) if j else matrix[j][j])
        for i in range(j + 1, n):
            L[i][j] = (matrix[i][j] - _dot(L[i][:j], shares) if j else matrix[i][j]) / pivots[j]
    x = list(right)
    for i in range(1, n):
        x[i] = x[i] - _dot(L[i][:i], x[:i])
    x = [value / pivot for value, pivot in zip(x, pivots, strict=True)]
    for i in reversed(range(n - 1)):
        x[i] = x[i] - _dot([L[j][i] for j in range(i + 1, n)], x[i + 1 :])
    return x


def _unless(condition: Any, value: Any, otherwise: float) -> Any:
    """A value, or another where a condition holds; None never does."""
    return value if condition is None else where(condition, otherwise, value)


def rows(values: Sequence[Any], length: int) -> list[Sequence[Any]]:
    """Values in rows of a length."""
    return [values[i : i + length] for i in range(0, len(values), length)]


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return total(x * y for x, y in zip(a, b, strict=True))
