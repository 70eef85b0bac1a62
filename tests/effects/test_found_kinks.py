"""Undeclared kinks of effects are found by running their functions on moving numbers, and watched."""

from dataclasses import dataclass

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import floor, maximum, minimum, physics, where
from redundant_envs.effects import (
    Actuation,
    Effect,
    EffortLimits,
    Force,
    Gravity,
    LimitSpring,
    Link,
    Point,
    PrismaticStop,
    State,
)  # fmt: skip
from redundant_envs.events import crossings
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.kinks import levels_of
from redundant_envs.numerics.methods import Watched
from redundant_envs.studies.kinked_effects import QuadraticDrag, VelocityController

RPRP = rde.RPRP((0.5,) * 4, (0.25, 0.25))
FOUR_R = rde.FourR((0.5,) * 4, (0.25,) * 4)
EXACT = {"tolerance": 1e-9}


def scene(*effects, arm=RPRP, **how):
    return rde.Scene(arm, effects, control_dt=0.02, **(how or EXACT))


@dataclass(frozen=True)
class Written(Effect):
    """An effect with given hooks."""

    given: tuple
    number: float = 0.5

    static = ("given",)

    def hooks(self, arm):
        return self.given


@physics
def ramp(x, number):
    return maximum(x - number, 0.0)


@physics
def from_end(x, number):
    return number - x


@physics
def only_above(x, number):
    return where(number > 0.0, x - number, 1.0)


@physics
def at_most_here(command, number):
    return command - number


@physics
def two_kinks(x, number):
    return maximum(x - number, 0.0) + abs(x)


@physics
def size(x, number):
    return number * abs(x)


@physics
def steps(x, number):
    return number * floor(x)


@physics
def at_tip(tip_x, tip_vy, s1, number):
    return abs(tip_x), where(tip_vy > number, s1, minimum(s1, 0.1))


@physics
def kept(value):
    return value


@physics
def towards(command, value, number):
    return minimum(command - value, number)


@physics
def at_most(command, number):
    return minimum(command, number)


def force(function, source, **more):
    return Force(1, function, {"x": source, "number": ".number"}, **more)


LAGS = {"value": ".value", "number": ".number", "command": "command1"}
LAG = Actuation(0, kept, LAGS, Link.LAG, states=(State("value", "N m", towards, bind=LAGS),))
HELD = Actuation(0, kept, LAGS, Link.LAG, states=(State("value", "N m", update=towards, bind=LAGS),))
LIMITS = {"command": "command1", "number": ".number"}
CHAIN = Actuation(0, at_most, LIMITS)
DECLARED = Actuation(0, at_most, LIMITS, kink=at_most_here)


@pytest.mark.parametrize(
    ("effects", "count"),
    [
        pytest.param((EffortLimits(3.0),), 0, id="a held command"),
        pytest.param((Written((force(ramp, "command2"),)),), 0, id="a held command in a force"),
        pytest.param((Written((force(size, "m1"),)),), 0, id="a mass"),
        pytest.param((Written((force(size, ".number"),)),), 0, id="a number of the effect"),
        pytest.param((Written((HELD, CHAIN)),), 0, id="a state that is held"),
        pytest.param((Written((force(ramp, "phi2"),)),), 1, id="a position"),
        pytest.param((Written((force(ramp, "phid4"),)),), 1, id="a rate"),
        pytest.param((Written((force(ramp, "s1"),)),), 1, id="a sine"),
        pytest.param((Written((Force(Point(3), at_tip, {"number": ".number"}),)),), 3, id="a point"),
        pytest.param((Written((force(steps, "phi2"),)),), 1, id="levels"),
        pytest.param((Written((force(size, "phi2"), force(steps, "phi2"))),), 2, id="levels, and 0"),
        pytest.param((Written((LAG,)),), 1, id="the derivative of a state"),
        pytest.param((Written((LAG, CHAIN)),), 2, id="a limit behind a state"),
        pytest.param((VelocityController(1.0, 3.0),), 8, id="a limit behind a rate"),
        pytest.param((QuadraticDrag(0.1), Written((force(size, "phid2"),))), 4, id="one in two effects"),
        pytest.param((Written((force(ramp, "phi2", kink=from_end),)),), 1, id="one that is declared"),
        pytest.param((Written((force(two_kinks, "phi2", kink=from_end),)),), 2, id="one of two declared"),
        pytest.param((Written((force(ramp, "phi2", kink=only_above),)),), 1, id="one that is chosen from"),
        pytest.param(
            (Written((force(ramp, "phi2", kink=only_above), force(ramp, "phi2"))),),
            2,
            id="in it alone",
        ),
        pytest.param((Written((LAG, DECLARED)),), 2, id="a limit that is declared"),
        pytest.param((LimitSpring("r1", 0.0, 0.25, 1e3, 10.0),), 1, id="LimitSpring"),
        pytest.param((PrismaticStop((0.0, 0.0), (0.25, 0.25)), Gravity()), 0, id="PrismaticStop"),
    ],
)
def test_a_kink_is_watched_once_if_its_argument_moves(effects, count):
    assert len(levels_of(Dynamics(scene(*effects)).kinks)) == count


@pytest.mark.parametrize("how", [{"integrator": "rk8"}, {"integrator": "dop853"}])
def test_nothing_is_watched_where_no_tolerance_is_asked_for(how):
    assert Dynamics(scene(QuadraticDrag(0.1), **how)).kinks == {}


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_nothing_is_watched_in_the_scenes_of_the_environments(name):
    assert Dynamics(rde.load_scene(f"configs/scenes/{name}.yaml")).kinks == {}


@pytest.mark.parametrize("levels", [False, True])
@pytest.mark.parametrize(
    ("stages", "met"),  # first, last, least, most
    [
        ((-0.5, 0.5, -0.5, 0.5), "seen"),
        ((0.5, -0.5, -0.5, 0.5), "seen"),
        ((0.9, 0.8, 0.01, 0.9), "hidden"),
        ((-0.9, -0.8, -0.9, -0.01), "hidden"),
        ((0.9, 0.001, 0.001, 0.9), "hidden"),
        ((0.9, 0.1, 0.1, 0.9), "no"),
        ((0.9, 0.8, 0.3, 0.9), "no"),
    ],
)
def test_a_kink_is_met_where_its_value_passes_0_or_may_do_so_between_stages(stages, met, levels):
    made = Interval(Dynamics(scene(QuadraticDrag(0.1))))
    seen, hidden = crossings.meets_kink(Watched(*stages), levels, made.dynamics.overshoot)
    assert (bool(seen), bool(hidden)) == (met == "seen", met == "hidden")


def test_a_kink_at_each_whole_number_is_met_at_others_than_0():
    overshoot = Dynamics(scene(QuadraticDrag(0.1))).overshoot
    for least, most, met in ((2.5, 3.5, True), (2.2, 2.8, False), (-1.5, -0.5, True)):
        assert bool(crossings.meets_kink(Watched(least, most, least, most), True, overshoot)[0]) is met


def test_a_motion_that_starts_at_a_kink_leaves_it():
    overshoot = Dynamics(scene(QuadraticDrag(0.1))).overshoot
    assert not any(crossings.meets_kink(Watched(0.0, 0.9, 0.0, 0.9), False, overshoot))


# ---- the tolerance is kept ----------------------------------------------------------------------------


def tips(made, q, qd, efforts, parameters=None, parts=1):
    """Tips after an interval in so many parts; which lanes have no flag; rates and evaluations on the way."""
    batch = rde.BatchSimulator(made, len(q))
    batch.set_parameters(parameters or {})
    batch.set_state(q, qd)
    rates = []
    for _ in range(parts):
        rates.append(batch.qd @ np.asarray(made.robot.motor_map))
        status = batch.advance_partly(efforts, made.control_dt / parts)
    return made.robot.forward_kinematics(batch.q), status.numerics == 0, np.array(rates)


def off(made, *states, **numbers):
    """Errors of intervals without a flag, in units of the tolerance, where the reference is sure."""
    own, good, _ = tips(made, *states, **numbers)
    fine, coarse = (
        tips(scene(*made.effects, arm=made.robot, **how), *states, **numbers)[0]
        for how in ({"integrator": "rk8", "substeps": 1024}, {"integrator": "dop853"})
    )
    sure = np.linalg.norm(fine - coarse, axis=1) < 0.1 * made.tolerance
    assert good.mean() > 0.99
    assert (good & sure).mean() > 0.95
    return np.linalg.norm(own - fine, axis=1)[good & sure] / made.tolerance


class Unwatched(QuadraticDrag):
    """Drag whose kinks are not searched."""


def turning(arm, count, seed):
    """Joints that move slowly, and turn."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(np.where(arm.prismatic, 0.0, -3.0), np.where(arm.prismatic, 0.25, 3.0), (count, 4))
    return q, rng.normal(0.0, 0.1, (count, 4)), rng.normal(0.0, 4.0, (count, 4))


@pytest.mark.parametrize("arm", [RPRP, pytest.param(FOUR_R, marks=pytest.mark.long)], ids=["RPRP", "4R"])
def test_the_drag_of_the_documentation_keeps_the_tolerance(arm):
    assert off(scene(QuadraticDrag(3.0), arm=arm), *turning(arm, 2048, seed=2)).max() < 1.0


def test_without_its_kinks_the_drag_of_the_documentation_misses_the_tolerance(monkeypatch):
    monkeypatch.setattr(Dynamics, "kinks", {})
    assert off(scene(Unwatched(3.0), arm=RPRP), *turning(RPRP, 2048, seed=2)).max() > 1.0


STAGES = ((0.118, 0.25), (0.333, 0.6), (0.651, 0.857))
"""Times in a step between which rk8 has no stage."""


def reached_between_stages(count, seed, share):
    """Motors that hold a rate, with limits a little below the largest effort that they need between two
    stages."""
    rng, parts, gain = np.random.default_rng(seed), 200, 2.0
    scale = np.where(RPRP.prismatic, 1.0, 6.0)
    q = rng.uniform(np.where(RPRP.prismatic, 0.0, -3.0), np.where(RPRP.prismatic, 0.25, 3.0), (count, 4))
    qd = rng.normal(0.0, scale, (count, 4))
    efforts = rng.uniform(-1.0, 1.0, (count, 4)) * np.where(RPRP.prismatic, 10.0, 4.0)
    made = scene(Gravity(), VelocityController(gain, 100.0))
    free = scene(*made.effects, integrator="dop853")
    asked = np.abs(efforts - gain * tips(free, q, qd, efforts, parts=parts)[2])
    last, limits = asked.argmax(axis=0), np.full((count, 4), 100.0)
    for start, end in STAGES:
        for lane, joint in zip(*np.nonzero((last > start * parts) & (last < end * parts)), strict=True):
            one = asked[:, lane, joint]
            edge = max(one[int(np.ceil(start * parts))], one[int(end * parts)])
            limits[lane, joint] = edge + share * (one.max() - edge)
    lanes = (limits < 100.0).any(axis=1)
    numbers = {"velocity_controller.limits": limits[lanes]}
    return made, (q[lanes], qd[lanes], efforts[lanes]), numbers


def test_a_limit_that_is_reached_and_left_between_two_stages_is_seen():
    """With twice as many steps it may be between two of their stages, too."""
    made, states, numbers = reached_between_stages(2048, 23, 0.05)
    assert len(states[0]) > 200
    assert off(made, *states, parameters=numbers).max() < 2.0
