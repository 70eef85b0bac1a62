"""accuracy: one keyword instead of integrator, substeps and tolerance."""

import gymnasium as gym
import numpy as np
import pytest
from small_scenes import OWN_IDS

import redundant_envs as rde

ENVIRONMENT = "redundant_envs/FourRReach-v0"


def drive(env, steps=20):
    env.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        *_, info = env.step(rng.uniform(-1, 1, 4).astype(np.float32))
    return env.unwrapped.core.memory.read(env.unwrapped.core.scene.robot.coordinates), info


@pytest.mark.parametrize("env_id", OWN_IDS)
def test_every_environment_is_simulated_to_a_micrometre(env_id):
    assert gym.make(env_id).unwrapped.core.scene.tolerance == 1e-6


def test_accuracy_chooses_the_tolerance():
    states, evaluations = [], []
    for accuracy, tolerance in (("standard", 1e-6), ("exact", 1e-12), (1e-9, 1e-9)):
        env = gym.make(ENVIRONMENT, accuracy=accuracy)
        assert env.unwrapped.core.scene.tolerance == tolerance
        q, info = drive(env)
        states.append(q)
        evaluations.append(info["evaluations"])
        assert 0.0 < info["error_estimate"] <= tolerance
    standard, exact, between = states
    assert 0.0 < np.abs(standard - exact).max() < 1e-3
    assert np.abs(between - exact).max() < np.abs(standard - exact).max()
    assert 12 * 20 <= evaluations[0] < evaluations[2] < evaluations[1]


def test_all_faces_take_it():
    assert gym.make_vec(ENVIRONMENT, num_envs=3, accuracy="exact").unwrapped.core.scene.tolerance == 1e-12
    assert rde.make_sb3("FourRReach-v0", num_envs=3, accuracy=1e-8).core.scene.tolerance == 1e-8


def test_a_scene_that_says_nothing_is_standard_and_one_that_does_is_kept():
    data = rde.load_scene("four_r_reach").to_dict()
    bare = {k: v for k, v in data.items() if k not in ("integrator", "substeps", "tolerance")}
    assert gym.make(ENVIRONMENT, scene=bare).unwrapped.core.scene.tolerance == 1e-6
    assert gym.make(ENVIRONMENT, scene=bare, accuracy="exact").unwrapped.core.scene.tolerance == 1e-12
    fixed = gym.make(ENVIRONMENT, scene={**bare, "integrator": "rk4", "substeps": 2})
    assert fixed.unwrapped.core.scene.integrator == "rk4"
    _, info = drive(fixed)
    assert "error_estimate" not in info


@pytest.mark.parametrize(
    ("accuracy", "scene", "words"),
    [
        ("fine", None, ("accuracy", "'fine'", "standard", "exact", "metres")),
        (0.0, None, ("tolerance", "0.0", "1e-13")),
        (True, None, ("accuracy", "True")),
        ("exact", {"integrator": "rk4"}, ("accuracy", "'exact'", "integrator", "one or the other")),
        ("exact", {"tolerance": 1e-6}, ("accuracy", "tolerance")),
    ],
)
def test_what_accuracy_cannot_be(accuracy, scene, words):
    arguments = {"accuracy": accuracy}
    if scene is not None:
        data = rde.load_scene("four_r_reach").to_dict()
        bare = {k: v for k, v in data.items() if k not in ("integrator", "substeps", "tolerance")}
        arguments["scene"] = {**bare, **scene}
    with pytest.raises(ValueError, match=r"accuracy|tolerance") as error:
        gym.make(ENVIRONMENT, **arguments)
    assert all(w in str(error.value) for w in words)


def test_a_lane_beyond_the_tolerance_is_flagged_and_goes_on():
    data = rde.load_scene("four_r_reach").to_dict()
    data["effects"].append(
        {"type": "LimitSpring", "coordinate": "joint2", "lower": -3.0, "upper": 3.0, "stiffness": 1e12}
    )
    env = gym.make(ENVIRONMENT, scene=data)
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(np.zeros(4, np.float32))
    assert info["numerics"] == rde.Numerics.TOLERANCE_NOT_REACHED
    assert not terminated
    assert not truncated
