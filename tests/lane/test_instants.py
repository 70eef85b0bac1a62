"""Instants that are known beforehand end planned steps; no scene has any yet."""

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval

STOPS = e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 0.5)
LENGTH, CUTS = 0.02, (0.007, 0.0155)


def scene(arm, length=LENGTH, **steps):
    effects = (e.Gravity(), STOPS) if arm is RPRP else (e.Gravity(),)
    return rde.Scene(arm, effects, control_dt=length, **steps)


def starts(arm, lanes=4):
    rng = np.random.default_rng(8)
    q, qd = rng.uniform(-1.0, 1.0, (lanes, 4)), 2.0 * rng.normal(size=(lanes, 4))
    q[:, np.array(arm.prismatic)] *= 0.1
    return np.concatenate([q, qd], axis=1)


def crossed(made, state, cuts=()):
    """The state after an interval that is cut at some instants."""
    dynamics = Dynamics(made)
    names = dynamics.states
    known = dict(zip(names, np.asarray(state).T, strict=True)) | {f"cut{k}": t for k, t in enumerate(cuts)}
    lane = cross_interval(Interval(dynamics), {**fields_of(dynamics), **known})
    return np.stack([np.broadcast_to(lane[n], np.shape(state)[:-1]) for n in names], axis=-1), lane


@pytest.fixture
def two_cuts(monkeypatch):
    monkeypatch.setattr(Dynamics, "instants", ("cut0", "cut1"))


@pytest.mark.parametrize("arm", [FOUR_R, RPRP])
@pytest.mark.parametrize("steps", [{"integrator": "rk8"}, {"tolerance": 1e-4}, {"integrator": "dop853"}])
def test_an_interval_that_is_cut_ends_as_its_pieces_do_one_after_the_other(two_cuts, arm, steps):
    for state in starts(arm):
        whole, lane = crossed(scene(arm, **steps), state, CUTS)
        pieces = state
        for length in np.diff((0.0, *CUTS, LENGTH)):
            pieces, _ = crossed(scene(arm, length, **steps), pieces, (0.0, 0.0))
        assert float(lane["fault"]) == 0.0
        allowed = 1e-12 if "tolerance" not in steps else 4e-4
        np.testing.assert_allclose(whole, pieces, rtol=0.0, atol=allowed)


def test_a_step_ends_at_each_instant_in_any_order_and_at_no_other(two_cuts):
    made, state = scene(FOUR_R, integrator="rk4"), starts(FOUR_R)[0]
    counts = {
        cuts: float(crossed(made, state, cuts)[1]["evaluations"]) / 4.0
        for cuts in [CUTS, CUTS[::-1], (0.007, 0.007), (0.007, 0.03), (0.0, -1.0)]
    }
    # The common step is one more where an instant makes it useless.
    assert list(counts.values()) == [4.0, 4.0, 3.0, 3.0, 1.0]


def test_substeps_are_cut_where_the_instant_is(two_cuts):
    made, state = scene(FOUR_R, integrator="rk4", substeps=2), starts(FOUR_R)[1]
    whole, lane = crossed(made, state, (0.013, -1.0))
    assert float(lane["evaluations"]) / 4.0 == 4.0
    pieces = state
    for length in (0.01, 0.003, 0.007):
        pieces, _ = crossed(scene(FOUR_R, length, integrator="rk4"), pieces, (0.0, 0.0))
    np.testing.assert_allclose(whole, pieces, rtol=0.0, atol=1e-14)


def test_lanes_of_an_array_are_cut_at_their_own_instants(two_cuts):
    made, rows = scene(RPRP, tolerance=1e-6), starts(RPRP)
    times = np.linspace(0.001, 0.019, len(rows))
    found, _ = crossed(made, rows, (times, 0.0 * times))
    for row, time, end in zip(rows, times, found, strict=True):
        np.testing.assert_allclose(crossed(made, row, (time, 0.0))[0], end, rtol=0.0, atol=1e-13)
