from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Friction, Hook, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative
from redundant_envs.language.algebra import identity


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Dry friction that holds a joint, or opposes its rate with a constant force (Coulomb 1785).

    A joint sticks as long as a force of at most its level holds it: its rate is 0 exactly, and it does not
    creep. While it slips, the force has the size of the level and opposes the rate. Which joints stick is
    decided for all joints together, and when they come to rest and are torn loose is located in time.

    Parameters
    ----------
    level : float or sequence of one for each joint
        Largest force of the friction, N m (revolute) or N (prismatic), not negative; one number serves all
        joints.
    """

    level: float | Numbers = field(metadata=each_joint(not_negative, "N m", "N"))

    example = Example({"level": (1.0, 0.6, 0.4, 0.2)}, curve=Curve("force", "rate", 2.0))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Friction(k, identity("level"))
