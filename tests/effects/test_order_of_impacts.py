"""Two sliders at their stops almost at once: which strikes, and which rests, does not depend on the steps."""

import numpy as np
import pytest

import redundant_envs as rde
from tests.oracles.independent_stops import StoppedArm

ARM = rde.RPRP((0.5,) * 4, (0.5, 0.5))
LOWER, UPPER = np.array([-0.39, -0.39]), np.array([-0.2156, -0.2757])


def scene(restitution, **kwargs):
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop(tuple(LOWER), tuple(UPPER), restitution))
    return rde.Scene(ARM, effects, **{"tolerance": None, **kwargs})


def before_stops(gaps, rng):
    """States whose sliders are at a distance before stops, and mostly move towards them, (n, 4) each."""
    n = len(gaps)
    upper = rng.random((n, 2)) < 0.5
    side = np.where(upper, 1.0, -1.0)
    speed = side * 10.0 ** rng.uniform(-2.0, 1.7, (n, 2)) * np.where(rng.random((n, 2)) < 0.85, 1.0, -1.0)
    at = np.clip(np.where(upper, UPPER, LOWER) - side * gaps, LOWER, UPPER)
    q, qd = rng.uniform(-3.0, 3.0, (n, 4)), rng.normal(0.0, 4.0, (n, 4))
    q[:, 1::2], qd[:, 1::2] = at, speed
    return q, qd


def tips_after(made, q, qd):
    batch = rde.BatchSimulator(made, len(q))
    batch.set_state(q, qd)
    flagged = batch.advance().numerics != 0
    return ARM.forward_kinematics(batch.q), flagged


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("control_dt", [0.02, 1e-4])
@pytest.mark.parametrize("smallest", [-18.0, -13.0], ids=["digits before", "picometres before"])
def test_the_order_of_two_impacts_does_not_depend_on_the_steps(restitution, control_dt, smallest):
    rng = np.random.default_rng(0)
    gaps = 10.0 ** rng.uniform(smallest, smallest + 5.0, (8000, 2))
    gaps[::3, 1] = gaps[::3, 0]
    states = before_stops(gaps, rng)
    coarser, finer = (
        tips_after(scene(restitution, control_dt=control_dt, substeps=n), *states)[0] for n in (96, 160)
    )
    judged = np.linalg.norm(coarser - finer, axis=1) <= 1e-7
    assert judged.mean() > 0.999
    tips, flagged = tips_after(scene(restitution, control_dt=control_dt, tolerance=1e-6), *states)
    assert (np.linalg.norm(tips - finer, axis=1) <= 1e-6)[judged & ~flagged].all()
    assert flagged.mean() < 1e-3


@pytest.mark.parametrize("travel", [0.001, 0.25])
@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_sliders_that_turn_right_before_their_stops_do_not_arrive_there(travel, restitution):
    """They start a few digits before them, are slow, and some are pulled away: no impact is made up."""
    rng, n = np.random.default_rng(1), 20_000
    upper = rng.random((n, 2)) < 0.7
    side = np.where(upper, 1.0, -1.0)
    digits = rng.integers(0, 8, (n, 2)) * np.where(upper, np.spacing(travel), 1e-19)
    at = np.where(
        rng.random((n, 2)) < 0.3, travel * rng.random((n, 2)), np.where(upper, travel, 0.0) - side * digits
    )
    speed = side * 10.0 ** rng.uniform(-12.0, -2.0, (n, 2)) * np.where(rng.random((n, 2)) < 0.8, 1.0, -1.0)
    q, qd = rng.uniform(-3.0, 3.0, (n, 4)), rng.normal(0.0, 1.0, (n, 4))
    q[:, 1::2], qd[:, 1::2] = np.clip(at, 0.0, travel), speed
    arm = rde.RPRP((0.5,) * 4, (0.25, 0.25))
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop((0.0, 0.0), (travel,) * 2, restitution))
    efforts = rng.normal(size=(n, 4)) * (1.0, 5.0, 1.0, 5.0)
    ends = []
    for kwargs in ({"tolerance": 1e-6}, {"substeps": 96}, {"substeps": 160}):
        batch = rde.BatchSimulator(rde.Scene(arm, effects, **{"tolerance": None, **kwargs}), n)
        batch.set_state(q, qd)
        assert not batch.advance(efforts).numerics.any()
        ends.append(arm.forward_kinematics(batch.q))
    tips, coarser, finer = ends
    judged = np.linalg.norm(coarser - finer, axis=1) <= 1e-7
    assert judged.mean() > 0.999
    assert np.linalg.norm(tips - finer, axis=1)[judged].max() <= 1e-6


def slow_leavers(n, travel):
    """States and efforts, (n, 4) each: a slider leaves its stop slowly, the other one is about to strike."""
    rng = np.random.default_rng(2)
    upper, first = rng.random((n, 2)) < 0.7, rng.random(n) < 0.5
    side = np.where(upper, 1.0, -1.0)
    strikes = np.stack([first, ~first], axis=1)
    digits = rng.integers(1, 8, (n, 2)) * np.where(upper, np.spacing(travel), 1e-19)
    speed = 10.0 ** np.where(strikes, rng.uniform(-6.0, -2.0, (n, 2)), rng.uniform(-12.0, -8.0, (n, 2)))
    q, qd = rng.uniform(-3.0, 3.0, (n, 4)), rng.normal(0.0, 1.0, (n, 4))
    q[:, 1::2] = np.where(upper, travel, 0.0) - side * digits * strikes
    qd[:, 1::2] = side * np.where(strikes, speed, -speed)
    return q, qd, rng.normal(size=(n, 4)) * (1.0, 5.0, 1.0, 5.0)


@pytest.mark.parametrize("control_dt", [0.02, 0.1])
@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_a_slider_that_leaves_its_stop_slowly_does_not_rest_there_when_the_other_one_strikes(
    control_dt, restitution
):
    """When it strikes, the slow one has not yet moved by a digit of its position."""
    travel, n = 0.001, 4000
    q, qd, efforts = slow_leavers(n, travel)
    arm = rde.RPRP((0.5,) * 4, (0.25, 0.25))
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop((0.0, 0.0), (travel,) * 2, restitution))
    ends = []
    for kwargs in ({"integrator": "dop853"}, {"tolerance": 1e-9}, {"substeps": 160}, {"substeps": 1536}):
        made = rde.Scene(arm, effects, **{"tolerance": None, "control_dt": control_dt, **kwargs})
        batch = rde.BatchSimulator(made, n)
        batch.set_state(q, qd)
        assert not batch.advance(efforts).numerics.any()
        ends.append(arm.forward_kinematics(batch.q))
    *tips, coarser, finer = ends
    judged = np.linalg.norm(coarser - finer, axis=1) <= 1e-10
    assert judged.mean() > 0.999
    for reached, limit in zip(tips, (2e-9, 1e-9), strict=True):
        assert np.linalg.norm(reached - finer, axis=1)[judged].max() <= limit


def test_an_account_that_shares_no_code_lets_slow_sliders_leave_their_stops():
    """If these rested, they would be off by 6e-6."""
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    travel, some = 0.001, [3, 23, 67, 266]
    q, qd, efforts = (x[some] for x in slow_leavers(4000, travel))
    arm = rde.RPRP((0.5,) * 4, (0.25, 0.25))
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop((0.0, 0.0), (travel,) * 2, 0.0))
    batch = rde.BatchSimulator(rde.Scene(arm, effects, integrator="dop853", tolerance=None), len(some))
    batch.set_state(q, qd)
    batch.advance(efforts)
    account = StoppedArm(arm.masses, arm.lengths, 9.81, 0.0, travel, 0.0)
    expected = [account.after(*start, 0.02) for start in zip(q, qd, efforts, strict=True)]
    assert np.abs(np.concatenate([batch.q, batch.qd], axis=1) - expected).max() < 1e-11
