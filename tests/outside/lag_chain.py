"""Motors with a row of lags: an effect whose states follow each other."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.effects import Actuation, Effect, Link, State
from tests.verify.aimed import approach, effort_of, fastest_change


@dataclass(frozen=True)
class LagChain(Effect):
    """``count`` lags of a time constant [s], one behind the other, between the command of each motor and its
    effort."""

    time_constant: float
    count: int = 1

    static = ("count",)

    def __post_init__(self):
        if not 0.0 < self.time_constant < float("inf"):
            raise ValueError(f"LagChain.time_constant is {self.time_constant} s; it must be positive")

    def hooks(self, arm):
        return tuple(self.link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))

    def link(self, k, unit):
        states, before = [], f"command{k + 1}"
        for name in (f"effort[{k * self.count + n}]" for n in range(self.count)):
            bind = {"command": before, "effort": f".{name}", "time_constant": ".time_constant"}
            states.append(State(name, unit, derivative=approach, bind=bind, rate=fastest_change))
            before = f".{name}"
        return Actuation(k, effort_of, {"effort": before}, Link.LAG, states=tuple(states))


rde.register_effect(LagChain)
