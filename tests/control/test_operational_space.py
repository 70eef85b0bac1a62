"""Operational-space control: the tip accelerates as wanted, and sliders at stops are held by these."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import OperationalSpace

e = rde.effects
STOPS = e.PrismaticStop((0.0, 0.0), (0.25, 0.25), 0.0)
ARMS = {
    "4R": rde.FourR((0.7, 0.2, 0.4, 0.9), (0.3, 0.5, 0.1, 0.25)),
    "RPRP": rde.RPRP((0.7, 0.2, 0.4, 0.9), (0.3, 0.15)),
}


def scene_of(arm, *effects):
    common = (e.Gravity(9.0), e.ViscousFriction(0.2), e.Payload(0.3), e.Armature(0.01))
    return rde.Scene(ARMS[arm], (*common, *effects), integrator="rk8", substeps=4, control_dt=1e-4)


def accelerations(scene, q, qd, efforts):
    """Mean accelerations of the coordinates and the tip over a short interval of the simulator."""
    batch, robot = rde.BatchSimulator(scene, len(q)), scene.robot
    batch.set_state(q, qd)
    batch.advance(efforts)
    before, after = ((robot.jacobian(x) @ v[..., None])[..., 0] for x, v in ((q, qd), (batch.q, batch.qd)))
    return (batch.qd - qd) / scene.control_dt, (after - before) / scene.control_dt


@pytest.mark.parametrize("arm", ARMS)
def test_the_equations_of_the_model_give_the_wanted_acceleration_exactly(arm):
    robot, rng = ARMS[arm], np.random.default_rng(1)
    q, qd, wanted, posture = (rng.uniform(-1.0, 1.0, (30, k)) for k in (4, 4, 2, 4))
    efforts = OperationalSpace(rde.Scene(robot, (e.Gravity(9.0),))).efforts(q, qd, wanted, posture)
    qdd = robot.forward_dynamics(q, qd, efforts @ robot.motor_map.T, g=9.0)
    tip = (robot.jacobian(q) @ qdd[..., None])[..., 0] + robot.jacobian_dot_qd(q, qd)
    np.testing.assert_allclose(tip, wanted, atol=1e-11)


@pytest.mark.parametrize("arm", ARMS)
def test_the_tip_accelerates_as_wanted_whatever_the_posture_does(arm):
    scene, rng = scene_of(arm), np.random.default_rng(0)
    q, qd, wanted, posture = (rng.uniform(-1.0, 1.0, (30, k)) for k in (4, 4, 2, 4))
    controller = OperationalSpace(scene)
    coordinates = []
    for wish in (None, posture):
        qdd, tip = accelerations(scene, q, qd, controller.efforts(q, qd, wanted, wish))
        np.testing.assert_allclose(tip, wanted, atol=0.02)
        coordinates.append(qdd)
    assert np.abs(coordinates[1] - coordinates[0]).max() > 0.3


def test_a_slider_at_a_stop_leaves_the_tip_to_the_others_and_leans():
    scene = scene_of("RPRP", STOPS)
    q = np.array([[0.9, 0.0, -0.4, 0.1], [0.9, 0.25, -0.4, 0.25]])
    qd = np.zeros((2, 4))
    wanted = np.array([[-1.0, -2.0], [1.0, 2.0]])  # inwards at the lower stop, outwards at the upper ones
    efforts = OperationalSpace(scene).efforts(q, qd, wanted)
    qdd, tip = accelerations(scene, q, qd, efforts)
    np.testing.assert_allclose(tip[0], wanted[0], atol=0.02)
    assert qdd[0, 1] == 0.0
    assert efforts[0, 1] <= 0.0
    away = OperationalSpace(scene).efforts(q[:1], qd[:1], -wanted[:1])
    assert accelerations(scene, q[:1], qd[:1], away)[0][0, 1] > 0.1


def test_what_is_impossible_is_refused():
    scene = scene_of("4R")
    with pytest.raises(ValueError, match="less than full rank"):
        OperationalSpace(scene).efforts(np.zeros(4), np.zeros(4), np.ones(2))
    with pytest.raises(ValueError, match="actuation"):
        OperationalSpace(dataclasses.replace(scene, actuation="generalized"))
