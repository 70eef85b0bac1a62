"""Sensors that show what was a while ago."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.effects.hooks import Arm, Effect, Hook, Sensing, State
from redundant_envs.effects.numbers import Example, number, one
from redundant_envs.effects.readings import Sensor, every_sensor
from redundant_envs.language.algebra import floor, identity, numbered, physics, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.support.values import with_fields

MAX_KEPT = 1024
"""Readings that a sensor keeps at most: each is a number of every lane, and moves on in every step."""


@physics
def steps_back(seconds, control_dt):
    """The delay in control steps; those that are whole but for rounding are whole: 0.3 s are three steps of
    0.1 s, though 0.3 / 0.1 is less than 3."""
    steps = seconds / control_dt
    whole = floor(steps + 0.5)
    return where(abs(steps - whole) <= ROUNDING * whole, whole, steps)


@functools.cache
def delayed(count: int) -> Callable[..., Any]:
    """The function of a sensor that keeps a number of readings, the latest first."""

    @physics(takes=("seconds", "control_dt", *numbered("kept{}", count)))
    def delayed(seconds, control_dt, *kept):
        """On the line through the readings before and after the instant."""
        steps = steps_back(seconds, control_dt)
        whole = floor(steps)
        newer, older = kept[0], kept[min(1, count - 1)]
        for k in range(1, count):
            newer = where(whole >= k, kept[k], newer)
            older = where(whole >= k, kept[min(k + 1, count - 1)], older)
        return newer + (steps - whole) * (older - newer)

    return delayed


@dataclass(frozen=True)
class SensorDelay(Effect):
    """Readings of all sensors that are late by the same time; motion, reward, ``info`` and goals keep the
    true values.

    Sensors are read once in a control step, so a delay that is no whole number of steps shows a value on the
    line between two readings. Before the start of an episode the arm was as it is at the start.

    Parameters
    ----------
    seconds : float
        The delay, s, from 0 to ``longest``.
    longest : float
        The longest delay that may be set, s: as many readings are kept as it needs, at most 1024.

    Attributes
    ----------
    control_dt : float or None
        Control interval of the scene that has the effect, s.
    """

    seconds: float = dataclasses.field(metadata=one(number, "s"))
    longest: float = dataclasses.field(metadata=one(number))
    control_dt: float | None = dataclasses.field(default=None, init=False)

    static = ("longest", "control_dt")
    example = Example({"seconds": 0.03, "longest": 0.1})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.longest < 0.0:
            raise ValueError(f"SensorDelay.longest is {self.longest} s; it must not be negative")
        if not 0.0 <= self.seconds <= self.longest:
            raise ValueError(
                f"SensorDelay.seconds is {self.seconds} s; it must lie in 0 to longest, which is "
                f"{self.longest} s: give a longer 'longest' or a shorter delay"
            )

    def at_interval(self, control_dt: float) -> Effect:
        steps = self.longest / control_dt  # may be infinite, which is no number of steps
        steps = float(steps_back(self.longest, control_dt)) if math.isfinite(steps) else steps
        if not steps <= MAX_KEPT - 1:
            most = (MAX_KEPT - 1) * control_dt
            raise ValueError(
                f"SensorDelay.longest is {self.longest} s, {steps:.6g} control steps of {control_dt} s, and "
                f"a sensor keeps at most {MAX_KEPT} readings; give at most {most:g} s, or a scene with a "
                "longer control_dt"
            )
        return with_fields(self, control_dt=control_dt)

    @property
    def kept(self) -> int:
        """Number of readings that each sensor keeps."""
        if self.control_dt is None:
            raise ValueError(
                "SensorDelay keeps as many readings as its scene's control_dt asks for; make a Scene"
            )
        return math.ceil(steps_back(self.longest, self.control_dt)) + 1

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(self._late(s, arm) for s in every_sensor(arm))

    def _late(self, s: Sensor, arm: Arm) -> Hook:
        names = [f"{s.field}_of_{arm.joints[s.joint]}[{k}]" for k in range(self.kept)]
        unit, now = s.unit(arm), {"reading": s.quantity}
        states = [State(names[0], unit, update=identity("reading"), initial=identity("reading"), bind=now)]
        for newer, name in itertools.pairwise(names):
            bind = {**now, "newer": f".{newer}"}
            states.append(State(name, unit, update=identity("newer"), initial=identity("reading"), bind=bind))
        own = {"seconds": ".seconds", **{f"kept{k + 1}": f".{name}" for k, name in enumerate(names)}}
        return Sensing(s.joint, delayed(self.kept), own, s.reading, tuple(states))
