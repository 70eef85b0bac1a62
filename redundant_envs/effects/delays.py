"""What delays of commands and of readings have in common: their numbers, and how many values they keep."""

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

from redundant_envs.effects.hooks import Effect
from redundant_envs.effects.numbers import not_negative, number, one
from redundant_envs.support.values import with_fields

MAX_KEPT = 1024
"""Most values of a motor or a sensor that are kept: each is a number of every lane, and moves once in an
interval."""


@dataclass(frozen=True)
class Delay(Effect):
    """Base of delays, which keep earlier values as states.

    Attributes
    ----------
    control_dt : float or None
        Control interval of the scene that has the effect, s.
    """

    seconds: float = dataclasses.field(metadata=one(number, "s"))
    longest: float = dataclasses.field(metadata=one(not_negative))
    control_dt: float | None = dataclasses.field(default=None, init=False)

    static = ("longest", "control_dt")
    values: ClassVar[str]
    """Its name for what it keeps."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.seconds <= self.longest:
            raise ValueError(
                f"{type(self).__name__}.seconds is {self.seconds} s; it must lie in 0 to longest, which is "
                f"{self.longest} s: give a shorter delay, or a larger longest"
            )

    def at_interval(self, control_dt: float) -> "Delay":
        """The effect with as many values as a scene with this control interval keeps."""
        delay = with_fields(self, control_dt=control_dt)
        if delay.kept > MAX_KEPT:
            raise ValueError(
                f"{type(self).__name__}.longest is {self.longest} s, which at a control_dt of {control_dt} s "
                f"needs {delay.kept} kept {self.values}; at most {MAX_KEPT} are: give a longest below "
                f"{MAX_KEPT * control_dt:g} s, or a longer control_dt"
            )
        return delay

    @property
    def kept(self) -> int:
        """Number of values that are kept for each motor or sensor."""
        if self.control_dt is None:
            kind = type(self).__name__
            raise ValueError(f"{kind} keeps as many {self.values} as the control_dt asks for; make a Scene")
        return self.kept_at(self.control_dt)

    def kept_at(self, control_dt: float) -> int:
        """The same at a control interval, s."""
        raise NotImplementedError
