"""Laws that change where a guard changes its sign: located in time under error control."""

import dataclasses

import numpy as np
import pytest
from catalogue import RPRP, advanced, stops
from outside.guards import BrakeInBands, HalfBrake, SpeedCurve, brake

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics, where

FOUR_R = rde.FourR((0.5,) * 4, (0.25,) * 4)
GEAR = e.GearBacklash(0.02, 500.0, 0.02, 10.0)
LIMITS = {"FourR": (20.0, 12.0, 8.0, 4.0), "RPRP": (20.0, 32.0, 8.0, 16.0)}


def scene(arm, *effects, **how):
    sliders = (stops(arm),) if arm.sliders() else ()
    own = (e.Gravity(), e.ViscousFriction(0.2), *sliders, e.EffortLimits(LIMITS[arm.kind]))
    return rde.Scene(arm, (*own, *effects), **(how or {"tolerance": 1e-6}))


def start(arm, lanes, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (lanes, 4))
    q[:, arm.sliders()] = rng.uniform(0.0, 0.3, (lanes, len(arm.sliders())))
    return q, rng.normal(0.0, 2.0, (lanes, 4)), rng.uniform(-1.0, 1.0, (lanes, 4)) * LIMITS[arm.kind]


def assert_kept(made, state):
    """Tips are within the tolerance of those of steps near rounding, and no lane is flagged."""
    found, status = advanced(made, *state)
    exact, sure = advanced(dataclasses.replace(made, tolerance=None, integrator="dop853"), *state)
    assert not (sure.numerics | status.numerics).any()
    apart = made.robot.forward_kinematics(found.q) - made.robot.forward_kinematics(exact.q)
    assert np.linalg.norm(apart, axis=1).max() < made.tolerance
    return status.evaluations


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
@pytest.mark.parametrize(
    ("arm", "effect", "lanes"),
    [(FOUR_R, SpeedCurve(), 512), (FOUR_R, GEAR, 64), (RPRP, HalfBrake(3.0), 512)],
    ids=["4R, curves of motors", "4R, gears", "RPRP, a brake"],
)
def test_an_interval_in_which_a_law_changes_keeps_its_tolerance(arm, effect, lanes, tolerance):
    assert_kept(scene(arm, effect, tolerance=tolerance), start(arm, lanes, seed=11))


@pytest.mark.long
def test_all_passages_of_a_guard_in_one_step_are_found():
    """Up to three: a search that found the last of them left the others out, in 118 of 512 lanes."""
    q, qd, efforts = start(FOUR_R, 512, seed=8)
    rng = np.random.default_rng(9)
    q[:, 0], qd[:, 0] = rng.uniform(-0.1, -0.04, 512), rng.uniform(4.0, 12.0, 512)
    assert assert_kept(scene(FOUR_R, BrakeInBands()), (q, qd, efforts)).mean() < 400.0


@pytest.mark.long
def test_a_guard_that_never_changes_its_sign_costs_no_step():
    far = SpeedCurve(stall=1e3, free=1e4)
    counts = [
        advanced(scene(FOUR_R, *effects), *start(FOUR_R, 64, seed=2))[1].evaluations
        for effects in ((), (far,))
    ]
    np.testing.assert_array_equal(*counts)


def test_at_fixed_steps_the_sign_at_each_stage_selects_the_law():
    """A force with a guard at the position then is the same as one that compares it."""

    @physics
    def compared(rate, position, level):
        return brake(rate, position, level, where(position >= 0.0, 1.0, -1.0))

    class Compared(HalfBrake):
        def hooks(self, arm):
            return (e.Force(0, compared, {"rate": "phid1", "position": "phi1", "level": ".level"}),)

    state = start(FOUR_R, 32, seed=4)
    one, other = (advanced(scene(FOUR_R, x, integrator="rk4"), *state)[0] for x in (HalfBrake(), Compared()))
    assert np.array_equal(one.q, other.q)


@pytest.mark.long
def test_a_motor_tells_the_effort_behind_the_law_that_holds():
    made = scene(FOUR_R, SpeedCurve(stall=2.0))
    motion = rde.simulate(made, np.zeros(4), np.zeros(4), [0.0, 0.01, 0.02], efforts=(5.0, 1.0, -5.0, 0.5))
    np.testing.assert_allclose(motion.efforts[0], (2.0, 1.0, -2.0, 0.5))
