"""What effects on the readings of sensors have in common: a number for each position and each rate."""

from collections.abc import Iterator
from typing import NamedTuple

from redundant_envs.effects.hooks import Arm, Effect, Reading

READINGS = {"position": Reading.POSITION, "rate": Reading.RATE}
"""Fields with the numbers of each joint's readings, and what these measure."""


class Sensor(NamedTuple):
    """A sensor of a joint."""

    field: str  # "position" or "rate"
    reading: Reading
    joint: int

    @property
    def quantity(self) -> str:
        """What reaches it."""
        return self.reading.value.format(self.joint + 1)

    @property
    def number(self) -> str:
        """Its own entry of the field, as hooks bind it."""
        return f".{self.field}[{self.joint}]"

    def unit(self, arm: Arm) -> str:
        """Unit of its readings."""
        length = "m" if arm.prismatic[self.joint] else "rad"
        return length if self.reading is Reading.POSITION else f"{length}/s"


def every_sensor(arm: Arm) -> Iterator[Sensor]:
    """The sensors of all positions and rates."""
    for field, reading in READINGS.items():
        yield from (Sensor(field, reading, joint) for joint in range(len(arm.joints)))


class OfReadings(Effect):
    """Base of effects with numbers for the readings of positions, of rates, or of both."""

    def __post_init__(self) -> None:
        if all(getattr(self, field) is None for field in READINGS):
            kind = type(self).__name__
            raise ValueError(
                f"{kind} has neither position nor rate, and would change nothing; give one of them"
            )
        super().__post_init__()

    def sensors(self, arm: Arm) -> Iterator[Sensor]:
        """The sensors whose readings it changes: those for which it has numbers."""
        return (s for s in every_sensor(arm) if getattr(self, s.field) is not None)
