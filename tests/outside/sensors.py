"""Encoders that are off, and that count in steps."""

from dataclasses import dataclass

import numpy as np

import redundant_envs as rde
from redundant_envs.algebra import floor, physics
from redundant_envs.effects import Effect, Reading, Sensing
from redundant_envs.robots.parameters import not_negative


@physics
def shifted(reading, bias):
    return reading + bias


@physics
def counted(reading, resolution):
    """In whole steps of the encoder; the nearest one."""
    return resolution * floor(reading / resolution + 0.5)


@dataclass(frozen=True)
class SensorBias(Effect):
    """Offset of each encoder, rad or m, and of each rate sensor, rad/s or m/s."""

    positions: float | tuple[float, ...] = 0.0
    rates: float | tuple[float, ...] = 0.0

    of_joints = ("positions", "rates")

    def hooks(self, arm):
        return tuple(
            Sensing(k, shifted, {"reading": kind.value.format(k + 1), "bias": f".{own}[{k}]"}, kind)
            for kind, own in ((Reading.POSITION, "positions"), (Reading.RATE, "rates"))
            for k in range(len(arm.joints))
        )


@dataclass(frozen=True)
class Encoders(Effect):
    """Steps of the encoders, rad or m, positive."""

    resolution: float | tuple[float, ...]

    of_joints = ("resolution",)

    def __post_init__(self):
        checked = not_negative("Encoders.resolution", self.resolution)
        if np.min(checked) == 0.0:
            raise ValueError(f"Encoders.resolution is {self.resolution}; it must be positive")
        object.__setattr__(self, "resolution", checked)

    def hooks(self, arm):
        return tuple(
            Sensing(k, counted, {"reading": f"phi{k + 1}", "resolution": f".resolution[{k}]"})
            for k in range(len(arm.joints))
        )


rde.register_effect(SensorBias)
rde.register_effect(Encoders)
