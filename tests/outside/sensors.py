"""Encoders whose discs are mounted off their centres, and rates that come through a filter."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import exp, physics, sincos
from redundant_envs.effects import Effect, Reading, Sensing, State
from redundant_envs.robots.parameters import not_negative, positive


@physics
def off_centre(reading, eccentricity):
    """The reading leads and lags once in a turn."""
    sine, _ = sincos(reading)
    return reading + eccentricity * sine


@physics
def filtered(reading, last, time_constant, control_dt):
    """A first-order lag, exact for a reading that is constant in the interval."""
    return reading + (last - reading) * exp(-control_dt / time_constant)


first = physics(lambda reading: reading)
shown = physics(lambda last: last)


@dataclass(frozen=True)
class EccentricEncoders(Effect):
    """Eccentricity of the disc of each revolute joint's encoder, in units of the disc's radius."""

    eccentricity: float

    def __post_init__(self):
        object.__setattr__(
            self, "eccentricity", not_negative("EccentricEncoders.eccentricity", self.eccentricity)
        )

    def hooks(self, arm):
        bind = {"eccentricity": ".eccentricity"}
        joints = (k for k, slides in enumerate(arm.prismatic) if not slides)
        return tuple(Sensing(k, off_centre, {"reading": f"phi{k + 1}", **bind}) for k in joints)


@dataclass(frozen=True)
class FilteredRates(Effect):
    """Time constant of the filter of each rate sensor, s, positive; it has settled when an episode begins."""

    time_constant: float

    def __post_init__(self):
        positive("FilteredRates.time_constant", self.time_constant)

    def hooks(self, arm):
        return tuple(self.sensor(k, arm) for k in range(len(arm.joints)))

    def sensor(self, k, arm):
        name, unit = f"last[{k}]", "m/s" if arm.prismatic[k] else "rad/s"
        bind = {"reading": f"phid{k + 1}", "last": f".{name}", "time_constant": ".time_constant"}
        state = State(name, unit, update=filtered, initial=first, bind=bind)
        return Sensing(k, shown, {"last": f".{name}"}, Reading.RATE, (state,))


rde.register_effect(EccentricEncoders)
rde.register_effect(FilteredRates)
