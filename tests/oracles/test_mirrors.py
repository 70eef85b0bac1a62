"""Mirrored and turned motions are motions; those known beforehand are hard cases (10, 13, 20, 25, 32) and in
``model/test_trajectory.py``."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Gravity

ARMS = {
    "RPRP": rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6)),
    "FourR": rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)),
}


def path(scene, q, qd, efforts):
    """Coordinates and velocities after 0.2 s, (2, count, 4); no lane reports a fault."""
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    for _ in range(round(0.2 / scene.control_dt)):
        assert not batch.advance(efforts).numerics.any()
    return np.stack([batch.q, batch.qd])


@pytest.mark.quick("RPRP")
@pytest.mark.parametrize("robot", ARMS.values(), ids=ARMS)
def test_mirrors_and_turns_are_symmetries(robot):
    """g = 0: theta -> -theta bitwise, theta + alpha and theta + 2 pi to rounding; g: theta -> pi - theta.

    The last rounds the start by 4e-16 rad, which grows to 1.5e-14 in a typical motion of 0.2 s and a little
    more in the worst of 100.
    """
    angles, rng = np.where(robot.prismatic, 0.0, 1.0), np.random.default_rng(7)
    sign = 1.0 - 2.0 * angles
    q = rng.uniform(-np.pi, np.pi, (100, 4)) * np.where(robot.prismatic, 0.25 / np.pi, 1.0)
    qd, efforts = rng.uniform(-1.0, 1.0, (100, 4)), rng.uniform(-2.0, 2.0, (100, 4))
    exact = {"tolerance": 1e-12, "control_dt": 0.02}
    for how in ({"integrator": "rk4", "control_dt": 0.01}, exact):
        scene = rde.Scene(robot, (Gravity(0.0),), **how)
        here = path(scene, q, qd, efforts)
        assert (path(scene, sign * q, sign * qd, sign * efforts) == sign * here).all()
        for most, turn in ((2e-14, 0.7 * angles), (3e-14, 2.0 * np.pi * angles)):
            turned = path(scene, q + turn, qd, efforts) - np.array([[turn], [0.0 * turn]])
            assert np.abs(turned - here).max() <= most
    scene = rde.Scene(robot, (Gravity(9.81),), **exact)
    mirrored = path(scene, np.pi * angles + sign * q, sign * qd, sign * efforts)
    back = np.array([[np.pi * angles], [0.0 * angles]]) + sign * mirrored
    assert np.abs(back - path(scene, q, qd, efforts)).max() <= 8e-14
