"""Motors behind a row of equal lags: commands arrive late, and smoothly."""

from dataclasses import dataclass

from actuator_lag import approach, effort_of, fastest_change

import redundant_envs as rde
from redundant_envs.effects import Actuation, Effect, Link, State


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


rde.register_effect(LagChain)
