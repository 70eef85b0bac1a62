from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Hook, Inertia, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative


@dataclass(frozen=True)
class Armature(Effect):
    """Inertias of rotors that turn with the joints, behind gears.

    Parameters
    ----------
    inertias : float or sequence of one for each joint
        Inertia of the rotor times the square of the gear ratio, kg m^2 (revolute) or kg (prismatic), not
        negative, at most a million times the lightest mass on the shortest link; one number serves all
        joints.
    """

    inertias: float | Numbers = field(metadata=each_joint(not_negative))

    example = Example({"inertias": 0.01}, curve=Curve("rate", "time", 0.4))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        return Inertia((k,), f".inertias[{k}]")
