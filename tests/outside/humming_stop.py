"""A stop that hums: a force at a limit whose stiffness follows a separate oscillation."""

from dataclasses import dataclass

from two_stage_spring import beyond_knee

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force, State


@physics
def push_back(position, lower, upper, side, stiffness, hum):
    return -stiffness * (1.0 + 0.5 * hum) * beyond_knee(position, lower, upper, side)


@physics
def slope(change, frequency):
    return frequency * change


@physics
def curvature(hum, frequency):
    return -frequency * hum


@physics
def rate(frequency):
    return frequency


@physics
def stiffest(stiffness):
    return 1.5 * stiffness


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
        hum = State(
            "hum", "1", slope, bind={"change": ".change", "frequency": ".frequency"}, initial=1.0, rate=rate
        )
        change = State("change", "1", curvature, bind={"hum": ".hum", "frequency": ".frequency"}, rate=rate)
        bind = {"position": f"phi{self.joint + 1}", **own}
        switch = (".lower", ".upper")
        return (
            Force(
                self.joint, push_back, bind, stiffness=stiffest, switch=switch, states=(hum, change),
            ),
        )  # fmt: skip


rde.register_effect(HummingStop)
