"""Torques that disturb the joints."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.algebra import physics
from redundant_envs.effects import disturbances as d
from redundant_envs.effects.hooks import Effect, Force, Hook, units_of_joints
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import strengths
from redundant_envs.values import Numbers


@physics
def drawn(torque):
    return torque


@dataclass(frozen=True)
class JointTorque(Effect):
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

    step: float | Numbers | None = None
    start: float | None = None
    amplitude: float | Numbers | None = None
    frequency: float | None = None
    phase: float | Numbers | None = None
    density: float | Numbers | None = None
    deviation: float | Numbers | None = None
    time_constant: float | None = None

    of_joints = ("step", "amplitude", "phase", "density", "deviation")

    def __post_init__(self) -> None:
        d.check_parts(self, strengths)

    def units(self, arm: Arm) -> dict[str, str]:
        units = d.shared_units(self)
        for field, factor in (("step", ""), ("amplitude", ""), ("density", " sqrt(s)"), ("deviation", "")):
            if getattr(self, field) is not None:
                units |= units_of_joints(field, arm, f"N m{factor}", f"N{factor}")
        return units

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        found: list[Force] = []
        for k, slides in enumerate(arm.prismatic):
            unit, entry, first = "N" if slides else "N m", f"[{k}]", k == 0  # the first has what all share
            if self.step is not None:
                own = {"elapsed": ".elapsed", "start": ".start", "size": f".step{entry}"}
                found.append(Force(k, d.step, own, states=(d.clock(),) if first else ()))
            if self.amplitude is not None:
                own = {"angle": ".angle", "phase": f".phase{entry}", "amplitude": f".amplitude{entry}"}
                found.append(Force(k, d.periodic, own, states=(d.phase_angle(),) if first else ()))
            if self.density is not None:
                own = {"torque": f".white{entry}"}
                found.append(Force(k, drawn, own, states=(d.white_noise(entry, unit),)))
            if self.deviation is not None:
                own = {"torque": f".wander{entry}"}
                found.append(Force(k, drawn, own, states=(d.wander(entry, unit),)))
        return tuple(found)
