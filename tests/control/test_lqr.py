"""LQR: the Riccati equation, derivatives of an interval, and arms that return to their pose."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import HoldingLQR
from redundant_envs.control.linearisation import from_differences, from_torch
from redundant_envs.control.lqr import riccati

e = rde.effects
SCENES = {name: rde.load_scene(name) for name in ("four_r_reach", "rprp_reach")}
FOUR_R, RPRP = SCENES.values()
LUGRE = e.LuGre(100.0, 1.0, 0.1, 0.1, 0.2)
POSES = {"four_r_reach": [1.2, 0.5, -0.3, -0.8], "rprp_reach": [1.0, 0.1, -0.4, 0.12]}


def cost_of(scene, controller, act, q, intervals=100):
    """Cost of each lane, (n,), and the largest departure from the pose at the end."""
    batch, total = rde.BatchSimulator(scene, len(q)), np.zeros(len(q))
    batch.set_state(q, np.zeros_like(q))
    for _ in range(intervals):
        efforts = act(batch.q, batch.qd) * controller.limits
        x = np.concatenate([batch.q - controller.pose, batch.qd], axis=1)
        for cost, y in ((controller.state_cost, x), (controller.effort_cost, efforts - controller.efforts)):
            total += ((y @ cost) * y).sum(axis=1)
        batch.advance(efforts)
    return total, np.abs(batch.q - controller.pose).max()


@pytest.mark.parametrize("name", SCENES)
def test_it_returns_to_the_pose_and_costs_less_than_any_plain_pd(name):
    scene, pose = SCENES[name], np.array(POSES[name])
    controller, slides, b = HoldingLQR(scene, pose), np.array(scene.robot.prismatic), scene.robot.motor_map
    q = pose + np.random.default_rng(0).uniform(-1.0, 1.0, (16, 4)) * np.where(slides, 0.03, 0.15)
    cost, apart = cost_of(scene, controller, controller.action, q)
    assert apart < 1e-4
    best = np.full(16, np.inf)
    for stiffness in (0.5, 1.0, 2.0):  # limits per rad or per 0.25 m
        for time in (0.1, 0.2):

            def pd(q, qd, stiffness=stiffness, time=time):
                gain = stiffness * np.where(slides, 4.0, 1.0)
                share = controller.efforts / controller.limits - gain * ((q - pose + time * qd) @ b)
                return np.clip(share, -1.0, 1.0)

            best = np.minimum(best, cost_of(scene, controller, pd, q)[0])
    assert np.isfinite(best).all()
    assert (cost < best).all()
    assert cost.mean() < 0.9 * best.mean()


@pytest.mark.parametrize("name", SCENES)
def test_no_other_feedback_costs_less(name):
    scene, pose = SCENES[name], np.array(POSES[name])
    controller = HoldingLQR(scene, pose)
    q, gain = pose + 1e-3 * np.random.default_rng(0).normal(size=(8, 4)), controller.gain
    least, _ = cost_of(scene, controller, controller.action, q)
    for other in (0.8 * gain, 1.2 * gain, np.roll(gain, 1, axis=1) * 0.02 + gain):
        controller.gain = other
        assert (cost_of(scene, controller, controller.action, q)[0] > least).all()


def test_the_riccati_equation_is_solved_of_a_batch():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(5, 6, 6)), rng.normal(size=(5, 6, 2))
    q, r = np.eye(6), 0.3 * np.eye(2)
    p, bt = riccati(a, b, q, r), b.swapaxes(-1, -2)
    gain = np.linalg.solve(r + bt @ p @ b, bt @ p @ a)
    closed = a - b @ gain
    np.testing.assert_allclose(p, q + a.swapaxes(-1, -2) @ p @ closed, rtol=1e-7)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    with pytest.raises(ValueError, match="do not stabilise"):
        riccati(2.0 * np.eye(2), np.zeros((2, 1)), np.eye(2), np.eye(1))


def test_both_ways_have_the_same_derivatives():
    scene = dataclasses.replace(FOUR_R, effects=(e.Gravity(), e.EffortLimits(5.0)), tolerance=1e-9)
    rng = np.random.default_rng(0)
    states, efforts = rng.uniform(-1.0, 1.0, (3, 8)), rng.uniform(-0.5, 0.5, (3, 4))
    for one, other in zip(
        from_torch(scene)(states, efforts), from_differences(scene)(states, efforts), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-4)


def test_a_slider_at_rest_on_its_stop_stays_there():
    state, push = np.array([1.5, 0.25, 1.5, 0.1, 0.0, 0.0, 0.0, 0.0]), np.array([0.0, 25.0, 0.0, 0.0])
    a, b = from_differences(RPRP)(state, push)
    np.testing.assert_array_equal(b[[1, 5]], 0.0)
    np.testing.assert_array_equal(a[[1, 5]][:, [0, 2, 3]], 0.0)
    assert np.abs(from_differences(RPRP)(state, -push)[1][5, 1]) > 0.01


@pytest.mark.parametrize(
    ("scene", "q", "words"),
    [
        (RPRP, [1.0, 0.0, 0.3, 0.1], "'r1' at a stop, 0.0 or 0.25"),
        (rde.Scene(FOUR_R.robot), np.zeros(4), "EffortLimits"),
        (rde.load_scene("four_r_weak"), np.zeros(4), "1.23 times its limits"),
        (dataclasses.replace(FOUR_R, effects=(*FOUR_R.effects, LUGRE)), np.zeros(4), "states .* give"),
    ],
)
def test_other_poses_and_scenes_are_refused(scene, q, words):
    with pytest.raises(ValueError, match=words):
        HoldingLQR(scene, q)
