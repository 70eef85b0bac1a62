"""A stop that hums: a force at a limit whose stiffness follows a separate oscillation."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force, State
from redundant_envs.effects.limit_spring import depth_beyond


@physics
def push_back(position, lower, upper, side, stiffness, hum):
    return -stiffness * (1.0 + 0.5 * hum) * depth_beyond(position, lower, upper, side)


slope = physics(lambda change, frequency: frequency * change)
curvature = physics(lambda hum, frequency: -frequency * hum)
fastest = physics(lambda frequency: frequency)
stiffest = physics(lambda stiffness: 1.5 * stiffness)


@dataclass(frozen=True)
class HummingStop(Effect):
    """Beyond ``lower`` and ``upper`` of a joint [rad or m] its stiffness [N m/rad or N/m] rises and falls by
    a half, with ``frequency`` [rad/s]."""

    joint: int
    lower: float
    upper: float
    stiffness: float
    frequency: float

    static = ("joint",)

    def hooks(self, arm):
        own = {name: f".{name}" for name in ("lower", "upper", "stiffness", "hum")}
        with_hum, with_change = ({x: f".{x}", "frequency": ".frequency"} for x in ("hum", "change"))
        states = (
            State("hum", "1", slope, bind=with_change, initial=1.0, rate=fastest),
            State("change", "1", curvature, bind=with_hum, rate=fastest),
        )
        bind, switch = {"position": f"phi{self.joint + 1}", **own}, (".lower", ".upper")
        return (Force(self.joint, push_back, bind, stiffness=stiffest, switch=switch, states=states),)


rde.register_effect(HummingStop)
