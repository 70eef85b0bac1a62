"""Springs at limits: the change of law is located in time, and steps are short enough for dampers."""

import dataclasses
import math

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, tips_after

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.simulator.events.boundary import MARGIN, law_behind, limits_of_law
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.verify.checks import random_states


def springs(arm, stiffness, damping=0.0):
    """Springs at the limits of two joints; of 4R a tenth as stiff, with lever arms of half a metre."""
    travel = (0.0, 0.3) if arm.prismatic[1] else (-1.5, 1.5)
    k = stiffness if arm.prismatic[1] else 0.1 * stiffness
    return tuple(e.LimitSpring(arm.joints[n], *travel, k, damping) for n in (1, 3))


def scene(arm, *effects, **kwargs):
    return rde.Scene(arm, (e.Gravity(), *effects), **kwargs)


# ---- the tolerance is kept ------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("arm", "stiffness", "damping"), [(FOUR_R, 5e3, 0.0), (RPRP, 1e5, 0.0), (RPRP, 2e3, 500.0)]
)
def test_a_tolerance_is_kept_where_springs_begin(arm, stiffness, damping):
    """Against steps of 1 us: with k = 1e5 one interval in six hundred was off by up to fifteen tolerances."""
    made = scene(arm, *springs(arm, stiffness, damping))
    q, qd, _ = random_states(made, 192, 0, beyond=0.05)
    states = q, qd, np.random.default_rng(0).uniform(-10.0, 10.0, q.shape)
    reference, sure = tips_after(dataclasses.replace(made, integrator="rk4", substeps=20000), *states)
    assert not sure.numerics.any()
    for tolerance, most in ((1e-6, 400), (1e-8, 800)):
        found, status = tips_after(dataclasses.replace(made, tolerance=tolerance), *states)
        assert not status.numerics.any()
        assert np.linalg.norm(found - reference, axis=1).max() <= tolerance
        if damping == 0.0:  # up to 15000 before changes of law were located
            assert status.evaluations.mean() <= most


# ---- what it costs --------------------------------------------------------------------------------------


def test_a_damper_asks_for_steps_where_its_joint_is_deep_in_it():
    dynamics = Dynamics(scene(RPRP, e.LimitSpring("r2", -100.0, 0.0, 20.8, 375.0), tolerance=1e-6))
    parameters = dynamics.parameters.values
    known = parameters | dynamics.parameters.prepare(parameters) | dict.fromkeys(dynamics.states, 0.0)
    known["interval"] = 0.05

    def steps(depth):
        lane = Lane(Interval(dynamics).layout(), {**known, "r2": depth}.__getitem__)
        return Interval(dynamics).step.least_steps(lane)

    assert steps(-0.1) < 1.0
    assert steps(0.1) > 0.05 * 0.5 * 375.0 * 0.1 * known["most_mobility4"] > 1.0


# ---- beside others --------------------------------------------------------------------------------------


def test_laws_overlap_by_a_margin_so_that_rounding_changes_none():
    lower, upper = -0.2, 3.0
    assert limits_of_law(0.0, lower, upper) == (lower - MARGIN, upper + 3.0 * MARGIN)
    assert limits_of_law(1.0, lower, upper) == (upper - 3.0 * MARGIN, math.inf)
    assert limits_of_law(-1.0, lower, upper) == (-math.inf, lower + MARGIN)
    assert [law_behind(0.0, s) for s in (1.0, -1.0)] == [1.0, -1.0]
    assert law_behind(1.0, -1.0) == law_behind(-1.0, 1.0) == 0.0
