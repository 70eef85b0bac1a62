"""Computed torque along references of lanes."""

import numpy as np

import redundant_envs as rde
from redundant_envs.control.following import Following, leaning
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.time_law import timed

SCENE = rde.load_scene("rprp_reach")
MODEL = NominalModel(SCENE)


def test_an_arm_follows_references_that_begin_at_different_times():
    start = np.array([[-1.4, 0.05, 0.2, 0.05], [-1.6, 0.1, -0.2, 0.1]])
    end = np.array([[-0.7, 0.15, 0.8, 0.0], [-2.2, 0.2, -0.6, 0.05]])
    motion = timed(np.linspace(start, end, 3, axis=1), np.array([1.0, 1.0]), SCENE.control_dt, 55)
    following, batch = Following(MODEL), rde.BatchSimulator(SCENE, 2)
    batch.set_state(start @ MODEL.inverse, np.zeros((2, 4)))
    still = timed(np.linspace(start, start, 3, axis=1), np.array([1.0, 1.0]), SCENE.control_dt, 55)
    following.begin(still)
    begun = np.array([np.inf, np.inf])
    for k in range(80):
        t = k * SCENE.control_dt
        new = np.array([lane for lane in (0, 1) if k == 10 * lane], dtype=np.intp)
        if len(new):
            following.begin(type(motion)(*(x[new] for x in motion)), new)
            begun[new] = t
        since = np.where(np.isfinite(begun), t - begun, 0.0)
        batch.advance(MODEL.limits * following.action(since, batch.q, batch.qd))
    np.testing.assert_allclose(batch.q @ MODEL.b, end, atol=2e-3)


def test_a_slider_at_rest_leans_on_its_stop():
    efforts, phi = np.full((2, 4), [1.0, 2.0, 3.0, -4.0]), np.full((2, 4), [0.0, 0.0, 0.0, 0.25])
    resting = np.array([True, False])
    np.testing.assert_array_equal(leaning(MODEL, efforts, phi, resting), [[1, 0, 3, 0], [1, 2, 3, -4]])
    np.testing.assert_array_equal(leaning(MODEL, -efforts, phi, resting)[0], -efforts[0])
