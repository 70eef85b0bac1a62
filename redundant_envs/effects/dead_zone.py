from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, at_each_joint
from redundant_envs.effects.numbers import COMMAND, Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import clamp, physics


@physics
def beyond(command, widths):
    """The part of a command that is beyond the dead zone."""
    return command - clamp(command, -widths, widths)


@dataclass(frozen=True)
class DeadZone(Effect):
    """Commands within a width of zero have no effect, and larger ones are smaller by it.

    Parameters
    ----------
    widths : float or sequence of one for each joint
        In the unit of the command: N m (revolute) or N (prismatic), or V before a motor that takes a voltage.
        Not negative; one number serves all joints.
    """

    widths: float | Numbers = field(metadata=each_joint(not_negative, COMMAND, COMMAND))

    example = Example({"widths": 0.3}, curve=Curve("force", "command", 1.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Actuation(k, beyond, link=Link.DEAD_ZONE)
