"""Hooks that no effect of the package has, or has otherwise: an effect of a user keeps every promise of
``verify`` with them. What each hook does to a motion is said by an oracle of its own in this folder."""

from dataclasses import dataclass

import heun  # noqa: F401 - registers its method
import pytest
from arms import ARMS, STEPS, e
from catalogue import stops
from guards import BrakeInBands, HalfBrake
from humming_stop import HummingStop
from lag_chain import LagChain
from late_command import LateCommand, SampledBrake
from sensors import EccentricEncoders, FilteredRates
from wall import Wall

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.verify import Mode, verify
from redundant_envs.verify.report import checks_in

CHECKS = [c for c in checks_in(Mode.FULL) if c.family != "environments"]

pull = physics(lambda x2, y2, stiffness: (-stiffness * x2, -stiffness * y2))


@dataclass(frozen=True)
class RubberBand(e.Effect):
    """A spring between the second point and the base."""

    stiffness: float = 30.0

    def hooks(self, arm):
        return (e.Force(e.Point(2), pull, {"stiffness": ".stiffness"}),)


drawn = physics(lambda normal1, size: size * normal1)
knock = physics(lambda size: size)


@dataclass(frozen=True)
class Knocks(e.Effect):
    """An impulse of random size on the first joint at the start of each interval."""

    size: float = 0.05

    def hooks(self, arm):
        size = e.State("drawn", "N m s", update=drawn, bind={"size": ".size"}, initial=drawn)
        return (e.Impulse(0, knock, {"size": ".drawn"}, (size,)),)


BOUNDS = e.PrismaticStop, EccentricEncoders, FilteredRates
"""Effects of which equations of motion compute nothing."""
HOOKS = {  # effects, an arm, and steps
    "Actuation with integrated states": ((LagChain(0.04, 2), e.EffortLimits(3.0)), "3R", "heun"),
    "Force with a switch and states": ((HummingStop(1, -0.3, 0.4, 500.0, 30.0),), "4R", "dop853"),
    "Force with a guard": ((HalfBrake(), BrakeInBands()), "RRP", "1e-6"),
    "Force at a Point": ((RubberBand(),), "3R", "dop853"),
    "Impulse with draws": ((Knocks(),), "RPRP", "rk8"),
    "Gap": ((Wall(1.1, 1.0),), "3R", "rk8"),
    "Sensing": ((EccentricEncoders(0.01), FilteredRates(0.05)), "RRP", "rk4"),
    "Instants and states renewed there": ((LateCommand(0.007), SampledBrake(0.5, 0.6)), "RPRP", "1e-6"),
    "an Instant beyond the interval": ((LateCommand(1.0), SampledBrake(0.5, 0.6)), "4R", "1e-6"),
}


def scene_of(hook):
    effects, name, steps = HOOKS[hook]
    arm = ARMS[name]
    own = (stops(arm, 0.0, -0.1, 0.15),) if arm.sliders() else ()
    return rde.Scene(arm, (e.Gravity(), e.ViscousFriction(0.1), *own, *effects), **STEPS[steps])


@pytest.mark.quick("Force at a Point")
@pytest.mark.parametrize("hook", HOOKS)
def test_the_bill_has_an_effect_of_a_user(hook):
    scene = scene_of(hook)
    assert {effect.key for effect in scene.effects if not isinstance(effect, BOUNDS)} <= {*rde.bill(scene)}


@pytest.mark.long
@pytest.mark.parametrize("hook", HOOKS)
def test_an_effect_of_a_user_keeps_every_promise(hook):
    assert verify(scene_of(hook), 64, checks=CHECKS).misses == ()
