"""Poses at goals: each has its tip at the goal, and the set is complete."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.goal_poses import goal_poses, num_sheets
from redundant_envs.control.statics import slider_travel

SCENES = ("four_r_reach", "rprp_reach")
UNEQUAL = {
    "four_r_reach": rde.FourR((0.7, 0.2, 0.4, 0.9), (0.3, 0.5, 0.1, 0.25)),
    "rprp_reach": rde.RPRP((0.7, 0.2, 0.4, 0.9), (0.3, 0.15)),
}


def drawn_goals(count, seed, most=0.95):
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(-np.pi, np.pi, count), np.sqrt(rng.uniform(0.01, most**2, count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("unequal", [False, True])
def test_every_parameter_gives_a_pose_at_the_goal_within_the_travel(name, unequal):
    scene = rde.load_scene(name)
    arm = UNEQUAL[name] if unequal else scene.robot
    travel = slider_travel(scene)
    rng = np.random.default_rng(1)
    psi = rng.uniform(0.0, np.pi, (400, 2))
    psi[::7, 0], psi[1::7, 1], psi[2::7, 0], psi[3::7, 1] = 0.0, 0.0, np.pi, np.pi
    goals = np.concatenate([drawn_goals(397, 2, 0.8), [[0.0, 0.0], [0.25, 0.0], [0.0, -0.25]]])
    for sheet in range(num_sheets(arm)):
        q = goal_poses(arm, travel, goals, psi, np.full(400, sheet))
        reached = np.isfinite(q).all(axis=1)
        assert reached.mean() > 0.9
        np.testing.assert_allclose(arm.forward_kinematics(q[reached]), goals[reached], atol=1e-14)
        for joint, (low, high) in travel.items():
            assert ((q[reached, joint] >= low) & (q[reached, joint] <= high)).all()


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("unequal", [False, True])
def test_every_pose_is_near_one_of_the_grid(name, unequal):
    """The surface of poses at a goal is covered completely."""
    scene = rde.load_scene(name)
    arm, travel = UNEQUAL[name] if unequal else scene.robot, slider_travel(scene)
    rng = np.random.default_rng(3)
    q = rng.uniform(-np.pi, np.pi, (40, 4))
    for joint, (low, high) in travel.items():
        q[:, joint] = rng.uniform(low, high, 40)
        q[joint::5, joint], q[joint + 1 :: 5, joint] = low, high  # stops are met exactly
    x = np.linspace(0.0, np.pi, 121)
    psi = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    sheets = np.arange(num_sheets(arm))[:, None, None]
    for pose, goal in zip(q, arm.forward_kinematics(q), strict=True):
        grid = goal_poses(arm, travel, goal, psi, sheets)
        gap = np.abs(grid - pose)
        for joint in travel:
            gap[..., joint][(pose[joint] in travel[joint]) & (gap[..., joint] > 0.0)] = np.inf
        turning = [k for k in range(4) if k not in travel]
        gap[..., turning] = np.abs((gap[..., turning] + np.pi) % (2.0 * np.pi) - np.pi)
        assert gap.max(axis=-1).min() < 0.15


@pytest.mark.parametrize("name", SCENES)
def test_an_arm_with_its_tip_at_its_base_points_anywhere(name):
    scene = rde.load_scene(name)
    x = np.linspace(0.0, np.pi, 41)
    psi = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    sheets = np.arange(num_sheets(scene.robot))[:, None, None]
    q = goal_poses(scene.robot, slider_travel(scene), np.zeros(2), psi, sheets)
    np.testing.assert_allclose(scene.robot.forward_kinematics(q), 0.0, atol=1e-14)
    assert np.diff(np.sort(q[..., 0].ravel())).max() < 0.1
    assert [q[..., 0].min(), q[..., 0].max()] == pytest.approx([-np.pi, np.pi])
