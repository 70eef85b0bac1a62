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


class Silent(e.LimitSpring):
    """A spring that declares neither the kink at which its force ends, nor its damping."""

    def hooks(self, arm):
        return tuple(dataclasses.replace(hook, kink=None, damping=None) for hook in super().hooks(arm))


@pytest.mark.long
def test_the_tolerance_is_kept_where_a_damper_lets_go():
    """Thrown back at k / c the force of a spring ends with a kink, which some do not declare."""
    arm, tolerance = rde.FourR((0.2072, 0.1558, 0.1156, 0.0924), (0.1086, 0.1842, 0.1824, 0.1086)), 1e-6
    numbers = (
        ("joint1", -0.2341, 0.6795, 1730.7, 34.615), ("joint4", -1.1935, 0.6622, 44.757, 0.89514),
    )  # fmt: skip
    q = np.array([0.96212575, -1.90753381, 1.17023602, 1.57205221])
    qd = np.array([-49.85733691, -26.58927628, 14.30634982, -32.90301643])
    near = 1e-2 * np.random.default_rng(0).normal(size=(2048, 4))[1200:1456]  # one of them is off by 1.9
    given = q + near, np.tile(qd, (256, 1)), np.tile((-3.3, -3.3, 3.3, 3.3), (256, 1))
    ends = [
        tips_after(rde.Scene(arm, [kind(*x) for x in numbers], actuation="generalized", **how), *given)[0]
        for kind, how in (
            (e.LimitSpring, {"substeps": 3000}),
            (e.LimitSpring, {"tolerance": tolerance}),
            (Silent, {"tolerance": tolerance}),
        )
    ]
    assert np.linalg.norm(np.subtract(ends[1:], ends[0]), axis=-1).max() <= tolerance


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
