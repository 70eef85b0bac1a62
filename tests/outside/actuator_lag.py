"""Motors whose effort lags behind the command by a first order: an effect with a state for each joint."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Actuation, Effect, Link, State


@physics
def approach(command, effort, time_constant):
    return (command - effort) / time_constant


@physics
def effort_of(effort):
    return effort


@physics
def fastest_change(time_constant):
    return 1.0 / time_constant


@dataclass(frozen=True)
class ActuatorLag(Effect):
    """The effort of each motor approaches its command: t' = (command - t) / time_constant.

    Parameters
    ----------
    time_constant : float
        s, positive.
    """

    time_constant: float

    def __post_init__(self):
        if not 0.0 < self.time_constant < float("inf"):
            raise ValueError(f"ActuatorLag.time_constant is {self.time_constant} s; it must be positive")

    def hooks(self, arm):
        return tuple(self.link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))

    def link(self, k, unit):
        own = {"effort": f".effort[{k}]", "time_constant": ".time_constant"}
        state = State(
            f"effort[{k}]",
            unit,
            derivative=approach,
            bind={"command": f"command{k + 1}", **own},
            rate=fastest_change,
        )
        return Actuation(k, effort_of, own, Link.LAG, states=(state,))


@dataclass(frozen=True)
class LagChain(ActuatorLag):
    """``count`` lags, one behind the other, between the command of each motor and its effort."""

    count: int

    static = ("count",)

    def link(self, k, unit):
        states, before = [], f"command{k + 1}"
        for name in (f"effort[{k * self.count + n}]" for n in range(self.count)):
            bind = {"command": before, "effort": f".{name}", "time_constant": ".time_constant"}
            states.append(State(name, unit, derivative=approach, bind=bind, rate=fastest_change))
            before = f".{name}"
        return Actuation(k, effort_of, {"effort": before}, Link.LAG, states=tuple(states))


rde.register_effect(ActuatorLag)
rde.register_effect(LagChain)
