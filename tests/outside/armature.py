"""Inertias that point masses do not have: of the motors' rotors."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.effects import Effect, Inertia
from redundant_envs.robots.parameters import not_negative


@dataclass(frozen=True)
class Armature(Effect):
    """Inertias of the rotors of the motors, times gear ratios squared: kg m^2 (kg for a slider) at each
    joint."""

    inertias: float | tuple[float, ...]

    of_joints = ("inertias",)

    def __post_init__(self):
        object.__setattr__(self, "inertias", not_negative("Armature.inertias", self.inertias))

    def hooks(self, arm):
        return tuple(Inertia((k,), f".inertias[{k}]") for k in range(len(arm.joints)))


rde.register_effect(Armature)
