"""Resolved motion: the tip follows its path whatever the null space does, and each term does what it says."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import ResolvedMotion, motor_efforts, pose_at
from redundant_envs.control.holding import effort_limits
from redundant_envs.control.resolved_motion import (
    centring_gradient,
    gradient,
    load_gradient,
    manipulability_gradient,
)

SCENES = {name: rde.load_scene(name) for name in ("four_r_reach", "rprp_reach")}
FOUR_R, RPRP = SCENES.values()
INTERVAL = 0.02
TURN = np.linspace(0.0, 2.0 * np.pi, 101)[:, None]
CIRCLE = np.array([0.4, 0.1]) + 0.15 * np.concatenate([np.cos(TURN), np.sin(TURN)], axis=1)
STARTS = {"four_r_reach": [0.8, 0.3, -0.5, -0.9], "rprp_reach": [0.8, 0.1, -0.9, 0.15]}


def followed(name, *terms):
    scene = SCENES[name]
    start = pose_at(scene, np.array([STARTS[name]]), CIRCLE[:1])[0]
    return ResolvedMotion(scene, terms, gain=20.0).follow(start, CIRCLE, INTERVAL)


def most_load(scene, q):
    return (np.abs(motor_efforts(scene, q)) / effort_limits(scene)).max(axis=-1).mean()


@pytest.mark.parametrize("name", SCENES)
def test_the_tip_stays_on_the_path_and_the_motors_carry_less(name):
    scene = SCENES[name]
    plain, light = followed(name), followed(name, load_gradient(scene, 5.0))
    for poses in (plain, light):
        tip = scene.robot.forward_kinematics(poses)
        assert np.linalg.norm(tip - CIRCLE, axis=1).max() < 3e-3
    assert most_load(scene, light) < most_load(scene, plain) - 0.005


def test_manipulability_grows_at_rest_and_the_tip_stays():
    q = np.array([0.5, 0.6, 0.5, 3.5])  # nearly folded
    tip = np.tile(FOUR_R.robot.forward_kinematics(q), (100, 1))
    poses = ResolvedMotion(FOUR_R, (manipulability_gradient(FOUR_R, 2.0),)).follow(q, tip, INTERVAL)
    np.testing.assert_allclose(FOUR_R.robot.forward_kinematics(poses), tip, atol=1e-3)
    grown = FOUR_R.robot.manipulability(poses)
    assert (np.diff(grown) > -1e-6).all()
    assert grown[-1] > 1.5 * grown[0]


def test_sliders_stay_within_their_travel_and_are_centred():
    plain, centred = followed("rprp_reach"), followed("rprp_reach", centring_gradient(RPRP, 5.0))
    for poses in (plain, centred):
        assert ((poses[:, [1, 3]] >= 0.0) & (poses[:, [1, 3]] <= 0.25)).all()
    far, near = (np.abs(poses[:, [1, 3]] - 0.125).mean() for poses in (plain, centred))
    assert near < far - 0.005


def test_a_gradient_from_outside_is_followed_in_the_null_space_alone():
    """Here it lifts the second point mass, as the clearance from an obstacle below the arm would."""

    def height(q):
        return FOUR_R.robot.points(q)[..., 1, 1]

    low, high = followed("four_r_reach"), followed("four_r_reach", lambda q: 20.0 * gradient(height, q))
    assert height(high)[25:].mean() > height(low)[25:].mean() + 0.02


def test_gradients_are_those_of_the_quantities():
    q, way = np.array([[0.9, 0.1, -0.4, 0.05], [0.2, 0.2, 1.0, 0.2]]), np.array([0.3, -0.1, 0.5, 0.2])
    middle = ((q @ RPRP.robot.motor_map)[:, [1, 3]] - 0.125) / 0.25
    np.testing.assert_allclose(centring_gradient(RPRP)(q)[:, [1, 3]], -middle / 0.25, atol=1e-12)
    slope = gradient(lambda x: (x**2 * way).sum(-1), q)
    np.testing.assert_allclose(slope, 2.0 * q * way, atol=1e-9)


def test_a_singular_pose_is_refused():
    with pytest.raises(ValueError, match="less than full rank"):
        ResolvedMotion(FOUR_R).rates(np.zeros(4), np.ones(2), np.zeros(2))
