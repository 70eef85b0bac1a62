"""What effects on the readings of sensors have in common: a number for each position and each rate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from redundant_envs.effects.hooks import Effect, Reading, units_of_joints
from redundant_envs.robots.arm import Arm

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


def check_readings(effect: Any, check: Callable[[str, Any], Any]) -> None:
    """Check the numbers of an effect, by a function of the name of a field and its value; ValueError if
    neither positions nor rates have any."""
    kind = type(effect).__name__
    given = {field: getattr(effect, field) for field in READINGS if getattr(effect, field) is not None}
    if not given:
        raise ValueError(f"{kind} has neither position nor rate, and would change nothing; give one of them")
    for field, value in given.items():
        object.__setattr__(effect, field, check(f"{kind}.{field}", value))


def sensors_of(effect: Effect, arm: Arm) -> Iterator[Sensor]:
    """The sensors whose readings an effect changes: those for which it has numbers."""
    return (s for s in every_sensor(arm) if getattr(effect, s.field) is not None)


def every_sensor(arm: Arm) -> Iterator[Sensor]:
    """The sensors of all positions and rates."""
    for field, reading in READINGS.items():
        yield from (Sensor(field, reading, joint) for joint in range(len(arm.joints)))


def units_of_readings(effect: Effect, arm: Arm) -> dict[str, str]:
    """Units of the numbers of an effect: those of the readings."""
    units = {"position": ("rad", "m"), "rate": ("rad/s", "m/s")}
    found: dict[str, str] = {}
    for field in READINGS:
        if getattr(effect, field) is not None:
            found |= units_of_joints(field, arm, *units[field])
    return found
