"""An arm: its equations as functions that find each other by name, and methods that evaluate them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import FunctionType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.language.algebra import entries, gives_of, numbered
from redundant_envs.language.quantities import Function, Quantities
from redundant_envs.robots import checks, derived, drawn, from_points, joint_types, mobility
from redundant_envs.robots.parameters import positive_numbers
from redundant_envs.support.extras import needs
from redundant_envs.support.notebook import as_html
from redundant_envs.support.values import Numbers, shown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """A planar arm of point masses, with 1 to 10 joints; its classes are frozen dataclasses, too.

    A subclass names the types of its joints and has a function of the physics dialect for the positions of
    its point masses, ``x1 y1 x2 ...``, the last of them at the tip::

        @physics(gives="x1 y1 x2 y2")
        def points(l1, l2, s1, c1, s2, c2):
            x1, y1 = l1 * c1, l1 * s1
            return x1, y1, x1 + l2 * c2, y1 + l2 * s2

        class DoublePendulum(Arm):
            joint_types = "RR"
            functions = (points,)

    Its coordinates then are ``theta1 theta2 ...`` of revolute joints, absolute angles from +x with the rates
    ``w1 ..``, the sines ``s1 ..`` and the cosines ``c1 ..``, and ``r1 ..`` of sliders, with the rates ``v1
    ..``. Without functions the masses are at the ends of links and sliders (:class:`~redundant_envs.Chain`).

    The rest follows by differentiation, with the mobility bounds. A function may compute any of it in a
    better form: the Jacobian ``J11 .. J2n`` of the tip, ``Jdqd1 Jdqd2``, the mass matrix ``M11 .. Mnn``, the
    bias forces ``h1 .. hn``, the Coriolis matrix ``C11 .. Cnn``, in the field (ax, ay) the gravity forces
    ``G1 .. Gn``, the accelerations ``qdd1 ..``, ``T``, ``U``, ``Lz``, ``manipulability``. Functions of the
    position alone must not return quantities that depend on rates. ``python -m redundant_envs verify``
    compares such forms with the point masses.

    An arm with other coordinates names them, ``coordinates``, ``rates``, ``joints``, ``prismatic``,
    ``sincos`` and ``num_lengths``, instead of ``joint_types``. If they are not those of the joints it
    computes ``phi1 ..``, ``phid1 ..``, ``Q1 ..`` from ``t1 ..``, each by a function of its own, and
    ``coordinates_of_joints``. (ax, ay) is minus the gravity vector [m/s^2].

    Parameters
    ----------
    masses : sequence of floats
        Point masses, kg, positive.
    lengths : sequence of floats
        Link lengths, m, positive.

    Attributes
    ----------
    A subclass sets them in its body. What has no default here follows from ``joint_types``, or from what else
    the class says.

    joint_types : str
        Types of the joints from base to tip, R or P each, of an arm that does not name its coordinates.
    functions : tuple of functions
        The quantities of the model: functions of the physics dialect, found by what they give.
    kind : str, default the name of the class
        Name of the arm in scene files.
    units : mapping of str to str, default {"masses": "kg", "lengths": "m"}
        Units of the numbers of an arm.
    num_masses, num_lengths : int
        Point masses, by default as many as joints, and links.
    coordinates, rates : tuple of str
        Names of the generalized coordinates and velocities in the equations.
    joints : tuple of str
        Names of the joints, as users write them (``LimitSpring("r1", ...)``).
    prismatic : tuple of bool
        Whether each joint slides.
    sincos : dict of str to (str, str)
        Angle quantity -> names of its sine and cosine.
    prepared : tuple of functions, default ()
        Functions of the parameters alone, evaluated when a parameter is set, not in the step.
    column_norms : function
        ``n1 .. nn``: metres at the tip per unit of each coordinate.
    mobility_bounds : function or None
        ``W1 .. Wn`` of the parameters: upper bounds of diag(B^T M^-1 B) in every pose, from which error
        control knows how fast springs and dampers may make the arm. None, where the point masses do not show
        them, allows neither with a tolerance.
    held_dynamics, slider_mobility : function or None
        Dynamics with sliders at rest, and columns of M^-1, of the sliders; None of an arm without sliders.
    coordinates_of_joints : function
        The coordinates from the positions of the joints, ``phi1 ..``.
    extent : tuple of str
        Lengths and upper ends of sliders (``high2``) whose sum is the full reach, from base to tip.
    posture : dict of str to str
        Quantities that tell where the revolute joints are, bounded by 1, and what they mean.
    description : str, default "A planar arm in a vertical plane"
        Beginning of the page of its environments.
    schematic : str, default ""
        The arm stretched along +x, drawn in text, with its coordinates, masses and lengths.
    """

    masses: Numbers
    lengths: Numbers

    units: ClassVar[Mapping[str, str]] = {"masses": "kg", "lengths": "m"}
    _derived: ClassVar[frozenset[str]] = frozenset()  # names of what the class has without having said it
    kind: ClassVar[str]
    joint_types: ClassVar[str]
    num_masses: ClassVar[int]
    num_lengths: ClassVar[int]
    coordinates: ClassVar[tuple[str, ...]]
    rates: ClassVar[tuple[str, ...]]
    joints: ClassVar[tuple[str, ...]]
    prismatic: ClassVar[tuple[bool, ...]]
    sincos: ClassVar[dict[str, tuple[str, str]]]
    functions: ClassVar[tuple[Function, ...]]
    prepared: ClassVar[tuple[Function, ...]] = ()
    column_norms: ClassVar[Function]
    mobility_bounds: ClassVar[Function | None] = None
    held_dynamics: ClassVar[Function | None] = None
    slider_mobility: ClassVar[Function | None] = None
    coordinates_of_joints: ClassVar[Function]
    extent: ClassVar[tuple[str, ...]]
    posture: ClassVar[dict[str, str]]
    description: ClassVar[str] = "A planar arm in a vertical plane"
    schematic: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Add everything that follows from the definitions of the class, and refuse an incomplete class."""
        super().__init_subclass__()
        checks.check_class(cls)
        if not {"functions", "joint_types"} & cls.__dict__.keys():
            return
        cls._derived = cls._derived - cls.__dict__.keys()
        cls.functions = tuple(f for f in getattr(cls, "functions", ()) if not derived.follows(f))
        checks.check_functions(cls)
        facts = joint_types.facts_of(cls)
        cls._set_defaults(facts)
        checks.check_joints(cls)
        for name in checks.FUNCTIONS:
            if isinstance(function := vars(cls).get(name), FunctionType):
                setattr(cls, name, staticmethod(function))
        cls._set_defaults({**_defaults(cls), **facts})
        if facts:
            cls._follow(joint_types.functions_of(cls.joint_types, cls.sincos, cls._given()))
            cls._set_defaults({"coordinates_of_joints": joint_types.coordinates_of_joints(cls.joint_types)})
        elif "phi1" not in cls._given():
            n = len(cls.coordinates)
            same = {"phi{}": cls.coordinates, "phid{}": cls.rates, "Q{}": numbered("t{}", n)}
            cls._follow(derived.identity(numbered(form, n), taken) for form, taken in same.items())
            back = derived.identity(cls.coordinates, numbered("phi{}", n))
            cls._set_defaults({"coordinates_of_joints": back})
        cls._follow(from_points.functions_of(cls, cls._given()))
        cls._follow(derived.functions_of(cls, cls._given()))
        checks.check_quantities(cls)
        if not cls._is_explicit("mobility_bounds"):
            cls._set_defaults({"mobility_bounds": mobility.mobility_bounds(cls)})

    @classmethod
    def _given(cls) -> set[str]:
        return {name for f in cls.functions for name in gives_of(f)}

    @classmethod
    def _follow(cls, functions: Iterable[Function]) -> None:
        """Add functions that follow from the others; a class derived from this one finds its own."""
        cls.functions += tuple(derived.following(f) for f in functions)

    @classmethod
    def _is_explicit(cls, name: str) -> bool:
        return name not in cls._derived and any(name in vars(base) for base in cls.__mro__[:-2])

    @classmethod
    def _set_defaults(cls, facts: Mapping[str, Any]) -> None:
        """Set attributes that neither the class nor a base has defined; each class has its own kind."""
        for name, value in facts.items():
            if not cls._is_explicit(name) or (name == "kind" and name not in cls.__dict__):
                cls._derived |= {name}
                setattr(cls, name, staticmethod(value) if isinstance(value, FunctionType) else value)

    def __post_init__(self) -> None:
        for name, count in (("masses", self.num_masses), ("lengths", self.num_lengths)):
            checked = positive_numbers(name, getattr(self, name), count, Arm.units[name])
            object.__setattr__(self, name, checked)

    def joint_index(self, name: str) -> int:
        """Position of a joint by its name; an unknown name lists the valid ones."""
        if name not in self.joints:
            raise ValueError(f"coordinate is {shown(name)}; {self.kind} has {', '.join(self.joints)}")
        return self.joints.index(name)

    @classmethod
    def sliders(cls) -> list[int]:
        """Joints that are prismatic."""
        return [k for k, slides in enumerate(cls.prismatic) if slides]

    def parameter_values(self) -> dict[str, float]:
        """Values of the parameters m1, m2, ... and l1, ... that the equations name."""
        masses = {f"m{i + 1}": m for i, m in enumerate(self.masses)}
        return masses | {f"l{i + 1}": length for i, length in enumerate(self.lengths)}

    def _repr_html_(self) -> str:
        """A drawing and the numbers, for a notebook."""
        return as_html(self, lambda: drawn.schematic(self), lambda: drawn.numbers(self))

    # ---- evaluation of the equations; ``...`` is any batch shape, arguments broadcast ----------------------

    def evaluate(self, wanted: Iterable[str], values: Mapping[str, Any]) -> list[Any]:
        """Quantities from known ones (numbers, or arrays that broadcast), in the order wanted."""
        return Quantities(values, self.functions, self.sincos).each(wanted)

    def _vector(self, names: Iterable[str], g: float = 0.0, **vectors: ArrayLike) -> Array:
        n = len(self.coordinates)
        meant = {"q": self.coordinates, "qd": self.rates, "Q": numbered("Q{}", n)}
        values: dict[str, Any] = {**self.parameter_values(), "ax": 0.0, "ay": float(g)}
        for key, vector in vectors.items():
            array = np.asarray(vector, dtype=np.float64)
            if array.shape[-1:] != (n,):
                raise ValueError(f"{key} has shape {array.shape}; the last axis must have {n} entries")
            values.update({name: array[..., k] for k, name in enumerate(meant[key])})
        parts = self.evaluate(names, values)
        shape = np.broadcast_shapes(*(np.shape(v)[:-1] for v in vectors.values()))
        return np.stack([np.broadcast_to(p, shape) for p in parts], axis=-1)

    def _numbered(self, letter: str, g: float = 0.0, **vectors: ArrayLike) -> Array:
        return self._vector(numbered(f"{letter}{{}}", len(self.coordinates)), g, **vectors)

    def _matrix(self, letter: str, rows: int, **vectors: ArrayLike) -> Array:
        n = len(self.coordinates)
        flat = self._vector(entries(letter, rows, n), 0.0, **vectors)
        return flat.reshape(*flat.shape[:-1], rows, n)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M(q), (..., n, n): kg m^2, kg m or kg."""
        return self._matrix("M", len(self.coordinates), q=q)

    def bias_forces(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """h(q, qd), (..., n): Coriolis and centrifugal forces without gravity, N m or N."""
        return self._numbered("h", q=q, qd=qd)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd), (..., n, n), in Christoffel form: C qd = h, M' = C + C^T."""
        return self._matrix("C", len(self.coordinates), q=q, qd=qd)

    def gravity_forces(self, q: ArrayLike, g: float = 9.81) -> Array:
        """G(q) = dU/dq, (..., n), N m or N; gravity along -y."""
        return self._numbered("G", g, q=q)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, Q: ArrayLike, g: float = 9.81) -> Array:
        """qdd from generalized forces Q, (..., n): by an O(n) elimination where the arm has one."""
        return self._numbered("qdd", g, q=q, qd=qd, Q=Q)

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, g: float = 9.81) -> Array:
        """Q = M qdd + h + G, (..., n), N m or N."""
        acceleration, n = np.asarray(qdd, dtype=np.float64), len(self.coordinates)
        if acceleration.shape[-1:] != (n,):
            raise ValueError(f"qdd has shape {acceleration.shape}; the last axis must have {n} entries")
        inertial = np.einsum("...ij,...j->...i", self.mass_matrix(q), acceleration)
        return inertial + self.bias_forces(q, qd) + self.gravity_forces(q, g)

    def points(self, q: ArrayLike) -> Array:
        """Positions of the point masses, (..., masses, 2), m."""
        flat = self._vector([f"{axis}{k + 1}" for k in range(self.num_masses) for axis in "xy"], q=q)
        return flat.reshape(*flat.shape[:-1], self.num_masses, 2)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Tip position, (..., 2), m."""
        return self._vector(("tip_x", "tip_y"), q=q)

    def jacobian(self, q: ArrayLike) -> Array:
        """J(q) of the tip, (..., 2, n): m/rad or 1."""
        return self._matrix("J", 2, q=q)

    def jacobian_dot_qd(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """J'(q, qd) qd, (..., 2), m/s^2."""
        return self._vector(("Jdqd1", "Jdqd2"), q=q, qd=qd)

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """T, (...), J."""
        return self._vector("T", q=q, qd=qd)[..., 0]

    def potential_energy(self, q: ArrayLike, g: float = 9.81) -> Array:
        """U, (...), J; zero at the height of the base."""
        return self._vector("U", g, q=q)[..., 0]

    def angular_momentum(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """About the base, (...), kg m^2/s."""
        return self._vector(("Lz",), q=q, qd=qd)[..., 0]

    def manipulability(self, q: ArrayLike) -> Array:
        """sqrt(det J J^T), (...)."""
        return self._vector(("manipulability",), q=q)[..., 0]

    @property
    def motor_map(self) -> Array:
        """B, (n, n): generalized forces Q = B t of joint efforts t."""
        n = len(self.coordinates)
        efforts = dict(zip(numbered("t{}", n), np.eye(n), strict=True))
        return np.stack(np.broadcast_arrays(*self.evaluate(numbered("Q{}", n), efforts)))

    def symbols(self) -> dict[str, Any]:
        """sympy expressions of the same text: "q", "qd", "Q", "parameters" (symbols); "M", "C", "J" (Matrix);
        "h", "G", "qdd", "tip", "Jdot_qd" (column Matrix); "T", "U", "Lz", "manipulability" (expressions)."""
        with needs("verify"):
            import sympy as sp
        import redundant_envs.compiler.backends.sympy  # noqa: F401 - lets expressions be numbers

        n = len(self.coordinates)
        parameters = {name: sp.Symbol(name, positive=True) for name in self.parameter_values()}
        of_motion = (self.coordinates, self.rates, numbered("Q{}", n))
        q, qd, forces = ({name: sp.Symbol(name, real=True) for name in names} for names in of_motion)
        field = {"ax": sp.Integer(0), "ay": sp.Symbol("g", real=True)}
        state = {**parameters, **q, **qd, **field, **forces}

        def matrix(letter: str, rows: int) -> Any:
            return sp.Matrix(rows, n, self.evaluate(entries(letter, rows, n), state))

        expr: dict[str, Any] = {"q": [*q.values()], "qd": [*qd.values()], "Q": [*forces.values()]}
        expr |= {"parameters": {**parameters, "g": field["ay"]}, "J": matrix("J", 2)}
        expr |= {letter: matrix(letter, n) for letter in "MC"}
        columns = {letter: numbered(f"{letter}{{}}", n) for letter in ("h", "G", "qdd")}
        columns |= {"tip": ["tip_x", "tip_y"], "Jdot_qd": ["Jdqd1", "Jdqd2"]}
        expr |= {name: sp.Matrix(self.evaluate(names, state)) for name, names in columns.items()}
        return expr | {name: self.evaluate((name,), state)[0] for name in ("T", "U", "Lz", "manipulability")}


def _defaults(arm: type[Arm]) -> dict[str, Any]:
    """Optional attributes of an arm that are not functions of the model."""
    n = len(arm.coordinates)
    sliders = arm.sliders()
    attributes: dict[str, Any] = {
        "kind": arm.__name__,
        "num_masses": n,
        "column_norms": derived.column_norms(n),
        "extent": (*numbered("l{}", arm.num_lengths), *(f"high{k + 1}" for k in sliders)),
        "posture": {
            name: f"{what} of {angle}"
            for angle, pair in arm.sincos.items()
            for what, name in zip(("sine", "cosine"), pair, strict=True)
        },
    }
    if sliders:
        attributes["held_dynamics"] = derived.forward_dynamics(n, sliders)
        attributes["slider_mobility"] = derived.slider_mobility(n, sliders)
    return attributes
