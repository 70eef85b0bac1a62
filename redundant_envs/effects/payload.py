from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Hook, Point, PointMass
from redundant_envs.effects.numbers import Example, not_negative, one


@dataclass(frozen=True)
class Payload(Effect):
    """A point mass that is carried at the tip, from the start to the end of a motion.

    The arm moves as one whose last mass is heavier by it, to the bit; :class:`PickUp` is a load that comes
    later.

    Parameters
    ----------
    mass : float
        Mass of the load, kg, not negative.
    """

    mass: float = field(metadata=one(not_negative))

    example = Example({"mass": 0.5}, zero={"mass": 0.0})

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return (PointMass(Point(arm.num_masses - 1), ".mass"),)
