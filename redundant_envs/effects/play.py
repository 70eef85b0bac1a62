from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, State, at_each_joint, effort_unit
from redundant_envs.effects.numbers import COMMAND, Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import clamp, physics


@physics
def pushed(command, kept, gaps):
    """What is kept until one of the two ends of the gap pushes it."""
    return clamp(kept, command - 0.5 * gaps, command + 0.5 * gaps)


@dataclass(frozen=True)
class Play(Effect):
    """Hysteresis of the command: what leaves follows it as a pin in a slot follows the slot.

    After a reversal nothing happens until the command has crossed the gap.

    Parameters
    ----------
    gaps : float or sequence of one for each joint
        Width of the slot, in the unit of the command: N m (revolute) or N (prismatic), or V before a motor
        that takes a voltage. Not negative; one number serves all joints.
    """

    gaps: float | Numbers = field(metadata=each_joint(not_negative, COMMAND, COMMAND))

    example = Example({"gaps": 0.3}, curve=Curve("effort", "time", 1.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        state = State(f"kept[{k}]", effort_unit(arm, k), update=pushed)
        return Actuation(k, pushed, link=Link.DEAD_ZONE, states=(state,))
