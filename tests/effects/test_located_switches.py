"""Forces that change their laws where a joint passes a position: the change is located in time."""

import dataclasses
import math

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.events.boundary import MARGIN, law_behind, limits_of_law
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.verify.states import random_states

e = rde.effects
RPRP = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
FOUR_R = rde.FourR((2.0, 1.5, 1.0, 0.5), (0.3, 0.5, 0.4, 0.6))


def springs(arm, stiffness, damping=0.0):
    """Springs at the limits of two joints; of 4R a tenth as stiff, with lever arms of half a metre."""
    travel = (0.0, 0.3) if arm.prismatic[1] else (-1.5, 1.5)
    k = stiffness if arm.prismatic[1] else 0.1 * stiffness
    return tuple(e.LimitSpring(arm.joints[n], *travel, k, damping) for n in (1, 3))


def scene(arm, stiffness, damping=0.0, **kwargs):
    return rde.Scene(arm, (e.Gravity(), *springs(arm, stiffness, damping)), control_dt=0.02, **kwargs)


def advance(made, q, qd, efforts=None):
    batch = rde.BatchSimulator(made, len(q))
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    return batch.q, batch.qd, status


def near_limits(arm, count, seed=0):
    made = scene(arm, 1.0, tolerance=1e-6)
    q, qd, _ = random_states(made, count, seed, beyond=0.05)
    return q, qd, np.random.default_rng(seed).uniform(-10.0, 10.0, q.shape)


@pytest.mark.parametrize("arm", [RPRP, FOUR_R])
@pytest.mark.parametrize(("stiffness", "damping"), [(5e3, 0.0), (1e5, 0.0), (2e3, 500.0)])
def test_a_tolerance_is_kept_where_springs_begin(arm, stiffness, damping):
    """Against steps of 1 us: with k = 1e5 one interval in six hundred was off by up to fifteen tolerances."""
    q, qd, efforts = near_limits(arm, 192)
    fine = dataclasses.replace(scene(arm, stiffness, damping), integrator="rk4", substeps=20000)
    reference = arm.forward_kinematics(advance(fine, q, qd, efforts)[0])
    for tolerance, most in ((1e-6, 400), (1e-8, 800)):
        found, _, status = advance(scene(arm, stiffness, damping, tolerance=tolerance), q, qd, efforts)
        error = np.linalg.norm(arm.forward_kinematics(found) - reference, axis=1)
        assert (status.numerics == 0).all()
        assert error.max() <= tolerance
        if damping == 0.0:  # up to 15000 before changes of law were located
            assert status.evaluations.mean() <= most


@pytest.mark.parametrize("made", [{"tolerance": 1e-9}, {"integrator": "dop853"}])
def test_a_motion_that_touches_its_spring_between_all_stages_is_seen(made):
    """0.4 mm before its limit, thrown up at 0.2 m/s against 40 m/s^2: it is 0.1 mm beyond for 4.5 ms."""
    arm = rde.RPRP((1.0, 1.0, 1.0, 1e-9), (0.5, 0.5))
    push = e.LimitSpring("r1", -1.0, 0.3, 1e4)
    one = rde.Scene(arm, (push,), control_dt=0.02, **made)
    q, qd = np.array([[0.0, 0.2996, 0.0, 0.0]]), np.array([[0.0, 0.2, 0.0, 0.0]])
    found, _, _ = advance(one, q, qd, np.array([[0.0, -80.0, 0.0, 0.0]]))
    fine = rde.Scene(arm, (push,), control_dt=0.02, integrator="rk4", substeps=200_000)
    expected, _, _ = advance(fine, q, qd, np.array([[0.0, -80.0, 0.0, 0.0]]))
    without, _, _ = advance(
        rde.Scene(arm, (), control_dt=0.02, **made), q, qd, np.array([[0.0, -80.0, 0.0, 0.0]])
    )
    assert abs(found[0, 1] - expected[0, 1]) <= 1e-10
    assert abs(without[0, 1] - expected[0, 1]) >= 1e-6


def test_a_joint_that_rests_on_its_spring_costs_what_a_free_one_costs():
    """It settles to rounding; no noise switches it from one law to the other and back."""
    friction = e.ViscousFriction((1.0, 20.0, 1.0, 20.0))
    made = rde.Scene(RPRP, (e.Gravity(), friction, *springs(RPRP, 5e3)), tolerance=1e-6)
    batch = rde.BatchSimulator(made, 3)
    down = -math.pi / 2
    batch.set_state([[down, 0.2, down, 0.2], [down, 0.3, down, 0.3], [-down, 0.0, -down, 0.0]], np.zeros(4))
    for _ in range(1000):
        status = batch.advance()
    assert (status.numerics == 0).all()
    assert (status.evaluations <= 48).all()
    assert batch.q[0, 1] == pytest.approx(0.3 + 3.0 * 9.81 / 5e3, abs=1e-9)


def test_at_rest_exactly_at_a_limit_nothing_happens():
    made = rde.Scene(RPRP, springs(RPRP, 5e3), tolerance=1e-9)
    q = np.array([[0.3, 0.3, -0.2, 0.0], [0.3, 0.0, -0.2, 0.3]])
    found, rates, status = advance(made, q, np.zeros((2, 4)))
    assert (found == q).all()
    assert (rates == 0.0).all()
    assert (status.evaluations == 24).all()  # two steps are what a spring of 5 kN/m needs


@pytest.mark.parametrize("travel", [1e-3, 1e-9, 1e-12])
def test_limits_close_together_are_passed_both(travel):
    """In a step the joint goes through its travel and into the spring behind it."""
    made = rde.Scene(RPRP, (e.Gravity(), e.LimitSpring("r1", 0.0, travel, 5e3)), tolerance=1e-8)
    q, qd = np.array([[0.3, -1e-3, -0.2, 0.1]]), np.array([[0.0, 1.0, 0.0, 0.0]])
    found, _, status = advance(made, q, qd)
    fine = dataclasses.replace(made, tolerance=None, integrator="rk4", substeps=200_000)
    expected, _, _ = advance(fine, q, qd)
    assert status.numerics[0] == 0
    assert np.abs(found - expected).max() <= 1e-8
    assert status.evaluations[0] <= 12 * 60


def test_springs_and_stops_of_one_slider_serve_together():
    """The spring begins before the stop, at it, and behind it, where it never acts."""
    for lower, upper in ((0.02, 0.28), (0.0, 0.3), (-1e-12, 0.3 + 1e-12)):
        effects = (e.LimitSpring("r1", lower, upper, 5e3), e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 1.0))
        made = rde.Scene(RPRP, (e.Gravity(), *effects), tolerance=1e-9)
        batch = rde.BatchSimulator(made, 64, track_work=True)
        rng = np.random.default_rng(0)
        q = np.column_stack([rng.uniform(-3, 3, 64), rng.uniform(0, 0.3, 64)] * 2)
        qd = rng.normal(0.0, 3.0, (64, 4))
        batch.set_state(q, qd)
        energy = kinetic_energy(made, q, qd) + potential_energy(made, q)
        for _ in range(25):
            status = batch.advance()
            assert (status.numerics == 0).all()
            assert (batch.q[:, 1] >= 0.0).all()
            assert (batch.q[:, 1] <= 0.3).all()
        now = kinetic_energy(made, batch.q, batch.qd) + potential_energy(made, batch.q)
        assert np.abs(now - energy - batch.work).max() <= 1e-6


def test_lanes_with_limits_of_their_own_have_them():
    made = scene(RPRP, 5e3, tolerance=1e-9)
    q, qd, efforts = near_limits(RPRP, 16)
    uppers = np.linspace(0.1, 0.4, 16)
    batch = rde.BatchSimulator(made, 16)
    batch.set_parameters({"limit_spring.r1.upper": uppers})
    batch.set_state(q, qd)
    batch.advance(efforts)
    for k in range(16):
        own = rde.Scene(
            RPRP,
            (e.Gravity(), e.LimitSpring("r1", 0.0, uppers[k], 5e3), springs(RPRP, 5e3)[1]),
            tolerance=1e-9,
        )
        alone, _, _ = advance(own, q[k : k + 1], qd[k : k + 1], efforts[k : k + 1])
        assert (alone[0] == batch.q[k]).all()


def test_the_work_of_a_damped_spring_is_booked_across_its_limits():
    made = scene(RPRP, 2e3, 50.0, tolerance=1e-9)
    q, qd, efforts = near_limits(RPRP, 64)
    batch = rde.BatchSimulator(made, 64, track_work=True)
    batch.set_state(q, qd)
    for _ in range(10):
        batch.advance(efforts)
    change = kinetic_energy(made, batch.q, batch.qd) + potential_energy(made, batch.q)
    change -= kinetic_energy(made, q, qd) + potential_energy(made, q)
    assert np.abs(change - batch.work).max() <= 1e-6


def test_laws_overlap_by_a_margin_so_that_rounding_changes_none():
    lower, upper = -0.2, 3.0
    assert limits_of_law(0.0, lower, upper) == (lower - MARGIN, upper + 3.0 * MARGIN)
    assert limits_of_law(1.0, lower, upper) == (upper - 3.0 * MARGIN, math.inf)
    assert limits_of_law(-1.0, lower, upper) == (-math.inf, lower + MARGIN)
    assert [law_behind(0.0, s) for s in (1.0, -1.0)] == [1.0, -1.0]
    assert law_behind(1.0, -1.0) == law_behind(-1.0, 1.0) == 0.0


class Silent(e.LimitSpring):
    """A spring that declares neither the kink at which its force ends, nor its damping."""

    def hooks(self, arm):
        return tuple(dataclasses.replace(hook, kink=None, damping=None) for hook in super().hooks(arm))


@pytest.mark.parametrize("damping", [0.0, 35.0])
@pytest.mark.parametrize("integrator", ["rk8", "dop853"])
def test_fast_lanes_near_springs_do_not_know_of_calm_ones_beside_them(integrator, damping):
    """Found by fuzzing: a step for a slow lane, too long for fast ones beside it, reported a kink for
    these."""
    springs = [e.LimitSpring(f"joint{k}", -0.2, 0.7, 1730.7, damping) for k in (1, 2)]
    tolerance = None if integrator == "dop853" else 1e-6
    made = rde.Scene(FOUR_R, springs, integrator=integrator, control_dt=0.005, tolerance=tolerance)
    rng, count = np.random.default_rng(8), 128
    states = rng.uniform(-1.5, 1.5, (count, 4)), rng.normal(0.0, 200.0, (count, 4))
    q, qd, efforts = *states, rng.uniform(-20.0, 20.0, (count, 4))
    fast = advance(made, q, qd, efforts)
    places = rng.permutation(2 * count)[:count]
    mixed = [np.zeros((2 * count, 4)) for _ in range(3)]
    for table, values in zip(mixed, (q, qd, efforts), strict=True):
        table[places] = values
    beside = advance(made, *mixed)
    for one, other in zip(fast[:2], beside[:2], strict=True):
        np.testing.assert_array_equal(one, other[places])
    np.testing.assert_array_equal(fast[2].evaluations, beside[2].evaluations[places])


def test_the_tolerance_is_kept_in_an_interval_in_which_a_damper_lets_go():
    """Thrown back at k / c the force ends with a kink."""
    arm = rde.FourR((0.2072, 0.1558, 0.1156, 0.0924), (0.1086, 0.1842, 0.1824, 0.1086))
    rng = np.random.default_rng(0)
    q = np.array([0.96212575, -1.90753381, 1.17023602, 1.57205221]) + 1e-2 * rng.normal(size=(2048, 4))
    qd = np.tile([-49.85733691, -26.58927628, 14.30634982, -32.90301643], (2048, 1))
    efforts = np.tile([-3.3, -3.3, 3.3, 3.3], (2048, 1))

    def tips(kind, **how):
        first, last = (
            ("joint1", -0.2341, 0.6795, 1730.7, 34.615),
            ("joint4", -1.1935, 0.6622, 44.757, 0.89514),
        )
        made = rde.Scene(arm, (kind(*first), kind(*last)), control_dt=0.02, actuation="generalized", **how)
        found, _, status = advance(made, q, qd, efforts)
        assert (status.numerics == 0).all()
        return arm.forward_kinematics(found)

    reference = tips(e.LimitSpring, integrator="rk8", substeps=4000)

    def errors(kind):
        return np.linalg.norm(tips(kind, tolerance=1e-6) - reference, axis=1)

    assert errors(e.LimitSpring).max() <= 1e-6
    assert errors(Silent).max() <= 1e-6
