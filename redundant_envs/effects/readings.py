"""What effects on the readings of sensors have in common: a number for each position and each rate."""

from collections.abc import Callable
from typing import Any, NamedTuple

from redundant_envs.effects.hooks import Arm, Effect, Hook, Reading

READINGS = {"position": Reading.POSITION, "rate": Reading.RATE}
"""Fields with the numbers of each joint's readings, and what these measure."""


class Sensor(NamedTuple):
    """A sensor of a joint."""

    field: str  # "position" or "rate"
    joint: int
    reading: Reading

    @property
    def number(self) -> str:
        """Its own entry of the field, as hooks bind it."""
        return f".{self.field}[{self.joint}]"

    def unit(self, arm: Arm) -> str:
        length = "m" if arm.prismatic[self.joint] else "rad"
        return length if self.reading is Reading.POSITION else f"{length}/s"


def at_each_sensor(hook_at: Callable[[Any, Sensor, Arm], Hook]) -> Callable[[Any, Arm], tuple[Hook, ...]]:
    """The method ``hooks`` of an effect on sensors alike: those for which it has numbers, or else all."""

    def hooks(self: Any, arm: Arm) -> tuple[Hook, ...]:
        every = (Sensor(field, k, of) for field, of in READINGS.items() for k in range(len(arm.joints)))
        return tuple(hook_at(self, s, arm) for s in every if getattr(self, s.field, s) is not None)

    return hooks


class OfReadings(Effect):
    """Base of effects with numbers for the readings of positions, of rates, or of both."""

    def __post_init__(self) -> None:
        if all(getattr(self, field) is None for field in READINGS):
            raise ValueError(f"{type(self).__name__} has neither position nor rate; give one of them")
        super().__post_init__()
