"""Undeclared kinks of effects are found by running their functions on moving numbers, and watched."""

from dataclasses import dataclass

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import floor, maximum, minimum, physics, where
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.kinks import levels_of
from redundant_envs.studies.kinked_effects import QuadraticDrag, VelocityController

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
    assert len(levels_of(Dynamics(scene(*effects)).kinks)) == count


@pytest.mark.parametrize(
    "made",
    [
        *(scene(QuadraticDrag(0.1), integrator=name) for name in ("rk8", "dop853")),
        *(rde.load_scene(name) for name in ("rprp_reach", "four_r_reach")),
    ],
    ids=["rk8", "dop853", "rprp_reach", "four_r_reach"],
)
def test_nothing_is_watched_without_a_tolerance_and_in_the_scenes_of_environments(made):
    assert Dynamics(made).kinks == {}


# ---- the tolerance is kept ----------------------------------------------------------------------------


def tips(made, q, qd, efforts, parameters=None, parts=1):
    """Tips after an interval in so many parts; which lanes have no flag; rates on the way."""
    batch = rde.BatchSimulator(made, len(q))
    batch.set_parameters(parameters or {})
    batch.set_state(q, qd)
    rates = []
    for _ in range(parts):
        rates.append(batch.qd @ np.asarray(RPRP.motor_map))
        status = batch.advance_partly(efforts, made.control_dt / parts)
    return RPRP.forward_kinematics(batch.q), status.numerics == 0, np.array(rates)


def off(made, *states, **numbers):
    """Errors of intervals without a flag, in units of the tolerance, where the reference is sure."""
    own, good, _ = tips(made, *states, **numbers)
    fine, coarse = (
        tips(scene(*made.effects, **how), *states, **numbers)[0]
        for how in ({"integrator": "rk8", "substeps": 1024}, {"integrator": "dop853"})
    )
    sure = np.linalg.norm(fine - coarse, axis=1) < 0.1 * made.tolerance
    assert good.mean() > 0.99
    assert (good & sure).mean() > 0.95
    return np.linalg.norm(own - fine, axis=1)[good & sure] / made.tolerance


def turning(count, seed):
    """Joints that move slowly, and turn."""
    rng = np.random.default_rng(seed)
    q = rng.uniform((-3.0, 0.0, -3.0, 0.0), (3.0, 0.25, 3.0, 0.25), (count, 4))
    return q, rng.normal(0.0, 0.1, (count, 4)), rng.normal(0.0, 4.0, (count, 4))


class Unwatched(QuadraticDrag):
    """Drag of another name, whose program is made while kinks are not searched."""


def test_the_drag_of_the_documentation_keeps_the_tolerance_but_not_without_its_kinks(monkeypatch):
    states = turning(2048, seed=2)
    assert off(scene(QuadraticDrag(3.0)), *states).max() < 1.0
    monkeypatch.setattr(Dynamics, "kinks", {})
    assert off(scene(Unwatched(3.0)), *states).max() > 1.0


STAGES = ((0.118, 0.25), (0.333, 0.6), (0.651, 0.857))
"""Times in a step between which rk8 has no stage."""


def reached_between_stages(count, seed, share):
    """Motors that hold a rate, with limits a little below the largest effort that they need between two
    stages."""
    rng, parts, gain = np.random.default_rng(seed), 200, 2.0
    q, _, _ = turning(count, seed)
    qd = rng.normal(0.0, (6.0, 1.0, 6.0, 1.0), (count, 4))
    efforts = rng.uniform(-1.0, 1.0, (count, 4)) * (4.0, 10.0, 4.0, 10.0)
    made = scene(e.Gravity(), VelocityController(gain, 100.0))
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
