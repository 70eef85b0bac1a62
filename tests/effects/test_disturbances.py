"""Forces that nobody controls: their laws, their statistics, and what they are booked as."""

import numpy as np
import pytest
from catalogue import FOUR_R, advanced

import redundant_envs as rde
from redundant_envs import effects as e

CART = rde.Chain("P", masses=(2.0,), lengths=())
"""A mass on a rail: it integrates forces."""
MASS = 2.0
SIGMAS = 4.0
"""Standard errors by which a moment may differ."""


def pushed(effect, intervals, control_dt=0.02, count=1, **kwargs):
    """A cart at rest at first after some intervals."""
    scene, rest = rde.Scene(CART, (effect,), control_dt=control_dt, **kwargs), np.zeros((count, 1))
    return advanced(scene, rest, rest, intervals=intervals)[0]


# ---- steps and periodic forces -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "control_dt", "first"),
    [(None, 0.02, 0), (0.1, 0.02, 5), (0.09, 0.02, 5), (0.3, 0.1, 3), (1e-6, 0.02, 1)],
)
def test_a_step_begins_with_the_first_interval_that_begins_then_or_later(start, control_dt, first):
    batch = pushed(e.JointTorque(step=6.0, start=start), first, control_dt)
    assert (batch.qd == 0.0).all()
    batch.advance()
    assert batch.qd[0, 0] == pytest.approx(6.0 / MASS * control_dt, rel=1e-14)
    batch.advance()
    assert batch.qd[0, 0] == pytest.approx(12.0 / MASS * control_dt, rel=1e-14)


@pytest.mark.parametrize(
    ("how", "near"),
    [({"substeps": 2}, 1e-9), ({"tolerance": 1e-10}, 1e-9), ({"integrator": "dop853"}, 1e-11)],
)
def test_a_periodic_force_moves_a_cart_as_it_should(how, near):
    """m x'' = a sin(w t + p)"""
    batch = pushed(e.JointTorque(amplitude=3.0, frequency=4.0, phase=0.7), 40, 0.02, **how)
    w, t = 8.0 * np.pi, 0.8
    speed = 3.0 / (MASS * w) * (np.cos(0.7) - np.cos(w * t + 0.7))
    place = 3.0 / (MASS * w) * (np.cos(0.7) * t - (np.sin(w * t + 0.7) - np.sin(0.7)) / w)
    assert batch.q[0, 0] == pytest.approx(place, abs=near)
    assert batch.qd[0, 0] == pytest.approx(speed, abs=30.0 * near)


@pytest.mark.quick("0.0001")
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_error_control_sees_forces_that_oscillate_within_an_interval(tolerance):
    """Also at whole periods in an interval, whose mean is 0."""
    frequencies = np.hstack([np.linspace(5.0, 400.0, 300), np.linspace(400.0, 5000.0, 300), 50.0, 100.0])
    for amplitude in (1.0, 100.0, 1e4):
        effect = e.JointTorque(amplitude=amplitude, frequency=1.0, phase=0.3)
        scene, zero = rde.Scene(CART, (effect,), tolerance=tolerance), np.zeros((len(frequencies), 1))
        batch, status = advanced(scene, zero, zero, None, {"joint_torque.frequency": frequencies})
        assert not status.numerics.any()
        w, t = 2.0 * np.pi * frequencies, 0.02
        place = amplitude / (MASS * w) * (np.cos(0.3) * t - (np.sin(w * t + 0.3) - np.sin(0.3)) / w)
        assert np.abs(batch.q[:, 0] - place).max() < tolerance


# ---- random forces -----------------------------------------------------------------------------------

LANES = 200_000


@pytest.mark.long
@pytest.mark.parametrize("control_dt", [0.005, 0.1])
def test_white_noise_does_not_depend_on_the_interval(control_dt):
    """The velocity of a free mass has the variance density^2 t / m^2, whatever the interval."""
    density, time = 1.5, 0.4
    batch = pushed(e.JointTorque(density=density), round(time / control_dt), control_dt, LANES)
    variance = (density / MASS) ** 2 * time
    error = np.sqrt(2.0 / LANES)
    assert SIGMAS * error < 0.02
    assert abs(batch.qd.mean()) < SIGMAS * np.sqrt(variance / LANES)
    assert batch.qd.var() / variance == pytest.approx(1.0, abs=SIGMAS * error)


def test_white_noise_at_the_tip_has_its_densities():
    scene = rde.Scene(FOUR_R, (e.TipForce(density=(2.0, 0.5)),))
    x = rde.BatchSimulator(scene, LANES).z * np.sqrt(0.02)
    assert x.std(axis=0) == pytest.approx([2.0, 0.5], rel=SIGMAS / np.sqrt(2.0 * LANES))
    assert abs(np.corrcoef(x.T)[0, 1]) < SIGMAS / np.sqrt(LANES)


@pytest.mark.long
@pytest.mark.parametrize(("deviation", "time_constant", "control_dt"), [(3.0, 0.05, 0.02), (0.2, 2.0, 0.01)])
def test_an_ornstein_uhlenbeck_force_in_ten_million_draws(deviation, time_constant, control_dt):
    """x' = x e^(-T/tau) + sigma sqrt(1 - e^(-2 T/tau)) n, from a stationary start."""
    effect = e.JointTorque(deviation=deviation, time_constant=time_constant)
    lanes, steps, decay = 50_000, 200, np.exp(-control_dt / time_constant)
    batch = pushed(effect, 0, control_dt, lanes, integrator="euler")
    before, sums = batch.z[:, 0], np.zeros(4)
    for _ in range(steps):
        batch.advance()
        now = batch.z[:, 0]
        drawn = (now - before * decay) / (deviation * np.sqrt(1.0 - decay * decay))
        sums, before = sums + [(drawn**k).sum() for k in (1, 2, 3, 4)], now
        assert now.var() / deviation**2 == pytest.approx(1.0, abs=SIGMAS * np.sqrt(2.0 / lanes))
    count = steps * lanes
    for k, (exact, square) in enumerate(((0.0, 1.0), (1.0, 3.0), (0.0, 15.0), (3.0, 105.0))):
        error = np.sqrt((square - exact**2) / count)
        assert sums[k] / count == pytest.approx(exact, abs=SIGMAS * error), k + 1
