"""A base that moves: the arm feels its acceleration as a field."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from redundant_envs.algebra import physics, sincos
from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Effect, Field, Hook, State
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import numbers, strength
from redundant_envs.values import Numbers, shown

NAME = re.compile(r"\w*")


@physics
def acceleration(angle, frequency, x, y):
    """The second derivative of the amplitude times the sine of the angle."""
    sine, _ = sincos(angle)
    square = -(frequency * frequency)
    return x * square * sine, y * square * sine


@physics
def pace(frequency):
    return frequency


@dataclass(frozen=True)
class MovingBase(Effect):
    """The base swings to and fro, without turning: b(t) = A sin(w t).

    Coordinates, velocities, goals and energies are those that one sees from the base. There the arm
    moves as in the uniform field b''(t), which is added to gravity; its power counts as work. The angle w t
    is a state; each motion and each episode begins at t = 0.

    Parameters
    ----------
    amplitude : (float, float)
        A, in x and y, m.
    frequency : float
        w, rad/s, not negative: 2 pi times the number of cycles in a second.
    name : str
        Tells several of a scene apart, whose motions add: "second" has "moving_base.second.frequency", ...
    """

    amplitude: Numbers
    frequency: float
    name: str = ""

    static = ("name",)

    def __post_init__(self) -> None:
        amplitude = numbers("MovingBase.amplitude", self.amplitude, 2)
        for k, x in enumerate(amplitude):
            strength(f"MovingBase.amplitude[{k}]", x)
        object.__setattr__(self, "amplitude", amplitude)
        frequency = strength("MovingBase.frequency", self.frequency)
        if frequency < 0.0:
            raise ValueError(f"MovingBase.frequency is {frequency} rad/s; it must not be negative")
        object.__setattr__(self, "frequency", frequency)
        if not isinstance(self.name, str) or not NAME.fullmatch(self.name):
            raise ValueError(f"MovingBase.name is {shown(self.name)}; give letters, digits and '_'")

    @property
    def key(self) -> str:
        return f"moving_base.{self.name}" if self.name else "moving_base"

    def units(self, arm: Arm) -> dict[str, str]:
        return {"amplitude": "m", "frequency": "rad/s"}

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        sine = math.sin(pose.states["angle"])
        return (shapes.Ground((self.amplitude[0] * sine, self.amplitude[1] * sine)),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        own = {"frequency": ".frequency"}
        # The rate is for steps that are no longer than a third of a cycle, whatever an estimate sees.
        angle = State("angle", "rad", pace, bind=own, rate=pace)
        bind = {"angle": ".angle", "x": ".amplitude[0]", "y": ".amplitude[1]", **own}
        return (Field(acceleration, bind, (angle,)),)
