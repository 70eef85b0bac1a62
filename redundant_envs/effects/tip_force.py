from dataclasses import dataclass, field

from redundant_envs.effects import disturbances as d
from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Hook, Point
from redundant_envs.effects.numbers import (
    Curve,
    Example,
    Numbers,
    each_axis,
    not_negative,
    one,
    pair,
    strengths,
)
from redundant_envs.language.algebra import physics


@physics
def steps(elapsed, start, control_dt, step_x, step_y):
    return d.step(elapsed, start, control_dt, step_x), d.step(elapsed, start, control_dt, step_y)


@physics
def oscillating(angle, phase_x, phase_y, amplitude_x, amplitude_y):
    return d.periodic(angle, phase_x, amplitude_x), d.periodic(angle, phase_y, amplitude_y)


@physics
def noise(white_x, white_y):
    return white_x, white_y


@physics
def wandered(wander_x, wander_y):
    return wander_x, wander_y


@dataclass(frozen=True)
class TipForce(d.Disturbance):
    """A force at the tip that nobody controls. Each part is absent unless it is given; they add.

    Parameters
    ----------
    step : (float, float), optional
        A constant force (x, y), N, from ``start`` on.
    start : float, optional
        s, 0 by default: the step begins with the first control interval that begins then or later.
    amplitude : (float, float), optional
        Of a periodic force amplitude sin(2 pi frequency t + phase), (x, y), N.
    frequency : float, optional
        Its frequency, Hz, positive.
    phase : float or (float, float), optional
        Its phase at the start of an episode or motion, rad, 0 by default; a quarter of a turn between x and y
        makes a force that turns.
    density : float or (float, float), optional
        Of white noise, N sqrt(s), not negative: the impulse in a time t has the variance density^2 t. The
        force is constant in a control interval T, with the standard deviation density / sqrt(T).
    deviation : float or (float, float), optional
        Standard deviation of an Ornstein-Uhlenbeck process, N, not negative, from the start on.
    time_constant : float, optional
        Time in which its correlation falls to 1/e, s, positive.
    """

    step: Numbers | None = field(default=None, metadata=pair(strengths, "N"))
    start: float | None = field(default=None, metadata=one(not_negative, "s"))
    amplitude: Numbers | None = field(default=None, metadata=pair(strengths, "N"))
    frequency: float | None = field(default=None, metadata=one(d.moderate, "Hz"))
    phase: float | Numbers | None = field(default=None, metadata=each_axis(strengths, "rad"))
    density: float | Numbers | None = field(default=None, metadata=each_axis(not_negative, "N sqrt(s)"))
    deviation: float | Numbers | None = field(default=None, metadata=each_axis(not_negative, "N"))
    time_constant: float | None = field(default=None, metadata=one(d.moderate, "s"))

    example = Example(
        {"step": (1.0, 0.0), "start": 0.1, "amplitude": (1.0, -1.0), "frequency": 2.0, "density": 0.1,
         "deviation": 1.0, "time_constant": 0.2}, curve=Curve("rate", "time", 1.0))  # fmt: skip

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        return (shapes.push(pose, (self.value(pose.states, 0), self.value(pose.states, 1))),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        tip, laws = Point(arm.num_masses - 1), (steps, oscillating, noise, wandered)
        return tuple(self.forces(tip, ("[0]", "[1]"), "N", laws))
