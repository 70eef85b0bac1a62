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
class LagChain(Effect):
    """``count`` lags of first order, ``time_constant`` [s] each, between a motor's command and its effort."""

    time_constant: float
    count: int

    static = ("count",)

    def hooks(self, arm):
        return tuple(self._chain(joint) for joint in range(len(arm.joints)))

    def _chain(self, joint):
        names = [f"effort[{joint * self.count + k}]" for k in range(self.count)]
        inputs = [f"command{joint + 1}", *(f".{name}" for name in names)]
        states = [
            State(
                name, "N m", approach, rate=fastest_change,
                bind={"command": before, "effort": f".{name}", "time_constant": ".time_constant"},
            )
            for name, before in zip(names, inputs, strict=False)
        ]  # fmt: skip
        return Actuation(joint, effort_of, {"effort": f".{names[-1]}"}, Link.LAG, states=tuple(states))


rde.register_effect(ActuatorLag)
rde.register_effect(LagChain)
