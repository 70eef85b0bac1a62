"""Motions along ways: their ends, their derivatives, and times that the motors can follow."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.time_law import SAMPLES, evenly, quickest, quintic, rounded, timed

MODEL = NominalModel(rde.load_scene("four_r_reach"))
CORNER = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.5, 0.0], [1.0, 2.0, 0.5, -1.0]])
DT = 1e-3


def assert_derivatives(motion):
    for table, rates in ((motion.phi, motion.phid), (motion.phid, motion.phidd)):
        slopes = (table[:, 2:] - table[:, :-2]) / (2 * DT)
        np.testing.assert_allclose(rates[:, 1:-1], slopes, atol=0.02 * np.abs(slopes).max())


def test_a_motion_is_from_rest_to_rest_and_has_the_derivatives_of_its_places():
    ways = rounded(evenly(MODEL, CORNER)[None], 0.1)
    np.testing.assert_allclose(ways[0, [0, -1]], CORNER[[0, -1]], atol=1e-12)
    motion = timed(ways, np.array([0.8]), DT, 900)
    np.testing.assert_allclose(motion.phi[0, [0, 800, 900]], CORNER[[0, -1, -1]], atol=1e-12)
    assert not motion.phid[0, [0, 800, 900]].any()
    assert not motion.phidd[0, 800:].any()
    assert_derivatives(motion)


def test_rounding_leaves_lines_and_cuts_corners():
    line = evenly(MODEL, CORNER[[0, 2]])
    np.testing.assert_allclose(rounded(line[None], 0.1)[0], line, atol=1e-12)
    sharp = evenly(MODEL, CORNER)
    turns = [np.abs(np.diff(way, 2, axis=0)).max() for way in (sharp, rounded(sharp[None], 0.1)[0])]
    assert turns[1] < 0.1 * turns[0]


@pytest.mark.parametrize("arm", ["four_r", "rprp"])
def test_the_quickest_time_is_the_first_in_which_the_motors_suffice(arm):
    model, rng = NominalModel(rde.load_scene(f"{arm}_reach")), np.random.default_rng(2)
    ends = np.where(model.slides, rng.uniform(0, 0.25, (2, 9, 4)), rng.uniform(-2, 2, (2, 9, 4)))
    ways, times = np.linspace(*ends, 3, axis=1), np.array([0.4, 0.7, 1.0, 1.4])
    loads = []
    for seconds in times:
        dt = seconds * SAMPLES[1]
        motion = timed(ways, np.full(9, seconds), dt, len(SAMPLES) - 1)
        loads.append(model.load(*motion).max(axis=1))
    enough = np.array(loads) < 0.9
    assert enough.any(axis=0).any()
    assert not enough.all()
    first = np.where(enough.any(axis=0), enough.argmax(axis=0), np.argmin(loads, axis=0))
    seconds, most = quickest(model, ways, times, 0.9)
    np.testing.assert_array_equal(seconds, times[first])
    np.testing.assert_allclose(most, np.array(loads)[first, np.arange(9)], rtol=1e-9)
    latest = np.where(np.arange(9) < 4, 0.7, 1.4)  # times of each lane alone
    own = quickest(model, ways, np.minimum(times[:, None], latest), 0.9)[0]
    np.testing.assert_array_equal(own, np.where(seconds <= latest, seconds, own.clip(0.4, latest)))
    np.testing.assert_array_equal(own[4:], seconds[4:])


def test_a_quintic_begins_with_a_rate_and_ends_at_rest():
    phi, phid = CORNER[:1], np.array([[1.0, -2.0, 0.5, 3.0]])
    motion = quintic(phi, phid, CORNER[2:], 0.7, DT, 800)
    np.testing.assert_allclose(motion.phi[0, [0, 700, 800]], CORNER[[0, 2, 2]], atol=1e-12)
    np.testing.assert_allclose(motion.phid[0, [0, 700, 800]], [phid[0], np.zeros(4), np.zeros(4)], atol=1e-12)
    np.testing.assert_allclose(motion.phidd[0, [0, 700, 800]], 0.0, atol=1e-12)
    assert_derivatives(motion)
