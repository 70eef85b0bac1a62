from dataclasses import dataclass

from redundant_envs.effects.hooks import Arm, Hook, named
from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.effects.numbers import Curve, Example


@dataclass(frozen=True)
class MotorLoss(MotorFault):
    """The motor of one joint gives no effort from a time on: the joint is free.

    What is behind the motor stays: friction, springs, stops. Whether it has happened is the state ``active``.
    """

    key = named("motor_loss_")
    example = Example({"joint": 1.0, "at": 0.1}, curve=Curve("effort", "time", 0.5))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return self.cuts(arm)
