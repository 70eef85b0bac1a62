from dataclasses import dataclass

from redundant_envs.effects.hooks import Arm, Hook, Impact
from redundant_envs.effects.joint_stop import JointStop
from redundant_envs.effects.numbers import Example
from redundant_envs.robots.parameters import for_sliders


@dataclass(frozen=True)
class PrismaticStop(JointStop):
    """Limited travel of the sliders of an arm, as the text of the report describes it.

    A slider that reaches an end of its travel turns back with ``restitution`` times its speed, by
    an impulse along it that moves the whole arm, M dqd = e_j lambda. Impacts are located in time by
    stepping to them; a slider never is beyond its stop. When its bounces stay below 1e-9 m, a slider comes to
    rest at the stop, and it leaves the stop when it is pulled away.

    Parameters
    ----------
    lower, upper : sequences of one for each slider
        Ends of the travel of r1, r2, ..., m; None for an end without a stop.
    restitution : float
        Speed after an impact over speed before, 0 to 1.
    """

    # No zero: without ends a motion agrees to rounding only, by the equations of sliders that may rest.
    example = Example({"lower": (0.0, 0.0), "upper": (0.25, 0.25), "restitution": 0.0})

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        sliders = for_sliders("PrismaticStop", arm.kind, arm.sliders(), len(self.lower))
        return tuple(Impact(k, f".lower[{i}]", f".upper[{i}]", ".restitution") for i, k in enumerate(sliders))

    def _limited(self) -> list[int]:
        """All sliders: each has both numbers, which then may be changed."""
        return [*range(len(self.lower))]
