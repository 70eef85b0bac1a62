"""Two sliders that come to their stops almost at once: which is first does not depend on the steps."""

import numpy as np
import pytest

import redundant_envs as rde

ARM = rde.RPRP((0.5,) * 4, (0.5, 0.5))
LOWER, UPPER = np.array([-0.39, -0.39]), np.array([-0.2156, -0.2757])


def scene(restitution, **kwargs):
    effects = (rde.effects.Gravity(), rde.effects.PrismaticStop(tuple(LOWER), tuple(UPPER), restitution))
    return rde.Scene(ARM, effects, **{"tolerance": None, **kwargs})


def before_stops(gaps, rng):
    """States whose sliders are so far before stops, and mostly move towards them, (n, 4) each."""
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
    gaps = 10.0 ** rng.uniform(smallest, smallest + 5.0, (20_000, 2))
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
