from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Hook, Sensing, State
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, share
from redundant_envs.effects.readings import Sensor, at_each_sensor
from redundant_envs.language.algebra import identity, physics, where


@physics
def latest(reading, last, probability, uniform1):
    """The reading, or the last one that arrived."""
    return where(uniform1 < probability, last, reading)


@dataclass(frozen=True)
class DroppedSamples(Effect):
    """Readings that are lost on their way: the last one that arrived is shown again. Motion, reward, ``info``
    and goals keep the true values.

    Each reading, of each position and each rate, is lost independently of all others. The one at the start of
    an episode arrives.

    Parameters
    ----------
    probability : float or sequence of one for each joint
        Of the loss of a reading of the joint in a control step, 0 to 1.
    """

    probability: float | Numbers = field(metadata=each_joint(share, "1"))

    example = Example({"probability": 0.1}, curve=Curve("reading", "time", 1.0))

    @at_each_sensor
    def hooks(self, s: Sensor, arm: Arm) -> Hook:
        name = f"last_{s.field}[{s.joint}]"
        last = {"last": f".{name}"}
        state = State(name, s.unit(arm), update=latest, initial=identity("reading"), bind=last)
        return Sensing(s.joint, identity("last"), last, s.reading, (state,))
