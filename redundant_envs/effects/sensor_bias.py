"""Sensors that are off."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Hook, Sensing
from redundant_envs.effects.readings import check_readings, sensors_of, units_of_readings
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import strengths
from redundant_envs.values import Numbers


@physics
def shifted(reading, bias):
    return reading + bias


@dataclass(frozen=True)
class SensorBias(Effect):
    """Constant errors of the sensors; motion, reward, ``info`` and goals keep the true values.

    Parameters
    ----------
    position : float or sequence of one for each joint, optional
        Added to the reading of the joint's position, rad (revolute) or m (prismatic).
    rate : float or sequence of one for each joint, optional
        Added to the reading of its rate, rad/s or m/s.
    """

    position: float | Numbers | None = None
    rate: float | Numbers | None = None

    of_joints = ("position", "rate")

    def __post_init__(self) -> None:
        check_readings(self, strengths)

    def units(self, arm: Arm) -> dict[str, str]:
        return units_of_readings(self, arm)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(
            Sensing(s.joint, shifted, {"reading": s.quantity, "bias": s.number}, s.reading)
            for s in sensors_of(self, arm)
        )
