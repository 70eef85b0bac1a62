"""Viscous friction in the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force, Hook
from redundant_envs.robots.parameters import Arm, number, numbers, strength


@physics
def force(rate, coefficient):
    """Opposes the rate of the joint, not that of the absolute angle."""
    return -coefficient * rate


@physics
def slope(coefficient):
    return coefficient


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """Friction proportional to the joint rates.

    Parameters
    ----------
    coefficients : float or sequence of 4 floats
        N m s/rad (revolute) or N s/m (prismatic), not negative; one number serves all joints.
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "coefficients",
            four_not_negative("ViscousFriction.coefficients", self.coefficients),
        )

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(
            Force(
                k,
                force,
                {"rate": f"phid{k + 1}", "coefficient": f".coefficients[{k}]"},
                damping=slope,
            )
            for k in range(4)
        )


def four_not_negative(field: str, value: Any) -> tuple[float, ...]:
    """Four finite numbers, none negative; a single number is repeated."""
    if not hasattr(value, "__len__") or getattr(value, "ndim", 1) == 0:
        value = (number(field, value),) * 4
    xs = numbers(field, value, 4)
    for i, x in enumerate(xs):
        strength(f"{field}[{i}]", x)
        if x < 0.0:
            raise ValueError(f"{field}[{i}] is {x}; it must not be negative")
    return xs
