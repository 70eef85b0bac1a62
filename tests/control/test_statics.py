"""Efforts at rest: inverse dynamics, springs, and stops that push and never pull."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.statics import effort_limits, motor_efforts, slider_travel, static_efforts

e = rde.effects
SCENES = ("four_r_reach", "rprp_reach")
UNEQUAL = {
    "four_r_reach": rde.FourR((0.7, 0.2, 0.4, 0.9), (0.3, 0.5, 0.1, 0.25)),
    "rprp_reach": rde.RPRP((0.7, 0.2, 0.4, 0.9), (0.3, 0.15)),
}


def changed(name, *effects, robot=None):
    """A reach scene in which effects replace those of the same class, or are added."""
    scene = rde.load_scene(name)
    kinds = tuple(type(x) for x in effects)
    kept = tuple(x for x in scene.effects if not isinstance(x, kinds))
    return dataclasses.replace(scene, effects=(*kept, *effects), robot=robot or scene.robot)


def test_static_efforts_are_inverse_dynamics_at_rest():
    rng = np.random.default_rng(4)
    q = rng.normal(size=(50, 4))
    for name in SCENES:
        scene = changed(name, e.Gravity(9.0), robot=UNEQUAL[name])
        arm = scene.robot
        forces = arm.inverse_dynamics(q, 0 * q, 0 * q, g=9.0)
        np.testing.assert_allclose(static_efforts(scene, q) @ arm.motor_map.T, forces, atol=1e-12)
        np.testing.assert_allclose(static_efforts(scene, q[3]), static_efforts(scene, q)[3], rtol=1e-15)


def test_springs_and_tilted_gravity_are_part_of_the_efforts():
    spring = e.CentringSpring((30.0, 50.0), (0.0, 0.0), (0.25, 0.25))
    q = np.array([[0.0, 0.2, np.pi / 2, 0.1]])
    scene = changed("rprp_reach", spring, e.Gravity(10.0, (-1.0, 0.0)))
    # Gravity along -x: 1.5 kg pull slider 1 in, and link 2 turns back by 10 (0.5 0.25 + 0.5 0.35) N m.
    # The springs pull to 0.125 m: 60 N/m over 0.075 m inwards, 100 N/m over 0.025 m outwards.
    np.testing.assert_allclose(static_efforts(scene, q), [[-3.0, 15.0 + 4.5, -3.0, -2.5]], atol=1e-12)


def test_a_stop_pushes_and_never_pulls():
    scene = rde.load_scene("rprp_reach")
    up, down, weight, tip = np.pi / 2, -np.pi / 2, 1.5 * 9.81, 0.5 * 9.81
    q = [[up, 0.0, up, 0.0], [up, 0.25, up, 0.25], [down, 0.0, down, 0.0], [down, 0.25, down, 0.25],
         [up, 0.1, down, 0.1], [up, 0.0, down, 0.0]]  # fmt: skip
    sliders = motor_efforts(scene, np.array(q))[:, [1, 3]]
    expected = [[0, 0], [weight, tip], [-weight, -tip], [0, 0], [weight, -tip], [0, -tip]]
    np.testing.assert_allclose(sliders, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (rde.Scene(rde.FourR((1,) * 4, (1,) * 4)), ["EffortLimits.limits", "None", "positive"]),
        (changed("four_r_reach", e.EffortLimits((1, 0, 1, 1))), ["EffortLimits.limits", "0.0", "positive"]),
        (changed("four_r_reach", e.LimitSpring("joint2", -2, 2)), ["effects[3]", "LimitSpring", "leave"]),
        (changed("rprp_reach", e.PrismaticStop((0, 0), (None, 1))), ["PrismaticStop", "'r1'", "both ends"]),
        (changed("rprp_reach", e.PrismaticStop((0, -0.3), (1, 1))), ["'r2'", "-0.3", "-0.25"]),
        (dataclasses.replace(rde.load_scene("rprp_reach"), actuation="generalized"), ["actuation", "joint"]),
    ],
)
def test_scenes_it_cannot_account_for_are_refused(scene, words):
    with pytest.raises(ValueError) as error:
        (effort_limits(scene), slider_travel(scene), static_efforts(scene, np.zeros(4)))
    for word in words:
        assert word in str(error.value)
