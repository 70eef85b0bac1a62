import math
from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Field, Hook, State, named
from redundant_envs.effects.numbers import (
    Curve,
    Example,
    Numbers,
    checked,
    not_negative,
    one,
    pair,
    strengths,
    text,
)
from redundant_envs.language.algebra import identity, physics, sincos


@physics
def acceleration(angle, frequency, amplitude_x, amplitude_y):
    """The second derivative of the amplitude times the sine of the angle."""
    sine, _ = sincos(angle)
    square = -(frequency * frequency)
    return amplitude_x * square * sine, amplitude_y * square * sine


@dataclass(frozen=True)
class MovingBase(Effect):
    """The base swings to and fro, without turning: b(t) = A sin(w t).

    Coordinates, velocities, goals and energies are those that one sees from the base. There the arm
    moves as in the uniform field b''(t), which is added to gravity; its power counts as work. The angle w t
    is a state; each motion and each episode begins at t = 0.

    Parameters
    ----------
    amplitude : (float, float)
        Amplitude A along x and y, m.
    frequency : float
        Angular frequency w, rad/s, not negative: 2 pi times the number of cycles in a second.
    name : str
        Tells several of a scene apart, whose motions add: "second" has "moving_base.second.frequency", ...
    """

    amplitude: Numbers = field(metadata=pair(strengths, "m"))
    frequency: float = field(metadata=one(not_negative, "rad/s"))
    name: str = field(default="", metadata=checked(text))

    static = ("name",)
    key = named("moving_base.")
    example = Example({"amplitude": (0.01, 0.01), "frequency": 9.0}, curve=Curve("rate", "time", 1.0))

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        sine = math.sin(pose.states["angle"])
        return (shapes.Ground((self.amplitude[0] * sine, self.amplitude[1] * sine)),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        # The rate is for steps that are no longer than a third of a cycle, whatever an estimate sees.
        angle = State("angle", "rad", identity("frequency"), rate=identity("frequency"))
        return (Field(acceleration, states=(angle,)),)
