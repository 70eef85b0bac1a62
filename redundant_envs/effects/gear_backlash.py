from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, State, at_each_joint, effort_unit
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative, positive
from redundant_envs.language.algebra import identity, maximum, physics, sqrt, where


@physics
def contacts(angle, position, gap):
    """By how much the motor is beyond the teeth ahead of it, and before those behind it."""
    lead = angle - position
    return lead - 0.5 * gap, lead + 0.5 * gap


@physics
def teeth(angle, speed, position, rate, gap, stiffness, damping, side1, side2):
    """The effort that the teeth carry: a spring whose damping grows with its depth, and that never pulls."""
    ahead, behind = contacts(angle, position, gap)
    closing = speed - rate
    forward = where(side1 > 0.0, ahead * maximum(stiffness + damping * closing, 0.0), 0.0)
    return forward + where(side2 < 0.0, behind * maximum(stiffness - damping * closing, 0.0), 0.0)


@physics
def motor_acceleration(command, angle, speed, position, rate, gap, stiffness, damping, inertia, side1, side2):
    carried = teeth(angle, speed, position, rate, gap, stiffness, damping, side1, side2)
    return (command - carried) / inertia


@physics
def oscillation(stiffness, inertia):
    """Rate of the motor's oscillation on its teeth."""
    return sqrt(stiffness / inertia)


@dataclass(frozen=True)
class GearBacklash(Effect):
    """A motor with an inertia of its own drives its joint by elastic teeth with a gap between them.

    All numbers are those at the joint: a motor's inertia times the gear ratio squared, its angle divided by
    the ratio. At the start of a motion the motor is in the middle of the gap, and turns as the joint does.

    Each parameter is a number for all joints, or a sequence of one for each.

    Parameters
    ----------
    gap : float
        Whole width between the teeth, rad (revolute) or m (prismatic), not negative.
    stiffness : float
        Stiffness k of the teeth, N m/rad or N/m, positive.
    inertia : float
        Inertia J of the motor, kg m^2 or kg, positive.
    damping : float
        Damping c of the teeth per depth, N m s/rad^2 or N s/m^2, not negative.
    """

    gap: float | Numbers = field(metadata=each_joint(not_negative, "rad", "m"))
    stiffness: float | Numbers = field(metadata=each_joint(positive, "N m/rad", "N/m"))
    inertia: float | Numbers = field(metadata=each_joint(positive, "kg m^2", "kg"))
    damping: float | Numbers = field(default=0.0, metadata=each_joint(not_negative, "N m s/rad^2", "N s/m^2"))

    example = Example(
        {"gap": 0.02, "stiffness": 500.0, "inertia": 0.02, "damping": 10.0}, curve=Curve("rate", "time", 0.5)
    )

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        unit = "m" if arm.prismatic[k] else "rad"
        angle = State(f"angle[{k}]", unit, identity("speed"), initial=identity("position"))
        speed = State(
            f"speed[{k}]", f"{unit}/s", motor_acceleration, initial=identity("rate"), rate=oscillation
        )
        takes = effort_unit(arm, k)
        return Actuation(k, teeth, link=Link.GEAR, states=(angle, speed), guard=contacts, takes=takes)
