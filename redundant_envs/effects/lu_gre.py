from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, State, at_each_joint
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, not_negative, positive
from redundant_envs.language.algebra import exp, expm1, identity, physics, where


@physics
def level(rate, coulomb, stiction, stribeck_speed):
    """Friction at a constant rate, without its viscous part: from the stiction down to the Coulomb level."""
    return coulomb + (stiction - coulomb) * exp(-((1.0 / stribeck_speed * rate) ** 2))


@physics
def decay(rate, stiffness, coulomb, stiction, stribeck_speed):
    """How fast bristles forget how they were bent, 1/s."""
    return stiffness * abs(rate) / level(rate, coulomb, stiction, stribeck_speed)


@physics
def bending(rate, bristle, stiffness, coulomb, stiction, stribeck_speed):
    return rate - decay(rate, stiffness, coulomb, stiction, stribeck_speed) * bristle


@physics
def bent(rate, bristle, stiffness, coulomb, stiction, stribeck_speed, elapsed):
    """Deflection after a time at a constant rate: it approaches that of sliding, g(v) sign(v) / sigma0."""
    slid = 1.0 / stiffness * level(rate, coulomb, stiction, stribeck_speed)
    steady = where(rate < 0.0, -slid, slid)
    x = decay(rate, stiffness, coulomb, stiction, stribeck_speed) * elapsed
    return bristle - (steady - bristle) * expm1(-x)


@physics
def force(rate, bristle, stiffness, damping, viscous, coulomb, stiction, stribeck_speed):
    change = bending(rate, bristle, stiffness, coulomb, stiction, stribeck_speed)
    return -(stiffness * bristle + damping * change + viscous * rate)


@dataclass(frozen=True)
class LuGre(Effect):
    """Friction of bristles: stiff and elastic before it slips, and weaker when it slips fast.

    With the deflection z of the bristles of a joint of rate v the friction is
    sigma0 z + sigma1 z' + sigma2 v, where z' = v - sigma0 abs(v) z / g(v) and
    g(v) = F_C + (F_S - F_C) exp(-(v / v_S)^2).

    Each parameter is a number for all joints, or a sequence of one for each.

    Parameters
    ----------
    stiffness : float
        sigma0 of the bristles, N m/rad (revolute) or N/m (prismatic), positive.
    damping : float
        sigma1 of the bristles, N m s/rad or N s/m, not negative.
    viscous : float
        Viscous friction sigma2, N m s/rad or N s/m, not negative.
    coulomb : float
        F_C, friction at high rates, N m or N, positive.
    stiction : float
        F_S, friction from which on a joint at rest slips, N m or N, at least ``coulomb``.
    stribeck_speed : float
        v_S, rate at which the friction falls from one to the other, rad/s or m/s, positive.
    """

    stiffness: float | Numbers = field(metadata=each_joint(positive, "N m/rad", "N/m"))
    damping: float | Numbers = field(metadata=each_joint(not_negative, "N m s/rad", "N s/m"))
    viscous: float | Numbers = field(metadata=each_joint(not_negative, "N m s/rad", "N s/m"))
    coulomb: float | Numbers = field(metadata=each_joint(positive, "N m", "N"))
    stiction: float | Numbers = field(metadata=each_joint(positive, "N m", "N"))
    stribeck_speed: float | Numbers = field(default=0.01, metadata=each_joint(positive, "rad/s", "m/s"))

    example = Example(
        {"stiffness": 100.0, "damping": 1.0, "viscous": 0.1, "coulomb": 0.5, "stiction": 0.7,
         "stribeck_speed": 0.1}, curve=Curve("rate", "time", 0.5))  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        levels = self.coulomb, self.stiction
        most = max(len(x) if isinstance(x, tuple) else 1 for x in levels)
        rows = (x if isinstance(x, tuple) else (x,) * most for x in levels)
        for k, (low, high) in enumerate(zip(*rows, strict=False)):  # a scene refuses other counts
            if high < low:
                raise ValueError(
                    f"LuGre.stiction is {high} and LuGre.coulomb {low} at joint {k + 1}; give a "
                    "stiction of at least the Coulomb level"
                )

    @at_each_joint
    def hooks(self, k: int, arm: Arm) -> Hook:
        bristle = State(f"bristle[{k}]", "m" if arm.prismatic[k] else "rad", bending, closed=bent)
        return Force(k, force, states=(bristle,), stiffness=identity("stiffness"))
