"""What disturbing forces at the tip and at joints have in common: their laws, their states, their checks.

A disturbance has up to four parts, each of which is absent unless its numbers are given: a step, a periodic
force, white noise, and an Ornstein-Uhlenbeck process.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from redundant_envs.effects.hooks import Effect, Force, Point, State
from redundant_envs.language.algebra import exp, physics, sincos, sqrt, where
from redundant_envs.robots.parameters import LARGEST, SMALLEST, between

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
def step(elapsed, start, control_dt, step):
    """From the first control interval on that begins at the time ``start`` or later."""
    return where(elapsed >= start - ROUNDING * control_dt, step, 0.0)


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
def wandering(wander, deviation, time_constant, control_dt, normal1):
    """The exact law of an Ornstein-Uhlenbeck process from one instant to another (Gillespie 1996)."""
    decay = exp(-control_dt / time_constant)
    return wander * decay + deviation * sqrt(1.0 - decay * decay) * normal1


@physics
def stationary(deviation, normal1):
    return deviation * normal1


class Disturbance(Effect):
    """Base of disturbing forces: their parts are complete."""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        if all(getattr(self, part) is None for part in PARTS):
            raise ValueError(f"{kind} has no part; give one or several of {', '.join(PARTS)}")
        for part, partners in PARTS.items():
            present = getattr(self, part) is not None
            for field, default in partners.items():
                value = getattr(self, field)
                if value is not None and not present:
                    raise ValueError(f"{kind}.{field} is {value} without {part}; give {part}, too")
                if value is None and present:
                    if default is None:
                        raise ValueError(f"{kind}.{part} is given without {field}; give {field}, too")
                    object.__setattr__(self, field, default)
        super().__post_init__()

    def forces(
        self, place: int | Point, entries: Sequence[str], unit: str, laws: Iterable[Callable[..., Any]]
    ) -> list[Force]:
        """Forces of the parts that are given, at a joint or a point, with the laws of all parts; ``entries``,
        "[k]", are those of the numbers. The first joint has the states that all share."""
        shared = place == 0 or isinstance(place, Point)
        states = (
            (State("elapsed", "s", update=later),) if shared else (),  # at the beginning of an interval
            (State("angle", "rad", derivative=angular_rate),) if shared else (),  # without the phase
            tuple(State(f"white{k}", unit, update=white, initial=white) for k in entries),
            tuple(State(f"wander{k}", unit, update=wandering, initial=stationary) for k in entries),
        )
        every = zip(PARTS, laws, states, strict=True)
        return [
            Force(place, law, states=part_states)
            for part, law, part_states in every
            if getattr(self, part) is not None
        ]

    def value(self, known: Mapping[str, float], entry: int) -> float:
        """What acts now, from the effect's states: the sum of its parts."""
        own: Any = self
        of_entry = {name: getattr(own, name)[entry] for name in PARTS if getattr(own, name) is not None}
        present: dict[str, Callable[[], float]] = {
            "step": lambda: step(known["elapsed"], own.start, 0.0, of_entry["step"]),
            "amplitude": lambda: periodic(known["angle"], own.phase[entry], of_entry["amplitude"]),
            "density": lambda: known[f"white[{entry}]"],
            "deviation": lambda: known[f"wander[{entry}]"],
        }
        return sum(present[name]() for name in of_entry)


def moderate(field: str, value: float) -> float:
    """A positive number whose products with others neither overflow nor vanish."""
    return between(field, value, SMALLEST, LARGEST)
