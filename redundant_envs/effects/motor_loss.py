from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Hook, named
from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.effects.numbers import Example, checked, text


@dataclass(frozen=True)
class MotorLoss(MotorFault):
    """The motor of one joint gives no effort from a time on: the joint is free.

    What is behind the motor stays: friction, springs, stops. Whether it has happened is the state ``active``.

    Parameters
    ----------
    joint : float
        The joint, counted from 0: a whole number, which may be drawn ("motor_loss.joint").
    at : float
        s, not negative: the fault is there from the first control interval on that begins then or later,
        counted from the start of the motion or the episode.
    name : str, default ""
        Tells several of a scene apart: "left" makes "motor_loss_left.at".
    """

    name: str = field(default="", metadata=checked(text))

    static = ("name",)
    key = named("motor_loss_")
    example = Example({"joint": 1.0, "at": 0.1})

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return self.cuts(arm)
