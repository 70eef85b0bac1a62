import functools
from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Hook, Sensing
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint
from redundant_envs.effects.readings import OfReadings, Sensor, at_each_sensor
from redundant_envs.language.algebra import floor, physics
from redundant_envs.robots.parameters import SMALLEST, each


@physics
def counted(reading, resolution):
    """The nearest whole number of steps; halves go up."""
    return resolution * floor(reading / resolution + 0.5)


resolutions = functools.partial(each, lambda x: x >= SMALLEST, f"give at least {SMALLEST:g}, or leave it out")
"""Positive steps of which a reading has finitely many."""


@dataclass(frozen=True)
class Quantisation(OfReadings):
    """Readings in whole steps, as those of encoders and converters; motion, reward, ``info`` and goals keep
    the true values.

    Parameters
    ----------
    position : float or sequence of one for each joint, optional
        Step of the reading of the joint's position, rad (revolute) or m (prismatic), at least 1e-30.
    rate : float or sequence of one for each joint, optional
        Step of the reading of its rate, rad/s or m/s, at least 1e-30.
    """

    position: float | Numbers | None = field(default=None, metadata=each_joint(resolutions, "rad", "m"))
    rate: float | Numbers | None = field(default=None, metadata=each_joint(resolutions, "rad/s", "m/s"))

    example = Example({"position": 0.001, "rate": 0.01}, curve=Curve("reading", "time", 1.0))

    @at_each_sensor
    def hooks(self, s: Sensor, arm: Arm) -> Hook:
        return Sensing(s.joint, counted, {"resolution": s.number}, s.reading)
