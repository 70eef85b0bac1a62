"""How far links are from discs."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.clearance import clearance, clearance_slopes, discs_of
from redundant_envs.control.nominal import NominalModel

SCENES = [rde.load_scene(name) for name in ("four_r_around", "rprp_around", "two_r_around")]


def test_clearance_by_hand():
    model = NominalModel(rde.load_scene("two_r_around"))  # links of 0.5 m, stretched along x
    discs = np.array([[[0.25, 0.3, 0.1]], [[1.3, 0.4, 0.2]], [[-0.3, 0.0, 0.1]], [[0.8, 0.05, 0.1]]])
    np.testing.assert_allclose(clearance(model, np.zeros((4, 2)), discs), [0.2, 0.3, 0.2, -0.05], atol=1e-15)
    several = np.array([[0.25, -0.45, 0.1], [0.6, 0.9, 0.1]])  # the elbow, and the tip 0.1 m from the second
    up = np.array([0.0, np.pi / 2])
    assert clearance(model, up, several) == pytest.approx(np.hypot(0.1, 0.4) - 0.1)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.robot.kind)
def test_slopes_are_differences_of_the_distances(scene):
    model, rng = NominalModel(scene), np.random.default_rng(0)
    phi = rng.uniform(0.05, 0.2, (50, model.joints)) + np.where(model.slides, 0.0, rng.uniform(-3, 3))
    discs = rng.uniform(0.05, 0.6, (50, 3, 3))
    gaps, slopes = clearance_slopes(model, phi, discs)
    np.testing.assert_allclose(gaps.min(axis=1), clearance(model, phi, discs), atol=1e-15)
    for joint, h in enumerate(1e-6 * np.eye(model.joints)):
        ahead, behind = (clearance_slopes(model, phi + way, discs)[0] for way in (h, -h))
        np.testing.assert_allclose(slopes[..., joint], (ahead - behind) / 2e-6, atol=1e-4)


def test_discs_are_those_of_the_lanes():
    scene = rde.load_scene("four_r_around")
    keys = [effect.key for effect in scene.effects if isinstance(effect, rde.effects.KeepOut)]
    numbers = {f"{key}.centre": np.array([[k, 1.0], [k, 2.0]]) for k, key in enumerate(keys)}
    numbers |= {f"{key}.radius": np.array([0.1, 0.2]) for key in keys}
    expected = [[[k, 1.0, 0.1] for k in range(3)], [[k, 2.0, 0.2] for k in range(3)]]
    np.testing.assert_array_equal(discs_of(scene, numbers), expected)


def test_a_scene_without_obstacles_and_other_obstacles_are_refused():
    scene = rde.load_scene("four_r_reach")
    with pytest.raises(ValueError, match="no obstacle; add KeepOut"):
        discs_of(scene, {})
    wall = rde.effects.HalfPlane((0.0, -2.0))
    with pytest.raises(ValueError, match=r"HalfPlane.* discs alone"):
        discs_of(dataclasses.replace(scene, effects=(*scene.effects, wall)), {})
