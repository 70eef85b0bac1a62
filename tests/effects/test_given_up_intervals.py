"""Intervals with too many impacts, or endless searches: given up, flagged, and the state restored."""

import numpy as np
import pytest
from stopped_scenes import scene

import redundant_envs as rde
from redundant_envs.numerics.tableaus import METHODS


def test_too_many_impacts_end_the_lane_and_leave_its_neighbours():
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    made = scene(arm, 1.0, gravity=0.0, tolerance=1e-6)
    batch = rde.BatchSimulator(made, 3)
    q = np.tile([0.3, 0.1, 0.3, 0.1], (3, 1))
    qd = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 1e5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    batch.set_state(q, qd)
    status = batch.advance()
    np.testing.assert_array_equal(status.numerics, [0, rde.Numerics.EVENT_BUDGET, 0])
    np.testing.assert_array_equal(batch.q[1], q[1])  # back where its interval began
    np.testing.assert_array_equal(batch.qd[1], qd[1])
    np.testing.assert_array_equal(batch.q[0], batch.q[2])


@pytest.mark.parametrize(
    "kwargs", [{"integrator": "rk8"}, {"integrator": "rk4"}, {"tolerance": 1e-6}], ids=str
)
@pytest.mark.parametrize("speed", [50.0, 1e3, 1e8])
def test_steps_far_too_long_end_lanes_but_never_hang(kwargs, speed):
    """Radians per step, impacts that no search finds: flagged, between the stops, and over."""
    rng = np.random.default_rng(0)
    q = np.column_stack([rng.uniform(-3, 3, 512), rng.uniform(0, 0.3, 512)] * 2)
    batch = rde.BatchSimulator(scene(restitution=0.5, **kwargs), 512)
    batch.set_state(q, rng.normal(0, speed, (512, 4)))
    status = batch.advance(rng.normal(0, 20, (512, 4)))
    finite = np.isfinite(np.column_stack([batch.q, batch.qd])).all(axis=1)
    np.testing.assert_array_equal(finite, status.numerics & rde.Numerics.NON_FINITE == 0)
    np.testing.assert_array_equal(finite, status.finite)
    sliders = batch.q[status.finite][:, [1, 3]]
    assert (sliders >= 0.0).all()
    assert (sliders <= 0.3).all()


@pytest.mark.parametrize("kwargs", [{"tolerance": 1e-6}, {"integrator": "rk4", "substeps": 4}], ids=str)
def test_a_lane_whose_events_are_given_up_has_not_moved(kwargs):
    batch = rde.BatchSimulator(scene(gravity=0.0, **kwargs), 2, track_work=True)
    q, qd = [[0.3, 0.1, 0.3, 0.1]] * 2, [[0.0, 1e5, 0.0, 0.0], [0.1, 0.5, 0.0, 0.0]]
    batch.set_state(q, qd)
    status = batch.advance()
    assert status.numerics.tolist() == [rde.Numerics.EVENT_BUDGET, 0]
    np.testing.assert_array_equal(batch.q[0], q[0])
    np.testing.assert_array_equal(batch.qd[0], qd[0])
    assert batch.work[0] == 0.0
    assert status.events[0] == 0
    assert not [x for x in batch.events() if x.lane == 0]


def test_the_budget_of_impacts_is_that_of_the_interval_not_of_a_substep():
    batch = rde.BatchSimulator(scene(gravity=0.0, integrator="rk4", substeps=64), 1, track_work=True)
    q, qd = [0.3, 0.1, 0.3, 0.1], [0.0, 1.5e4, 0.0, 0.0]  # some thirteen in each substep
    batch.set_state(q, qd)
    assert batch.advance().numerics.tolist() == [rde.Numerics.EVENT_BUDGET]
    np.testing.assert_array_equal(batch.q[0], q)
    assert batch.events() == []


@pytest.mark.parametrize("substeps", [1, 50])
@pytest.mark.parametrize("integrator", ["euler", pytest.param("rk4", marks=pytest.mark.long), "rk8"])
def test_fixed_steps_that_a_damper_makes_unstable_are_given_up_before_long(integrator, substeps):
    """Found by fuzzing: every trial step ended beyond a stop, 1e7 times in an interval."""
    robot = rde.RPRP((5e-7, 1.3e-5, 5e5, 1.3e-3), (0.14, 0.65))
    stop = rde.effects.PrismaticStop(lower=(0.0, -0.08), upper=(0.04, 0.42), restitution=0.5)
    friction = rde.effects.ViscousFriction((1.8e5, 1e5, 1.6e5, 1.4e5))
    how = {"integrator": integrator, "substeps": substeps, "control_dt": 0.002}
    batch = rde.BatchSimulator(rde.Scene(robot, [stop, friction], tolerance=None, **how), 2)
    q, qd = [0.755, 0.0, 0.702, 0.42], [1.0, 0.0, -3.6, 0.07]
    batch.set_state([q, [0.7, 0.02, 0.7, 0.3]], [qd, [0.0] * 4])
    status = batch.advance()
    assert (status.evaluations <= METHODS[integrator].stages * (65536 + 18 * substeps)).all()
    assert status.numerics[0] & ~(rde.Numerics.EVENT_BUDGET | rde.Numerics.NON_FINITE) == 0
    if status.numerics[0] == rde.Numerics.EVENT_BUDGET:
        np.testing.assert_array_equal(batch.q[0], q)


def test_a_tolerance_is_not_sought_without_end():
    """16384 steps, too, are unstable here, and each may end beyond a stop many times."""
    robot = rde.RPRP((5e-7, 1.3e-5, 5e5, 1.3e-3), (0.14, 0.65))
    stop = rde.effects.PrismaticStop(lower=(0.0, -0.08), upper=(0.04, 0.42), restitution=0.5)
    friction = rde.effects.ViscousFriction((1.8e5, 1e5, 1.6e5, 1.4e5))
    batch = rde.BatchSimulator(rde.Scene(robot, [stop, friction], tolerance=1e-6), 64)
    rng = np.random.default_rng(0)
    q, qd = np.tile([0.755, 0.0, 0.702, 0.42], (64, 1)), rng.normal(0.0, 3.0, (64, 4))
    batch.set_state(q, qd)
    status = batch.advance(rng.normal(0.0, 1e6, (64, 4)))
    given_up = status.numerics == rde.Numerics.EVENT_BUDGET
    assert given_up.sum() > 5
    assert (status.numerics != 0).all()
    assert (status.evaluations <= 12 * 65536).all()
    np.testing.assert_array_equal(batch.q[given_up], q[given_up])
    np.testing.assert_array_equal(batch.qd[given_up], qd[given_up])


def test_a_budget_of_trial_steps_grows_with_the_substeps():
    """A slider that is near its stop in each of 20 000 substeps."""
    made = scene(rde.RPRP((1.0,) * 4, (0.5, 0.5)), gravity=0.0, integrator="rk4", substeps=20_000)
    batch = rde.BatchSimulator(made, 1)
    batch.set_state([0.0, 0.3 - 1e-9, 0.0, 0.3 - 1e-9], [0.0] * 4)
    assert batch.advance([[0.0, 1e-7, 0.0, -1e-7]]).numerics.tolist() == [0]


def test_as_many_substeps_as_are_asked_for_are_made():
    """More pieces of motion than an interval usually may have; the last ones have an impact."""
    made = scene(rde.RPRP((1.0,) * 4, (0.5, 0.5)), gravity=0.0, integrator="rk4", substeps=70_000)
    batch = rde.BatchSimulator(made, 1)
    batch.set_state([0.0, 0.1, 0.0, 0.1], [0.0, 10.4, 0.0, 0.0])
    status = batch.advance()
    assert status.numerics.tolist() == [0]
    assert status.events[0] >= 1
    assert status.evaluations[0] > 4 * 70_000


def test_a_log_of_events_that_is_full_says_so():
    batch = rde.BatchSimulator(scene(gravity=0.0, tolerance=1e-6), 2, track_work=True)
    batch.set_state([[0.3, 0.1, 0.3, 0.1]] * 2, np.zeros((2, 4)))
    batch.advance()
    batch._memory.write(("logged",), 256.0, np.array([1]))
    with pytest.raises(ValueError, match="environment 1 had 256 events or more"):
        batch.events()


def test_simulate_refuses_a_motion_with_too_many_impacts():
    with pytest.raises(ValueError, match=r"more than 256 impacts, or 65536 pieces, in .* at t = 0 s"):
        rde.simulate(scene(gravity=0.0, tolerance=1e-6), [0.3, 0.1, 0.3, 0.1], [0, 1e5, 0, 0], [0.02, 0.04])
