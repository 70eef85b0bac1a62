"""A gear with backlash on one joint follows the solutions of its equations, piece by piece."""

import numpy as np
import pytest
from catalogue import advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.gear_backlash import contacts, teeth

GAP, K, J, U = 0.04, 200.0, 0.02, 3.0
GEAR = e.GearBacklash(GAP, K, J)
WALL = rde.Chain("R", (1e12,), (1.0,))
"""A joint so heavy that it stays where it is."""
METHODS = pytest.mark.parametrize("how", [{"tolerance": 1e-9}, {"integrator": "dop853"}], ids=str)
STEP = 0.005


def motor(effect, u, intervals, arm=WALL, rate=0.0, **how):
    """Angle and rate of the motor, and those of its joint, after some intervals under a constant command."""
    scene = rde.Scene(arm, (effect,), control_dt=STEP, **how)
    zero = np.zeros((1, 1))
    batch, status = advanced(scene, zero + 0.3, zero + rate, zero + u, intervals=intervals)
    assert not status.numerics.any()
    return *(batch.z[0] - [0.3, 0.0]), batch.q[0, 0] - 0.3, batch.qd[0, 0]


@pytest.mark.quick("{'tolerance': 1e-09}")
@METHODS
def test_the_motor_crosses_half_the_gap_alone_and_then_oscillates_on_the_teeth(how):
    contact = np.sqrt(GAP * J / U)
    speed, w = U * contact / J, np.sqrt(K / J)
    met = 0
    for intervals in (1, 2, 3, 4, 6):
        t = intervals * STEP
        turned = (U * t**2 / (2.0 * J), U * t / J)
        if t > contact:
            met, s = met + 1, w * (t - contact)
            depth = U / K * (1.0 - np.cos(s)) + speed / w * np.sin(s)
            assert depth > 0.0
            turned = (0.5 * GAP + depth, U / K * w * np.sin(s) + speed * np.cos(s))
        angle, rate, joint, _ = motor(GEAR, U, intervals, **how)
        assert (angle, rate) == pytest.approx(turned, rel=1e-8)
        assert joint == pytest.approx(0.0, abs=1e-12)
    assert 0 < met < 5


@METHODS
def test_a_gear_under_load_winds_up_by_half_its_gap_and_its_torque_by_its_stiffness(how):
    damped = e.GearBacklash(GAP, K, J, 150.0)
    for u in (U, -U):
        angle, rate, _, _ = motor(damped, u, 200, **how)
        assert angle == pytest.approx(np.sign(u) * 0.5 * GAP + u / K, rel=1e-9)
        assert rate == pytest.approx(0.0, abs=1e-9)


def test_teeth_never_pull_however_fast_they_part():
    for lead, closing, torque in (
        (0.1, 1.0, 120.0),
        (0.1, -1.0, 0.0),
        (-0.1, -1.0, -120.0),
        (-0.1, 1.0, 0.0),
    ):
        sides = [1.0 if x >= 0.0 else -1.0 for x in contacts(lead, 0.0, 0.0)]
        assert teeth(lead, closing, 0.0, 0.0, 0.0, K, 1e3, *sides) == pytest.approx(torque)
