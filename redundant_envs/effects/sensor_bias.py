from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Hook, Sensing
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, strengths
from redundant_envs.effects.readings import OfReadings, Sensor, at_each_sensor
from redundant_envs.language.algebra import physics


@physics
def shifted(reading, bias):
    return reading + bias


@dataclass(frozen=True)
class SensorBias(OfReadings):
    """Constant errors of the sensors; motion, reward, ``info`` and goals keep the true values.

    Parameters
    ----------
    position : float or sequence of one for each joint, optional
        Added to the reading of the joint's position, rad (revolute) or m (prismatic).
    rate : float or sequence of one for each joint, optional
        Added to the reading of its rate, rad/s or m/s.
    """

    position: float | Numbers | None = field(default=None, metadata=each_joint(strengths, "rad", "m"))
    rate: float | Numbers | None = field(default=None, metadata=each_joint(strengths, "rad/s", "m/s"))

    example = Example({"position": 0.01, "rate": 0.02}, curve=Curve("reading", "time", 1.0))

    @at_each_sensor
    def hooks(self, s: Sensor, arm: Arm) -> Hook:
        return Sensing(s.joint, shifted, {"bias": s.number}, s.reading)
