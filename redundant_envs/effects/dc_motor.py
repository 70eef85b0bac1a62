from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Link, State, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, positive
from redundant_envs.language.algebra import clamp, expm1, physics


@physics
def driving_voltage(command, rate, constant, gear, voltage):
    """What is left of the supply behind the voltage that the turning motor induces."""
    return clamp(command, -voltage, voltage) - constant * gear * rate


@physics
def current_change(command, rate, current, resistance, inductance, constant, gear, voltage):
    return (driving_voltage(command, rate, constant, gear, voltage) - resistance * current) / inductance


@physics
def electrical_rate(resistance, inductance):
    return resistance / inductance


@physics
def current_after(command, rate, current, resistance, inductance, constant, gear, voltage, elapsed):
    """The current after a time at a constant rate."""
    steady = driving_voltage(command, rate, constant, gear, voltage) / resistance
    return current - (steady - current) * expm1(-(electrical_rate(resistance, inductance) * elapsed))


@physics
def effort_of(current, constant, gear):
    return constant * gear * current


@dataclass(frozen=True)
class DCMotor(Effect):
    """A motor with a winding behind a gear: L i' = u - R i - N K w, and its effort is N K i.

    Its command u is a voltage, at most that of the supply; actions are shares of the supply's voltage. The
    inertia of its rotor is an :class:`~redundant_envs.effects.Armature`.

    Each parameter is a number for all joints, or a sequence of one for each.

    Parameters
    ----------
    resistance : float
        Resistance R of the winding, ohm, positive.
    inductance : float
        Inductance L of the winding, H, positive.
    constant : float
        K, torque per current, N m/A, which is the induced voltage per speed, V s/rad, too; positive.
    gear : float
        N, turns of the motor per turn of the joint; rad/m for a slider. Positive.
    voltage : float
        Largest voltage of the supply, V, positive.
    """

    resistance: float | Numbers = field(metadata=each_joint(positive, "ohm"))
    inductance: float | Numbers = field(metadata=each_joint(positive, "H"))
    constant: float | Numbers = field(metadata=each_joint(positive, "N m/A"))
    gear: float | Numbers = field(default=1.0, metadata=each_joint(positive, "", "rad/m"))
    voltage: float | Numbers = field(default=24.0, metadata=each_joint(positive, "V"))

    example = Example(
        {"resistance": 1.0, "inductance": 0.02, "constant": 0.8, "gear": 1.0},
        curve=Curve("effort", "time", 0.5),
    )

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return tuple(f"voltage[{k}]" for k in range(len(arm.joints)))

    def taken_per_effort(self, arm: Arm) -> tuple[float, ...]:
        """Volts for each N m or N of a motor at rest, R/(N K)."""
        joints = range(len(arm.joints))
        fields = (
            x if isinstance(x, tuple) else (x,) * len(joints)
            for x in (self.resistance, self.constant, self.gear)
        )
        return tuple(r / (n * k) for r, k, n in zip(*fields, strict=True))

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        current = State(f"current[{k}]", "A", current_change, rate=electrical_rate, closed=current_after)
        return Actuation(k, effort_of, link=Link.LAG, states=(current,), takes="V")
