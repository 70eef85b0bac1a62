"""The spring that the report prints for its prismatic joints."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force, Hook
from redundant_envs.robots.parameters import Arm, numbers, strength, travel


@physics
def force(position, lower, upper, stiffness):
    """Report 1.3, the last two terms of H2 and of H4, on the left-hand side there."""
    return -(stiffness * (position - upper) + stiffness * (position - lower))


@physics
def energy(position, lower, upper, stiffness):
    """Report 1.1, modified PE, the last four terms."""
    return 0.5 * stiffness * (upper - position) ** 2 + 0.5 * stiffness * (lower - position) ** 2


@physics
def steepness(stiffness):
    return 2.0 * stiffness


@dataclass(frozen=True)
class CentringSpring(Effect):
    """k/2 (r_max - r)^2 + k/2 (r_min - r)^2 on both prismatic joints of the RPRP arm, always on.

    It pulls towards the middle of the travel with stiffness 2k and does not limit anything;
    :class:`LimitSpring` is what the report's text describes.

    Parameters
    ----------
    stiffness : (float, float)
        k1, k2, N/m, not negative.
    lower, upper : (float, float)
        r_min and r_max of both joints, m.
    """

    stiffness: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]

    def __post_init__(self) -> None:
        for name in ("stiffness", "lower", "upper"):
            object.__setattr__(self, name, numbers(f"CentringSpring.{name}", getattr(self, name), 2))
        for i in range(2):
            if self.stiffness[i] < 0.0:
                raise ValueError(
                    f"CentringSpring.stiffness[{i}] is {self.stiffness[i]}; it must not be negative"
                )
            strength(f"CentringSpring.stiffness[{i}]", self.stiffness[i])
            names = (f"CentringSpring.{name}[{i}]" for name in ("lower", "upper"))
            travel(next(names), self.lower[i], next(names), self.upper[i])

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        joints = [k for k in range(4) if arm.prismatic[k]]
        if len(joints) != 2:
            raise ValueError(
                f"CentringSpring acts on the two prismatic joints of RPRP; {arm.kind} has {len(joints)}"
            )
        return tuple(
            Force(
                k,
                force,
                {
                    "position": f"phi{k + 1}",
                    "lower": f".lower[{i}]",
                    "upper": f".upper[{i}]",
                    "stiffness": f".stiffness[{i}]",
                },
                potential=energy,
                conservative=force,
                stiffness=steepness,
            )
            for i, k in enumerate(joints)
        )
