"""Bodies move as their equations say: links with inertia, loads, tendons, contacts, springs at limits."""

import dataclasses
import math

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced, tips_after

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import disc
from redundant_envs.simulator.events.boundary import MARGIN, law_behind, limits_of_law
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.verify.checks import random_states

SLIDER = rde.Chain("P", (2.0,))
"""A point of 2 kg on the x axis; there is no gravity."""

# ---- tendons, links, bases that move -----------------------------------------------------------------

TWO_SLIDERS = rde.Chain("PP", masses=(1.0, 0.5))
"""Masses at r1 and at r1 + r2: a tendon with the arms 1 and 1 is fixed to the base and the second mass."""
STRETCH, STIFFNESS = 0.1, 80.0
OMEGA = math.sqrt(STIFFNESS / 0.5)


def pulled(t, slack):
    """Position of a mass that a slack tendon of ``slack`` m pulls from a stretch, and that then flies on."""
    t_slack = 0.5 * math.pi / OMEGA
    stretched = STRETCH * np.cos(OMEGA * np.minimum(t, t_slack))
    return slack + stretched - STRETCH * OMEGA * np.maximum(t - t_slack, 0.0)


@pytest.mark.parametrize(("steps", "bound"), [({"tolerance": 1e-9}, 2e-8), ({"integrator": "dop853"}, 1e-12)])
def test_a_tendon_pulls_a_mass_and_lets_it_fly(steps, bound):
    slack = 0.02
    tendon = e.Tendon(("r1", "r2"), (1.0, 1.0), STIFFNESS, -STIFFNESS * slack)
    scene = rde.Scene(TWO_SLIDERS, (tendon,), control_dt=0.01, **steps)
    times = np.linspace(0.0, 0.3, 31)
    motion = rde.simulate(scene, (0.0, STRETCH + slack), (0.0, 0.0), times)
    assert np.abs(motion.tip[:, 0] - pulled(times, slack)).max() <= bound
    assert np.abs(motion.q[:, 0]).max() <= bound  # the first mass is not pulled
    assert np.abs(motion.balance - motion.balance[0]).max() <= 20.0 * bound
    assert motion.potential_energy[0] == pytest.approx(0.5 * STIFFNESS * STRETCH**2, rel=1e-14)
    assert (motion.potential_energy[-5:] == 0.0).all()


def test_a_link_with_inertia_is_a_compound_pendulum():
    """It falls by m g l cos / (m l^2 + J)."""
    inertias = np.array([0.0, 0.02, 0.3, 5.0])
    scene = rde.Scene(rde.Chain("R", (2.0,), (0.5,)), (e.Gravity(), e.LinkInertia(0.1)), "euler", 1e-3)
    angle = np.full((4, 1), 0.4)
    found, _ = advanced(scene, angle, 0.0 * angle, None, {"link_inertia.inertias": inertias[:, None]})
    expected = -2.0 * 9.81 * 0.5 * math.cos(0.4) / (2.0 * 0.25 + inertias)
    np.testing.assert_allclose(found.qd[:, 0] / 1e-3, expected, rtol=1e-13)


def test_a_free_mass_stays_where_it_is_while_bases_move_together():
    """Seen from them it moves as x0 + A w t - A sin w t, and there is no other force."""
    times = np.linspace(0.0, 0.5, 26)
    given = ((0.02, -0.01), 11.0), ((0.0, 0.03), 5.0, "second"), ((0.04, 0.0), 11.0, "third")
    bases = tuple(e.MovingBase(*numbers) for numbers in given)
    motion = rde.simulate(rde.Scene(SLIDER, bases, "dop853"), (0.1,), (0.0,), times)
    expected = 0.1 + 0.06 * (11.0 * times - np.sin(11.0 * times))
    assert np.abs(motion.q[:, 0] - expected).max() <= 1e-13
    assert np.abs(motion.work - motion.kinetic_energy).max() <= 1e-12
    assert motion.work.max() > 0.1


# ---- contacts of tip and links with discs and half-planes --------------------------------------------

WALL = e.HalfPlane((1.0, 0.0), (-1.0, 0.0), 5e3, 0.3)
BALL = e.Disc((1.5, 0.0), 0.5, 5e3, 0.3)

WITH = pytest.mark.parametrize("obstacle", [WALL, BALL], ids=["half-plane", "disc"])


@pytest.mark.quick("half-plane")
@WITH
def test_a_constant_force_rests_at_its_static_depth(obstacle):
    scene = rde.Scene(SLIDER, (obstacle, e.ViscousFriction(200.0)), control_dt=0.1, tolerance=1e-9)
    batch, _ = advanced(scene, [[0.99]], [[0.0]], [[40.0]], intervals=40)
    assert batch.q[0, 0] - 1.0 == pytest.approx(40.0 / 5e3, rel=1e-9)


@pytest.mark.quick("False-half-plane")
@WITH
@pytest.mark.parametrize("along_links", [False, True])
def test_a_point_bounces_as_hunt_and_crossley_say(obstacle, along_links):
    """From the impact to the end m v dv = -F dd: with u = c v, ln(1 + u) - u has the same value before and
    after; for a slow impact the restitution is 1 - 2/3 c v."""
    made = dataclasses.replace(obstacle, along_links=along_links)
    scene = rde.Scene(SLIDER, (made,), control_dt=0.2, tolerance=1e-9)
    for speed in (0.05, 1.0, 4.0):
        batch, status = advanced(scene, [[0.99]], [[speed]], [[0.0]], intervals=3)
        rebound, c = -batch.qd[0, 0], 0.3
        assert not status.numerics.any()
        before, after = (np.log1p(c * v) - c * v for v in (speed, -rebound))
        assert after == pytest.approx(before, rel=1e-7)
        if speed == 0.05:
            assert rebound / speed == pytest.approx(1.0 - 2.0 / 3.0 * c * speed, abs=1e-4)


def test_a_point_that_is_torn_away_is_never_pulled():
    """From a depth of 20 mm a strong motor leaves faster than 1/c; the wall then has no force."""
    scene = rde.Scene(SLIDER, (dataclasses.replace(WALL, damping=5.0),), control_dt=0.01, tolerance=1e-9)
    batch, _ = advanced(scene, [[1.02]], [[-1.0]], [[-400.0]])
    assert batch.qd[0, 0] == pytest.approx(-1.0 - 200.0 * 0.01, rel=1e-12)


def test_friction_is_at_most_mu_times_the_normal_force():
    rng, mu = np.random.default_rng(1), 0.4
    for x, y, vx, vy in rng.normal(0.0, 0.3, (100, 4)):
        fx, fy = disc.AT_TIP["function"](x, y, vx, vy, 0.0, 0.0, 2.0, 1e3, 0.1, mu, 0.05, 1.0, 1.0)
        r = np.hypot(x, y)
        normal, along = (fx * x + fy * y) / r, (fy * x - fx * y) / r
        slides = (vy * x - vx * y) / r
        assert abs(along) <= (mu + 1e-12) * normal
        assert normal > 0.0
        assert along * slides <= 1e-12
        expected = 1e3 * (2.0 - r) * (1.0 - 0.1 * (vx * x + vy * y) / r)
        assert normal == pytest.approx(expected, rel=1e-12)


def test_the_shares_of_both_ends_are_the_force_at_the_point_of_contact():
    """In sum, and in moment about any point: here about the origin."""
    rng, found = np.random.default_rng(2), 0
    for a, b, va, vb, c in rng.normal(0.0, 1.0, (300, 5, 2)):
        numbers = (*a, *b, *va, *vb, *c, 0.8, 1e3, 0.05, 0.5, 0.1)
        near, far = np.array(disc.at_near_end(*numbers)), np.array(disc.at_far_end(*numbers))
        s = np.clip((c - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        point, velocity = a + s * (b - a), va + s * (vb - va)
        distance = np.hypot(*(point - c))
        side = float(distance < 0.8 and 0.05 * (point - c) @ velocity < distance)
        force = np.array(disc.AT_TIP["function"](*point, *velocity, *c, 0.8, 1e3, 0.05, 0.5, 0.1, side, side))
        np.testing.assert_allclose(near + far, force, rtol=0.0, atol=1e-9)
        moment = np.cross(np.array([*a, 0.0]), [*near, 0.0]) + np.cross(np.array([*b, 0.0]), [*far, 0.0])
        np.testing.assert_allclose(moment, np.cross([*point, 0.0], [*force, 0.0]), atol=1e-8)
        found += side
    assert found > 50


@pytest.mark.quick("0.005-half-plane")
@WITH
@pytest.mark.parametrize("dt", [0.005, 0.05])
def test_a_lost_contact_ends_late_by_less_than_a_hundredth_of_an_interval(obstacle, dt):
    """From the start on a point leaves faster than 1/c, at a depth of 20.3 mm: all of k d^2 / 2 is lost, but
    k b^2 / 2 with the way b in the time by which the end is found late."""
    made = dataclasses.replace(obstacle, damping=5.0)
    scene = rde.Scene(SLIDER, (made,), control_dt=dt, tolerance=1e-6)
    motion = rde.simulate(scene, q=[1.0203], qd=[-1.0], times=[0.1])
    assert motion.qd[0, 0] == pytest.approx(-1.0, rel=1e-12)
    missing = abs(0.5 * 5e3 * 0.0203**2 + motion.work[0])
    assert np.sqrt(2.0 * missing / 5e3) < 0.01 * dt


# ---- springs at limits: the change of law is located, and steps are short enough ---------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("arm", "spring", "damping"),
    [(FOUR_R, (-1.5, 1.5, 500.0), 0.0), (RPRP, (0.0, 0.3, 1e5), 0.0), (RPRP, (0.0, 0.3, 2e3), 500.0)],
)
def test_a_tolerance_is_kept_where_springs_begin(arm, spring, damping):
    """Against steps of 1 us: with k = 1e5 one interval in six hundred was off by up to fifteen tolerances."""
    springs = (e.LimitSpring(arm.joints[n], *spring, damping) for n in (1, 3))
    made = rde.Scene(arm, (e.Gravity(), *springs))
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


def test_a_damper_asks_for_steps_where_its_joint_is_deep_in_it():
    effects = e.Gravity(), e.LimitSpring("r2", -100.0, 0.0, 20.8, 375.0)
    dynamics = Dynamics(rde.Scene(RPRP, effects, tolerance=1e-6))
    parameters = dynamics.parameters.values
    known = parameters | dynamics.parameters.prepare(parameters) | dict.fromkeys(dynamics.states, 0.0)
    known["interval"] = 0.05

    def steps(depth):
        lane = Lane(Interval(dynamics).layout(), {**known, "r2": depth}.__getitem__)
        return Interval(dynamics).step.least_steps(lane)

    assert steps(-0.1) < 1.0
    assert steps(0.1) > 0.05 * 0.5 * 375.0 * 0.1 * known["most_mobility4"] > 1.0


def test_laws_overlap_by_a_margin_so_that_rounding_changes_none():
    lower, upper = -0.2, 3.0
    assert limits_of_law(0.0, lower, upper) == (lower - MARGIN, upper + 3.0 * MARGIN)
    assert limits_of_law(1.0, lower, upper) == (upper - 3.0 * MARGIN, math.inf)
    assert limits_of_law(-1.0, lower, upper) == (-math.inf, lower + MARGIN)
    assert [law_behind(0.0, s) for s in (1.0, -1.0)] == [1.0, -1.0]
    assert law_behind(1.0, -1.0) == law_behind(-1.0, 1.0) == 0.0
