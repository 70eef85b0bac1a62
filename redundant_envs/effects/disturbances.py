"""What disturbing forces at the tip and at joints have in common: their laws, their states, their checks.

A disturbance has up to four parts, each of which is absent unless its numbers are given: a step, a periodic
force, white noise, and an Ornstein-Uhlenbeck process.
"""

from collections.abc import Mapping
from typing import Any

from redundant_envs.effects.hooks import Effect, State
from redundant_envs.language.algebra import exp, physics, sincos, sqrt, where
from redundant_envs.robots.parameters import LARGEST, SMALLEST, not_negative, strengths

ROUNDING = 1e-6
"""Share of a control interval by which the sum of all intervals so far may differ from the time: rounding
stays below it for 1e9 intervals."""
PARTS: Mapping[str, Mapping[str, float | None]] = {
    "step": {"start": 0.0},
    "amplitude": {"frequency": None, "phase": 0.0},
    "density": {},
    "deviation": {"time_constant": None},
}
"""The number that a part begins with -> others that belong to it, and their defaults, None without one."""


@physics
def step(elapsed, start, control_dt, size):
    """From the first control interval on that begins at the time ``start`` or later."""
    return where(elapsed >= start - ROUNDING * control_dt, size, 0.0)


@physics
def later(elapsed, control_dt):
    return elapsed + control_dt


@physics
def periodic(angle, phase, amplitude):
    sine, _ = sincos(angle + phase)
    return amplitude * sine


@physics
def angular_rate(frequency):
    return 6.283185307179586 * frequency


@physics
def white(density, control_dt, normal1):
    """Constant in an interval, with a variance that makes the impulse of any time independent of it."""
    return density / sqrt(control_dt) * normal1


@physics
def wandering(force, deviation, time_constant, control_dt, normal1):
    """The exact law of an Ornstein-Uhlenbeck process from one instant to another (Gillespie 1996)."""
    decay = exp(-control_dt / time_constant)
    return force * decay + deviation * sqrt(1.0 - decay * decay) * normal1


@physics
def stationary(deviation, normal1):
    return deviation * normal1


def clock() -> State:
    """The time since the start, at the beginning of an interval."""
    return State("elapsed", "s", update=later)


def phase_angle() -> State:
    """The angle of a periodic force without its phase."""
    return State("angle", "rad", derivative=angular_rate)


def white_noise(entry: str, unit: str) -> State:
    """The force of white noise in an interval; ``entry`` is "[k]"."""
    bind = {"density": f".density{entry}"}
    return State(f"white{entry}", unit, update=white, initial=white, bind=bind)


def wander(entry: str, unit: str) -> State:
    """The force of an Ornstein-Uhlenbeck process in an interval; ``entry`` is "[k]"."""
    name = f"wander{entry}"
    bind = {"force": f".{name}", "deviation": f".deviation{entry}"}
    return State(name, unit, update=wandering, initial=stationary, bind=bind)


class Disturbance(Effect):
    """Base of disturbing forces: their parts are complete."""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        if all(getattr(self, part) is None for part in PARTS):
            raise ValueError(f"{kind} has no part; give one or several of {', '.join(PARTS)}")
        for part, partners in PARTS.items():
            present = getattr(self, part) is not None
            for field, default in partners.items():
                given = getattr(self, field)
                if given is not None and not present:
                    raise ValueError(f"{kind}.{field} is {given} without {part}; give {part}, too")
                if given is None and present:
                    if default is None:
                        raise ValueError(f"{kind}.{part} is given without {field}; give {field}, too")
                    object.__setattr__(self, field, default)
        super().__post_init__()


def from_the_start(field: str, value: float) -> float:
    """A time that is not negative, s."""
    if value < 0.0:
        raise ValueError(f"{field} is {value} s; it must not be negative")
    return value


def moderate(field: str, value: float) -> float:
    """A positive number whose products with others neither overflow nor vanish."""
    if not SMALLEST <= value <= LARGEST:
        raise ValueError(f"{field} is {value}; it must lie in {SMALLEST:g} to {LARGEST:g}")
    return value


def sizes(field: str, values: Any) -> Any:
    """Numbers of joints, at least one."""
    found = strengths(field, values)
    if found == ():
        raise ValueError(f"{field} has 0 entries; give one for each joint, or one number for all")
    return found


def deviations(field: str, values: Any) -> Any:
    """The same, none negative."""
    return not_negative(field, sizes(field, values))
