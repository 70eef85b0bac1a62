"""Contacts of tip and links with discs and half-planes."""

import dataclasses

import numpy as np
import pytest
from catalogue import advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import disc

SLIDER = rde.Chain("P", (2.0,))
"""A point of 2 kg on the x axis; there is no gravity."""
WALL = e.HalfPlane((1.0, 0.0), (-1.0, 0.0), 5e3, 0.3)
BALL = e.Disc((1.5, 0.0), 0.5, 5e3, 0.3)

WITH = pytest.mark.parametrize("obstacle", [WALL, BALL], ids=["half-plane", "disc"])


def tip_at(batch):
    return batch.scene.robot.forward_kinematics(batch.q)[:, 0]


@pytest.mark.quick("half-plane")
@WITH
def test_a_constant_force_rests_at_its_static_depth(obstacle):
    scene = rde.Scene(SLIDER, (obstacle, e.ViscousFriction(200.0)), control_dt=0.1, tolerance=1e-9)
    batch, _ = advanced(scene, [[0.99]], [[0.0]], [[40.0]], intervals=40)
    assert tip_at(batch)[0] - 1.0 == pytest.approx(40.0 / 5e3, rel=1e-9)


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
