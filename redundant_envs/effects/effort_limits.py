from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, at_each_joint, effort_unit
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import clamp, physics, where

WITHIN = 1e-12
"""Share of a limit by which a command may exceed it, and counts as within: the effort of a motor that has the
same limit stays there, and rounding would cross it again and again."""


@physics
def saturate(command, limits):
    return clamp(command, -limits, limits)


@physics
def beyond(command, limits):
    """By how much a command is above the limits."""
    most = limits * (1.0 + WITHIN)
    return command - most, command + most


@physics
def clipped(command, limits, side1, side2):
    return where(side1 > 0.0, limits, where(side2 < 0.0, -limits, command))


@dataclass(frozen=True)
class EffortLimits(Effect):
    """Largest effort of each motor; a larger command is clipped to the limit, as in a real motor.

    Parameters
    ----------
    limits : float or sequence of one for each joint
        Largest effort of each motor, N m (revolute) or N (prismatic), not negative.
    """

    limits: float | Numbers = field(metadata=each_joint(not_negative, "N m", "N"))

    example = Example(
        {"limits": (20.0, 12.0, 8.0, 4.0)}, zero={"limits": 1e9}, curve=Curve("force", "command", 20.0)
    )

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Actuation(k, saturate, guard=beyond, by_side=clipped, takes=effort_unit(arm, k))

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return tuple(f"limits[{k}]" for k in range(len(arm.joints)))
