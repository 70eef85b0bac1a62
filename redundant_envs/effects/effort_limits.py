"""Motors that saturate."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.algebra import clamp, physics
from redundant_envs.effects.hooks import Actuation, Effect, Hook
from redundant_envs.effects.viscous_friction import four_not_negative
from redundant_envs.robots.parameters import Arm


@physics
def saturate(command, limit):
    return clamp(command, -limit, limit)


@dataclass(frozen=True)
class EffortLimits(Effect):
    """Largest effort of each motor; a larger command gives the limit, as a real motor does.

    Parameters
    ----------
    limits : float or sequence of 4 floats
        N m (revolute) or N (prismatic), not negative.
    """

    limits: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", four_not_negative("EffortLimits.limits", self.limits))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(
            Actuation(k, saturate, {"command": f"command{k + 1}", "limit": f".limits[{k}]"}) for k in range(4)
        )
