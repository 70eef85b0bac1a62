from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Hook, Sensing, State
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.effects.readings import OfReadings, Sensor, at_each_sensor
from redundant_envs.language.algebra import physics


@physics
def noise(deviation, normal1):
    return deviation * normal1


@physics
def disturbed(reading, noise):
    return reading + noise


@dataclass(frozen=True)
class SensorNoise(OfReadings):
    """Normally distributed errors of the sensors, others in every observation; motion, reward, ``info`` and
    goals keep the true values.

    The noise of a reading is independent of that of other readings, control steps and environments.

    Parameters
    ----------
    position : float or sequence of one for each joint, optional
        Standard deviation of the reading of the joint's position, rad (revolute) or m (prismatic), not
        negative.
    rate : float or sequence of one for each joint, optional
        Standard deviation of the reading of its rate, rad/s or m/s, not negative.
    """

    position: float | Numbers | None = field(default=None, metadata=each_joint(not_negative, "rad", "m"))
    rate: float | Numbers | None = field(default=None, metadata=each_joint(not_negative, "rad/s", "m/s"))

    example = Example({"position": 0.001, "rate": 0.01}, curve=Curve("reading", "time", 1.0))

    @at_each_sensor
    def hooks(self, s: Sensor, arm: Arm) -> Hook:
        error = f"error_of_{s.field}[{s.joint}]"
        state = State(error, s.unit(arm), update=noise, initial=noise, bind={"deviation": s.number})
        return Sensing(s.joint, disturbed, {"noise": f".{error}"}, s.reading, (state,))
