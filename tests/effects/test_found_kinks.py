"""Undeclared kinks of effects are found by running their functions on moving numbers, and watched."""

from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import floor, maximum, minimum, physics, where
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.kinks import levels_of
from studies.kinked_effects import QuadraticDrag, VelocityController

RPRP = rde.RPRP((0.5,) * 4, (0.25, 0.25))


def scene(*effects, **how):
    return rde.Scene(RPRP, effects, **(how or {"tolerance": 1e-9}))


@dataclass(frozen=True)
class Written(e.Effect):
    """An effect with given hooks."""

    given: tuple
    number: float = 0.5

    static = ("given",)

    def hooks(self, arm):
        return self.given


@physics
def at_tip(tip_x, tip_vy, s1, number):
    return abs(tip_x), where(tip_vy > number, s1, minimum(s1, 0.1))


ramp = physics(lambda x, number: maximum(x - number, 0.0))
size = physics(lambda x, number: number * abs(x))
steps = physics(lambda x, number: number * floor(x))
two_kinks = physics(lambda x, number: maximum(x - number, 0.0) + abs(x))
kept = physics(lambda value: value)
at_most = physics(lambda command, number: minimum(command, number))
towards = physics(lambda command, value, number: minimum(command - value, number))
END = {"kink": physics(lambda x, number: number - x)}
ABOVE = {"kink": physics(lambda x, number: where(number > 0.0, x - number, 1.0))}


def force(function, source, **more):
    return e.Force(1, function, {"x": source, "number": ".number"}, **more)


def motor(function, source, **more):
    return e.Actuation(0, function, {source: f".{source}", "command": "command1"}, **more)


def lag(**what):
    bind = {"value": ".value", "number": ".number", "command": "command1"}
    return motor(kept, "value", link=e.Link.LAG, states=(e.State("value", "N m", bind=bind, **what),))


LAG, HELD, CHAIN = lag(derivative=towards), lag(update=towards), motor(at_most, "number")
BRAKE = e.Actuation(
    0, physics(lambda command, rate, number: command - number * rate),
    {"rate": "phid1", "number": ".number", "command": "command1"},
)  # fmt: skip
DECLARED = motor(at_most, "number", kink=physics(lambda command, number: command - number))
HOOKS = {
    "a held command in a force": (0, force(ramp, "command2")),
    "a mass": (0, force(size, "m1")),
    "a number of the effect": (0, force(size, ".number")),
    "a state that is held": (0, HELD, CHAIN),
    "a position": (1, force(ramp, "phi2")),
    "a rate": (1, force(ramp, "phid4")),
    "a sine": (1, force(ramp, "s1")),
    "a point": (3, e.Force(e.Point(3), at_tip, {"number": ".number"})),
    "levels": (1, force(steps, "phi2")),
    "levels, and 0": (2, force(size, "phi2"), force(steps, "phi2")),
    "the derivative of a state": (1, LAG),
    "a limit behind a state": (2, LAG, CHAIN),
    "a limit behind a link without a kink": (1, BRAKE, CHAIN),
    "one that is declared": (1, force(ramp, "phi2", **END)),
    "one of two declared": (2, force(two_kinks, "phi2", **END)),
    "one that is chosen from": (1, force(ramp, "phi2", **ABOVE)),
    "in it alone": (2, force(ramp, "phi2", **ABOVE), force(ramp, "phi2")),
    "a limit that is declared": (2, LAG, DECLARED),
}
EFFECTS = {name: (count, Written(hooks)) for name, (count, *hooks) in HOOKS.items()} | {
    "a held command": (0, e.EffortLimits(3.0)),
    "a limit behind a rate": (8, VelocityController(1.0, 3.0)),
    "one in two effects": (4, QuadraticDrag(0.1), Written((force(size, "phid2"),))),
    "LimitSpring": (1, e.LimitSpring("r1", 0.0, 0.25, 1e3, 10.0)),
    "PrismaticStop": (0, e.PrismaticStop((0.0, 0.0), (0.25, 0.25)), e.Gravity()),
}


@pytest.mark.parametrize("what", EFFECTS)
def test_a_kink_is_watched_once_if_its_argument_moves(what):
    count, *effects = EFFECTS[what]
    assert len(levels_of(Features(Dynamics(scene(*effects))).kinks)) == count


@pytest.mark.parametrize(
    "made",
    [
        *(scene(QuadraticDrag(0.1), integrator=name) for name in ("rk8", "dop853")),
        *(rde.load_scene(name) for name in ("rprp_reach", "four_r_reach")),
    ],
    ids=["rk8", "dop853", "rprp_reach", "four_r_reach"],
)
def test_nothing_is_watched_without_a_tolerance_and_in_the_scenes_of_environments(made):
    assert Features(Dynamics(made)).kinks == {}
