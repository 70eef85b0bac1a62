"""Inertias of the links, which point masses do not have."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.effects import Effect, Inertia
from redundant_envs.robots.parameters import not_negative


@dataclass(frozen=True)
class LinkInertia(Effect):
    """Moments of inertia of the links about their point masses, kg m^2, one for each revolute joint."""

    inertias: tuple[float, ...]

    def __post_init__(self):
        object.__setattr__(self, "inertias", tuple(not_negative("LinkInertia.inertias", self.inertias)))

    def hooks(self, arm):
        turning = [k for k, slides in enumerate(arm.prismatic) if not slides]
        if len(self.inertias) != len(turning):
            raise ValueError(f"LinkInertia.inertias has {len(self.inertias)} entries; give {len(turning)}")
        return tuple(Inertia(tuple(turning[: n + 1]), f".inertias[{n}]") for n in range(len(turning)))


rde.register_effect(LinkInertia)
