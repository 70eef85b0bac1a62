"""The arms as users hold them: every quantity of the model on batches of states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs import scene
from redundant_envs.backends.numpy import evaluate
from redundant_envs.extras import needs
from redundant_envs.robots.four_r import FourRArm
from redundant_envs.robots.parameters import Arm
from redundant_envs.robots.rprp import RPRPArm

Array = NDArray[np.float64]


class ModelFunctions(Arm):
    """Numerical faces of the equations; ``...`` is any batch shape, arguments broadcast."""

    def _values(self, g: float, vectors: Mapping[str, ArrayLike]) -> dict[str, Any]:
        names = {
            "q": self.coordinates,
            "qd": self.rates,
            "Q": ("Q1", "Q2", "Q3", "Q4"),
        }
        values: dict[str, Any] = {**self.parameter_values(), "ax": 0.0, "ay": float(g)}
        for key, vector in vectors.items():
            array = np.asarray(vector, dtype=np.float64)
            if array.shape[-1:] != (4,):
                raise ValueError(f"{key} has shape {array.shape}; the last axis must have 4 entries")
            values.update({n: array[..., k] for k, n in enumerate(names[key])})
        return values

    def _vector(self, names: str, g: float = 0.0, **vectors: ArrayLike) -> Array:
        parts = evaluate(self, names.split(), self._values(g, vectors))
        shape = np.broadcast_shapes(*(np.shape(v)[:-1] for v in vectors.values()))
        return np.stack([np.broadcast_to(p, shape) for p in parts], axis=-1)

    def _matrix(self, letter: str, rows: int, **vectors: ArrayLike) -> Array:
        names = " ".join(f"{letter}{i}{j}" for i in range(1, rows + 1) for j in range(1, 5))
        flat = self._vector(names, 0.0, **vectors)
        return flat.reshape(*flat.shape[:-1], rows, 4)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M(q), (..., 4, 4): kg m^2, kg m or kg."""
        return self._matrix("M", 4, q=q)

    def bias_forces(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """h(q, qd), (..., 4): Coriolis and centrifugal forces without gravity, N m or N."""
        return self._vector("h1 h2 h3 h4", q=q, qd=qd)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd), (..., 4, 4), in Christoffel form: C qd = h, M' = C + C^T."""
        return self._matrix("C", 4, q=q, qd=qd)

    def gravity_forces(self, q: ArrayLike, g: float = 9.81) -> Array:
        """G(q) = dU/dq, (..., 4), N m or N; gravity along -y."""
        return self._vector("G1 G2 G3 G4", g, q=q)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, Q: ArrayLike, g: float = 9.81) -> Array:
        """qdd from generalized forces Q, (..., 4), by the O(n) elimination."""
        return self._vector("qdd1 qdd2 qdd3 qdd4", g, q=q, qd=qd, Q=Q)

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, g: float = 9.81) -> Array:
        """Q = M qdd + h + G, (..., 4), N m or N."""
        acceleration = np.asarray(qdd, dtype=np.float64)
        if acceleration.shape[-1:] != (4,):
            raise ValueError(f"qdd has shape {acceleration.shape}; the last axis must have 4 entries")
        inertial = np.einsum("...ij,...j->...i", self.mass_matrix(q), acceleration)
        return inertial + self.bias_forces(q, qd) + self.gravity_forces(q, g)

    def points(self, q: ArrayLike) -> Array:
        """Positions of the four mass points, (..., 4, 2), m."""
        flat = self._vector("x1 y1 x2 y2 x3 y3 x4 y4", q=q)
        return flat.reshape(*flat.shape[:-1], 4, 2)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Tip position, (..., 2), m."""
        return self._vector("tip_x tip_y", q=q)

    def jacobian(self, q: ArrayLike) -> Array:
        """J(q) of the tip, (..., 2, 4): m/rad or 1."""
        return self._matrix("J", 2, q=q)

    def jacobian_dot_qd(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """J'(q, qd) qd, (..., 2), m/s^2."""
        return self._vector("Jdqd1 Jdqd2", q=q, qd=qd)

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """T, (...), J."""
        return self._vector("T", q=q, qd=qd)[..., 0]

    def potential_energy(self, q: ArrayLike, g: float = 9.81) -> Array:
        """U, (...), J; zero at the height of the base."""
        return self._vector("U", g, q=q)[..., 0]

    def angular_momentum(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """About the base, (...), kg m^2/s."""
        return self._vector("Lz", q=q, qd=qd)[..., 0]

    def manipulability(self, q: ArrayLike) -> Array:
        """sqrt(det J J^T), (...)."""
        return self._vector("manipulability", q=q)[..., 0]

    @property
    def motor_map(self) -> Array:
        """B, (4, 4): generalized forces Q = B t of joint efforts t."""
        columns = []
        for k in range(4):
            t = {f"t{i + 1}": float(i == k) for i in range(4)}
            columns.append(evaluate(self, ("Q1", "Q2", "Q3", "Q4"), t))
        return np.array(columns, dtype=np.float64).T

    def symbols(self) -> dict[str, Any]:
        """sympy expressions of the same text.

        Returns
        -------
        dict
            "q", "qd", "Q", "parameters" (symbols); "M", "C", "J" (Matrix); "h", "G", "qdd",
            "tip", "Jdot_qd" (column Matrix); "T", "U", "Lz", "manipulability" (expressions).
        """
        with needs("verify"):
            import sympy as sp
        import redundant_envs.backends.sympy  # noqa: F401 - lets expressions be numbers

        def make(names: Any) -> dict[str, Any]:
            return {n: sp.Symbol(n, real=True) for n in names}

        parameters = {n: sp.Symbol(n, positive=True) for n in self.parameter_values()}
        q, qd = make(self.coordinates), make(self.rates)
        forces = make(("Q1", "Q2", "Q3", "Q4"))
        field = {"ax": sp.Integer(0), "ay": sp.Symbol("g", real=True)}
        state = {**parameters, **q, **qd, **field}

        def get(names: str, extra: dict[str, Any] | None = None) -> list[Any]:
            return evaluate(self, names.split(), {**state, **(extra or {})})

        def matrix(letter: str, rows: int) -> Any:
            names = " ".join(f"{letter}{i}{j}" for i in range(1, rows + 1) for j in range(1, 5))
            return sp.Matrix(rows, 4, get(names))

        return {
            "q": list(q.values()),
            "qd": list(qd.values()),
            "Q": list(forces.values()),
            "parameters": {**parameters, "g": field["ay"]},
            "M": matrix("M", 4),
            "C": matrix("C", 4),
            "J": matrix("J", 2),
            "h": sp.Matrix(get("h1 h2 h3 h4")),
            "G": sp.Matrix(get("G1 G2 G3 G4")),
            "qdd": sp.Matrix(get("qdd1 qdd2 qdd3 qdd4", forces)),
            "tip": sp.Matrix(get("tip_x tip_y")),
            "Jdot_qd": sp.Matrix(get("Jdqd1 Jdqd2")),
            "T": get("T")[0],
            "U": get("U")[0],
            "Lz": get("Lz")[0],
            "manipulability": get("manipulability")[0],
        }


@dataclass(frozen=True)
class RPRP(ModelFunctions, RPRPArm):
    """Revolute-prismatic-revolute-prismatic arm, q = (theta1, r1, theta2, r2).

    Parameters
    ----------
    masses : 4 floats
        Point masses at l1, l1 + r1, and (beyond the second joint) l2, l2 + r2, kg.
    lengths : (float, float)
        l1, l2, m.
    """


@dataclass(frozen=True)
class FourR(ModelFunctions, FourRArm):
    """Arm of four revolute joints, q = (theta1, ..., theta4), absolute angles.

    Parameters
    ----------
    masses : 4 floats
        Point masses at the link ends, kg.
    lengths : 4 floats
        m.
    """


scene.ARMS.update({"RPRP": RPRP, "FourR": FourR})
