from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, State, at_each_joint, effort_unit
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, positive
from redundant_envs.language.algebra import expm1, identity, physics


@physics
def approach(command, effort, time_constant):
    return (command - effort) / time_constant


@physics
def approached(command, effort, time_constant, elapsed):
    """The effort after a time under a constant command."""
    return effort - (command - effort) * expm1(-(1.0 / time_constant * elapsed))


@physics
def fastest_change(time_constant):
    return 1.0 / time_constant


@dataclass(frozen=True)
class Lag(Effect):
    """The effort t of each motor approaches its command u: t' = (u - t) / T.

    Parameters
    ----------
    time_constant : float or sequence of one for each joint
        Time constant T, s, positive; one number serves all joints.
    """

    time_constant: float | Numbers = field(metadata=each_joint(positive, "s"))

    example = Example({"time_constant": 0.03}, curve=Curve("effort", "time", 0.5))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        state = State(f"effort[{k}]", effort_unit(arm, k), approach, rate=fastest_change, closed=approached)
        return Actuation(k, identity("effort"), link=Link.LAG, states=(state,))
