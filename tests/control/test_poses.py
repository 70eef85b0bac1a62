"""Poses at goals, the distances to them, and the choice among them."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import cheapest, far_apart, pose_at, poses_at

MODELS = [NominalModel(rde.load_scene(f"{arm}_reach")) for arm in ("four_r", "rprp", "two_r")]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.arm.kind)
GOALS = np.array([[0.5, 0.2], [-0.1, 0.6]])


@every_model
def test_poses_are_at_the_goal_and_within_half_a_turn_of_the_start(model):
    start = np.where(model.slides, 0.1, np.random.default_rng(1).uniform(-9, 9, (2, model.joints)))
    poses = poses_at(model, GOALS, start, grid=5)
    tips = np.broadcast_to(GOALS[:, None], (2, poses.shape[1], 2))
    np.testing.assert_allclose(model.tip(poses), tips, atol=1e-12)
    assert np.abs(poses - start[:, None])[..., ~model.slides].max() <= np.pi + 1e-12
    assert len(np.unique(poses[0].round(9), axis=0)) >= 2


def test_out_of_reach_the_poses_are_that_which_comes_nearest():
    model, start = MODELS[0], np.full((2, 4), 0.3)
    poses = poses_at(model, np.array([[2.0, 0.0], [0.5, 0.0]]), start, grid=3)
    np.testing.assert_allclose(model.tip(poses[0]), np.broadcast_to([1.0, 0.0], (72, 2)), atol=0.02)
    np.testing.assert_allclose(model.tip(poses[1]), np.broadcast_to([0.5, 0.0], (72, 2)), atol=1e-12)


@every_model
def test_joints_that_cannot_move_stay(model):
    if model.joints == 2:
        pytest.skip("the other joint alone reaches no goal")
    start = np.where(model.slides, [0.0, 0.0, 0.25, 0.25], 0.4) * np.ones((2, 1))  # sliders at their stops
    for joint in range(4):
        movable = np.ones((2, 4))
        movable[:, joint] = 0.0
        pose = pose_at(model.scene, start @ model.inverse, GOALS, movable) @ model.b
        np.testing.assert_array_equal(pose[:, joint].round(12), start[:, joint])
        assert np.abs(pose - start).max() > 0.1


def test_a_joint_weighs_as_the_arm_beyond_it():
    for model, beyond in zip(MODELS, ([1, 0.75, 0.5, 0.25], [1, 0.75, 0.5, 0.25], [1, 0.5]), strict=True):
        moved = far_apart(model, np.zeros(model.joints), np.eye(model.joints))
        np.testing.assert_allclose(moved, np.sqrt(beyond))


def test_the_cheapest_come_first_and_again_where_there_are_few():
    poses = np.arange(6.0).reshape(1, 3, 2)
    best, costs = cheapest(poses, np.array([[3.0, 1.0, 2.0]]), 4)
    np.testing.assert_array_equal(best[0], poses[0, [1, 2, 0, 1]])
    np.testing.assert_array_equal(costs, [[1.0, 2.0, 3.0, 1.0]])
