"""Arms, states, every effect of the package, and effects that a user might write."""

from dataclasses import dataclass

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import CentringSpring, EffortLimits, Gravity, LimitSpring, ViscousFriction
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.robots.parameters import number

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
ROBOTS = {"RPRP": RPRP, "FourR": FOUR_R}
EVERY = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
Q0 = np.array([-1.2, 0.15, -0.4, 0.1])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])


@physics
def stiffening(position, k):
    return -k * position**3


@physics
def stiffening_energy(position, k):
    return 0.25 * k * position**4


@dataclass(frozen=True)
class StiffeningSpring(Effect):
    """A spring of the third power on joint 3."""

    k: float

    def __post_init__(self):
        object.__setattr__(self, "k", number("StiffeningSpring.k", self.k))

    def hooks(self, arm):
        bind = {"position": "phi3", "k": ".k"}
        return (Force(2, stiffening, bind, potential=stiffening_energy, conservative=stiffening),)


@physics
def drag(tip_x, tip_vx, rate, k):
    return -k * rate * (1.0 + tip_x**2 + tip_vx**2)


@dataclass(frozen=True)
class TipDrag(Effect):
    """A dissipative force on joint 4 that needs quantities of the tip."""

    k: float = 0.2

    def hooks(self, arm):
        return (Force(3, drag, {"rate": "phid4", "k": ".k"}),)


@physics
def soft(position, rate, k, c):
    return -k * position - c * rate


@physics
def soft_spring(position, k):
    return -k * position


@physics
def soft_energy(position, k):
    return 0.5 * k * position**2


@dataclass(frozen=True)
class SoftJoint(Effect):
    """Spring and damper in one force: only the spring is booked as potential."""

    k: float = 3.0
    c: float = 0.4

    def hooks(self, arm):
        bind = {"position": "phi1", "rate": "phid1", "k": ".k", "c": ".c"}
        return (Force(0, soft, bind, potential=soft_energy, conservative=soft_spring),)


def all_effects(robot):
    """Every effect of the package that fits the arm, all of them acting from Q0."""
    found = [
        Gravity.on_plane(9.81, 0.4, 0.7),
        ViscousFriction((0.3, 0.2, 0.1, 0.05)),
        EffortLimits((2.0, 1.0, 0.5, 0.25)),
    ]
    if robot.kind == "RPRP":
        found.append(CentringSpring((20.0, 30.0), (0.0, -0.1), (0.3, 0.2)))
        found.append(LimitSpring("r1", 0.0, 0.1, 400.0, 3.0))
        found.append(LimitSpring("r2", -0.1, 0.05, 500.0, 0.0))
    else:
        found.append(LimitSpring("joint2", -0.3, 0.3, 60.0, 2.0))
        found.append(LimitSpring("joint1", -0.5, 2.0, 50.0, 0.0))
    return tuple(found)
