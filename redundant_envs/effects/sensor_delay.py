import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.effects.delays import Delay
from redundant_envs.effects.hooks import Arm, Hook, Sensing, State
from redundant_envs.effects.numbers import Curve, Example
from redundant_envs.effects.readings import Sensor, at_each_sensor
from redundant_envs.language.algebra import floor, identity, numbered, physics, where
from redundant_envs.language.limits import ROUNDING


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
class SensorDelay(Delay):
    """Readings of all sensors that are late by the same time; motion, reward, ``info`` and goals keep the
    true values.

    Sensors are read once in a control step, so a delay that is no whole number of steps shows a value on the
    line between two readings. Before the start of an episode the arm was as it is at the start.

    Parameters
    ----------
    seconds : float
        Delay of all readings, s, from 0 to ``longest``.
    longest : float
        The longest delay that may be set, s: as many readings are kept as it needs, at most 1024.
    """

    values = "readings"
    example = Example({"seconds": 0.03, "longest": 0.1}, curve=Curve("reading", "time", 1.0))

    def kept_at(self, control_dt: float) -> int:
        return math.ceil(steps_back(self.longest, control_dt)) + 1

    @at_each_sensor
    def hooks(self, s: Sensor, arm: Arm) -> Hook:
        names = [f"{s.field}_of_{arm.joints[s.joint]}[{k}]" for k in range(self.kept)]
        unit, now = s.unit(arm), identity("reading")
        states = [State(names[0], unit, update=now, initial=now)]
        for newer, name in itertools.pairwise(names):
            bind = {"newer": f".{newer}"}
            states.append(State(name, unit, update=identity("newer"), initial=now, bind=bind))
        sources = {f"kept{k + 1}": f".{name}" for k, name in enumerate(names)}
        return Sensing(s.joint, delayed(self.kept), sources, s.reading, tuple(states))
