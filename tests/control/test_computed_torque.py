"""The expert: it holds nearly every goal, or expert or goals are wrong."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.computed_torque import ComputedTorque, lightest_pose, pose_at
from redundant_envs.control.statics import effort_limits, motor_efforts
from redundant_envs_train.rollout import expert_act, run_episodes


@pytest.mark.parametrize("env_id", ["RPRPReach-v0", "FourRReach-v0"])
def test_the_expert_holds_the_goals(env_id):
    outcome = run_episodes(env_id, expert_act(), 1000, seed=3_000_000)
    assert outcome.hold.mean() >= 0.995
    assert np.median(outcome.distance) < 1e-4


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_poses_are_at_the_goal_and_inside_the_travel(name):
    scene = rde.load_scene(name)
    rng = np.random.default_rng(0)
    start = rng.uniform(-1, 1, (500, 4))
    start[:, [k for k in range(4) if scene.robot.prismatic[k]]] = 0.1
    angle, radius = rng.uniform(-np.pi, np.pi, 500), np.sqrt(rng.uniform(0.01, 0.9, 500))
    goal = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    pose = pose_at(scene, start, goal)
    np.testing.assert_allclose(scene.robot.forward_kinematics(pose), goal, atol=1e-6)
    for joint, (low, high) in scene.travel().items():
        values = scene.parameters()
        joints = pose @ scene.robot.motor_map
        assert (joints[:, joint] >= values[low]).all()
        assert (joints[:, joint] <= values[high]).all()


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_the_lightest_pose_is_at_the_goal_near_the_start_and_loads_no_motor_more(name):
    scene = rde.load_scene(name)
    robot, limits = scene.robot, effort_limits(scene)
    rng = np.random.default_rng(1)
    start = rng.uniform(-9, 9, (60, 4))
    start[:, [k for k in range(4) if robot.prismatic[k]]] = 0.1
    angle, radius = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.2, 0.9, 60)
    goal = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    pose = lightest_pose(scene, start, goal)
    np.testing.assert_allclose(robot.forward_kinematics(pose), goal, atol=1e-9)
    turned = ((pose - start) @ robot.motor_map)[:, [k for k in range(4) if not robot.prismatic[k]]]
    assert np.abs(turned).max() <= np.pi + 1e-9

    def load(q):
        return (np.abs(motor_efforts(scene, q)) / limits).max(axis=1)

    other = load(pose_at(scene, start, goal))
    assert (load(pose) <= other + 1e-6).all()
    assert np.median(load(pose)) < 0.8 * np.median(other)
    beyond = np.tile((5.0, 0.0), (60, 1))  # the arm stretches towards it, some by more than half a turn
    stretched = pose_at(scene, start, beyond)
    assert np.abs((stretched - start) @ robot.motor_map).max() > np.pi
    np.testing.assert_array_equal(lightest_pose(scene, start, beyond), stretched)


def test_the_plan_ends_in_the_pose_that_is_chosen():
    """Of two ways to a goal, elbow up and elbow down, it takes the requested one."""
    scene = rde.load_scene("four_r_reach")
    start = np.array([[0.3, -0.2, 0.1, 0.4]])
    end = np.array([[0.5, 0.1, -0.3, 0.2]])
    controller = ComputedTorque(scene, pose=lambda scene, q, goal: end)
    controller.begin(start, np.array([[0.6, 0.1]]))
    batch = rde.BatchSimulator(scene, 1)
    batch.set_state(start, np.zeros((1, 4)))
    for k in range(120):
        batch.advance(effort_limits(scene) * controller.action(k * scene.control_dt, batch.q, batch.qd))
    np.testing.assert_allclose(batch.q, end, atol=1e-3)


def test_scenes_it_cannot_handle_are_refused():
    arm = rde.FourR((1,) * 4, (1,) * 4)
    with pytest.raises(ValueError, match="EffortLimits"):
        ComputedTorque(rde.Scene(arm))
    e = rde.effects
    with pytest.raises(ValueError, match="along x"):
        ComputedTorque(rde.Scene(arm, (e.EffortLimits(1.0), e.Gravity(9.81, (0.5, -0.5)))))
