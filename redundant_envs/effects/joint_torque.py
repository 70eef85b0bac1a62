from dataclasses import dataclass, field

from redundant_envs.effects import disturbances as d
from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Hook, effort_unit
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative, one, strengths
from redundant_envs.language.algebra import identity


@dataclass(frozen=True)
class JointTorque(d.Disturbance):
    """A torque at each revolute joint and a force at each slider that nobody controls. Each part is absent
    unless it is given; they add.

    Parameters
    ----------
    step : float or sequence of one for each joint, optional
        A constant torque, N m (revolute) or N (prismatic), from ``start`` on.
    start : float, optional
        s, 0 by default: the step begins with the first control interval that begins then or later.
    amplitude : float or sequence of one for each joint, optional
        Of a periodic torque amplitude sin(2 pi frequency t + phase), N m or N.
    frequency : float, optional
        Its frequency, Hz, positive.
    phase : float or sequence of one for each joint, optional
        Its phase at the start of an episode or motion, rad, 0 by default.
    density : float or sequence of one for each joint, optional
        Of white noise, N m sqrt(s) or N sqrt(s), not negative: the integral over a time t has the variance
        density^2 t. The torque is constant in a control interval T, with the standard deviation
        density / sqrt(T).
    deviation : float or sequence of one for each joint, optional
        Standard deviation of an Ornstein-Uhlenbeck process, N m or N, not negative, from the start on.
    time_constant : float, optional
        Time in which its correlation falls to 1/e, s, positive.
    """

    step: float | Numbers | None = field(default=None, metadata=each_joint(strengths, "N m", "N"))
    start: float | None = field(default=None, metadata=one(not_negative, "s"))
    amplitude: float | Numbers | None = field(default=None, metadata=each_joint(strengths, "N m", "N"))
    frequency: float | None = field(default=None, metadata=one(d.moderate, "Hz"))
    phase: float | Numbers | None = field(default=None, metadata=each_joint(strengths, "rad"))
    density: float | Numbers | None = field(
        default=None, metadata=each_joint(not_negative, "N m sqrt(s)", "N sqrt(s)")
    )
    deviation: float | Numbers | None = field(default=None, metadata=each_joint(not_negative, "N m", "N"))
    time_constant: float | None = field(default=None, metadata=one(d.moderate, "s"))

    example = Example(
        {"step": 0.5, "start": 0.1, "amplitude": 0.5, "frequency": 2.0, "density": 0.05, "deviation": 0.5,
         "time_constant": 0.2}, curve=Curve("rate", "time", 1.0))  # fmt: skip

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        every = range(len(pose.arm.joints))
        return tuple(arrow for k in every for arrow in shapes.twist(pose, k, self.value(pose.states, k)))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        laws = (d.step, d.periodic, identity("white"), identity("wander"))
        at_each = (self.forces(k, (f"[{k}]",), effort_unit(arm, k), laws) for k in range(len(arm.joints)))
        return tuple(force for forces in at_each for force in forces)
