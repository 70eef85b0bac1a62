"""What every arm has: validated masses and lengths, and the names its equations use."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.values import shown

LARGEST_RATIO = 1e12
"""Largest allowed ratio of two masses or two lengths: beyond it float64 loses the small one."""

SMALLEST, LARGEST = 1e-30, 1e30
"""Allowed masses and lengths: products of several of them must neither overflow nor vanish."""


STRONGEST = 1e100
"""Largest strength of a field, a force, a spring or a damper: the largest mass times the largest length
times more than any rate, and its square still is a float."""


def number(field: str, value: Any) -> float:
    """A finite float, or a ValueError that names the field."""
    numeric = getattr(getattr(value, "dtype", None), "kind", "f") in "iuf"  # of NumPy: no bool, no complex
    if isinstance(value, (bool, str, bytes, bytearray)) or not numeric or getattr(value, "ndim", 0) != 0:
        raise ValueError(f"{field} is {shown(value)}; give a finite number")
    try:
        x = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field} is {shown(value)}; give a finite number") from None
    if not math.isfinite(x):
        raise ValueError(f"{field} is {x}; give a finite number")
    return x


def strength(field: str, value: Any) -> float:
    """A finite float that is no larger than :data:`STRONGEST`, or a ValueError that names the field."""
    x = number(field, value)
    if abs(x) > STRONGEST:
        raise ValueError(f"{field} is {x}; it must lie in {-STRONGEST:g} to {STRONGEST:g}")
    return x


def travel(lower_field: str, lower: Any, upper_field: str, upper: Any) -> tuple[float, float]:
    """Two ends of a travel: finite, in order, and as far apart as a length may be small."""
    low, high = number(lower_field, lower), number(upper_field, upper)
    for field, x in ((lower_field, low), (upper_field, high)):
        if abs(x) > LARGEST:
            raise ValueError(f"{field} is {x}; it must lie in {-LARGEST:g} to {LARGEST:g}")
    if low >= high:
        raise ValueError(
            f"{lower_field} is {low}, {upper_field.rsplit('.', 1)[-1]} is {high}; lower must be below"
        )
    if high - low < SMALLEST:
        raise ValueError(
            f"{lower_field} is {low}, {upper_field.rsplit('.', 1)[-1]} is {high}; they must be at least "
            f"{SMALLEST:g} apart"
        )
    return low, high


def numbers(field: str, values: Any, count: int) -> tuple[float, ...]:
    """A tuple of ``count`` finite floats, or a ValueError that names the field."""
    plain = hasattr(values, "__len__") and hasattr(values, "__getitem__") and not isinstance(values, Mapping)
    if isinstance(values, (str, bytes)) or not plain or getattr(values, "ndim", 1) == 0:
        raise ValueError(f"{field} is {shown(values)}; give a sequence of {count} numbers")
    if len(values) != count:
        raise ValueError(f"{field} has {len(values)} entries; give {count}")
    return tuple(number(f"{field}[{i}]", v) for i, v in enumerate(values))


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
    if max(xs) > LARGEST_RATIO * min(xs):
        raise ValueError(
            f"{field} spans a ratio of {max(xs) / min(xs):.1e}; at most {LARGEST_RATIO:.0e} "
            "is supported in float64: raise the smallest or lower the largest"
        )
    return xs


@dataclass(frozen=True)
class Arm:
    """Masses [kg] and lengths [m] of a planar arm, with the names of its coordinates.

    Parameters
    ----------
    masses : sequence of 4 floats
        Point masses at the four link ends, kg, positive.
    lengths : sequence of floats
        Link lengths, m, positive.
    """

    masses: tuple[float, ...]
    lengths: tuple[float, ...]

    kind: ClassVar[str]
    num_lengths: ClassVar[int]
    coordinates: ClassVar[tuple[str, ...]]
    """Names of the four generalized coordinates in the equations."""
    rates: ClassVar[tuple[str, ...]]
    """Names of the four generalized velocities."""
    joints: ClassVar[tuple[str, ...]]
    """Names of the four joints, as users write them (``LimitSpring("r1", ...)``)."""
    prismatic: ClassVar[tuple[bool, ...]]
    sincos: ClassVar[dict[str, tuple[str, str]]]
    """Angle quantity -> names of its sine and cosine."""
    functions: ClassVar[tuple[Callable[..., Any], ...]]
    """The quantities of the model: dialect functions found by what they give."""

    prepared: ClassVar[tuple[Callable[..., Any], ...]]
    """Functions of the parameters alone, evaluated when a parameter is set, not in the step."""
    column_norms: ClassVar[Callable[..., Any]]
    mobility_bounds: ClassVar[Callable[..., Any]]
    held_dynamics: ClassVar[Callable[..., Any] | None] = None
    """Dynamics with sliders at rest, and columns of M^-1; None for an arm without sliders."""
    slider_mobility: ClassVar[Callable[..., Any] | None] = None
    coordinates_of_joints: ClassVar[Callable[..., Any]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "masses", positive_numbers("masses", self.masses, 4, "kg"))
        object.__setattr__(self, "lengths", positive_numbers("lengths", self.lengths, self.num_lengths, "m"))

    def joint_index(self, name: str) -> int:
        """Position of a joint by its name; an unknown name lists the valid ones."""
        if name not in self.joints:
            raise ValueError(f"coordinate is {shown(name)}; {self.kind} has {', '.join(self.joints)}")
        return self.joints.index(name)

    def parameter_values(self) -> dict[str, float]:
        """Values of the parameters m1..m4 and l1.. that the equations name."""
        values = {f"m{i + 1}": m for i, m in enumerate(self.masses)}
        values.update({f"l{i + 1}": length for i, length in enumerate(self.lengths)})
        return values
