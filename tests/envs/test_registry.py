"""Properties of every registered id."""

import json
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from small_scenes import OWN_IDS
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import redundant_envs as rde

MODES = ("next_step", "same_step", "disabled")


def scene_of(env_id, other=False):
    """Name of the scene of an id's arm, or of the other arm."""
    return "rprp_reach" if ("RPRP" in env_id) != other else "four_r_reach"


every_id = pytest.mark.parametrize("env_id", OWN_IDS)


def test_the_ids_are_those_promised():
    code = "import redundant_envs; from redundant_envs.envs.registration import ids; print(*ids())"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    names = {"RPRPReach-v0", "FourRReach-v0", "RPRPGoalReach-v0", "FourRGoalReach-v0"}
    assert set(told.split()) == {f"redundant_envs/{n}" for n in names}


@every_id
def test_gymnasium_checker_passes_without_a_warning(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(env_id, render_mode="rgb_array")
        check_env(env.unwrapped)


@every_id
def test_sb3_checker_passes_without_a_warning(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_check_env(gym.make(env_id).unwrapped)


@every_id
@pytest.mark.parametrize("mode", MODES)
def test_own_checker_passes_on_the_vector_environment(env_id, mode):
    rde.check_vec_env(gym.make_vec(env_id, num_envs=5, autoreset_mode=mode))


@every_id
def test_own_checker_passes_on_the_sb3_environment(env_id):
    rde.check_vec_env(rde.make_sb3(env_id, 5))


@every_id
def test_make_vec_does_not_warn_and_declares_its_mode(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make_vec(env_id, num_envs=3)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert (
        gym.make_vec(env_id, num_envs=3, autoreset_mode=AutoresetMode.SAME_STEP).metadata["autoreset_mode"]
        is AutoresetMode.SAME_STEP
    )


@every_id
def test_spec_is_json(env_id):
    env = gym.make(env_id, scene=rde.load_scene(scene_of(env_id)).to_dict())
    spec = EnvSpec.from_json(env.spec.to_json())
    assert json.loads(env.spec.to_json())["id"] == env_id
    assert spec.make().observation_space == env.observation_space


@every_id
@pytest.mark.parametrize("as_data", [False, True])
def test_an_id_refuses_a_scene_of_another_arm_on_every_face(env_id, as_data):
    name = scene_of(env_id, other=True)
    scene = rde.load_scene(name).to_dict() if as_data else name
    arm, fitting = ("FourR", env_id.replace("RPRP", "FourR"))
    if "FourR" in env_id:
        arm, fitting = ("RPRP", env_id.replace("FourR", "RPRP"))
    for make in (
        lambda: gym.make(env_id, scene=scene),
        lambda: gym.make_vec(env_id, num_envs=2, scene=scene),
        lambda: gym.make_vec(env_id, num_envs=2, scene=scene, vectorization_mode="sync"),
        lambda: rde.make_sb3(env_id, 2, scene=scene),
        lambda: rde.make_sb3(env_id.split("/")[1], 2, scene=scene),
    ):
        with pytest.raises(ValueError, match=f"scene has the arm {arm}; {env_id} .* {fitting} ") as error:
            make()
        assert "\n" not in str(error.value)


@every_id
def test_rgb_array_is_a_picture_that_moves(env_id):
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(5):
        env.step(np.full(4, 0.5, np.float32))
    second = env.render()
    assert first.dtype == np.uint8
    assert first.shape == (480, 480, 3)
    assert (first != second).any()
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 20


def test_importing_the_package_imports_nothing_heavy():
    code = (
        "import sys, redundant_envs; heavy = ['torch', 'matplotlib', 'pygame', 'sympy', 'scipy', "
        "'stable_baselines3', 'llvmlite']; found = [m for m in heavy if m in sys.modules]; "
        "sys.exit(str(found) if found else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_making_an_rgb_environment_imports_no_window_library():
    code = (
        "import sys, gymnasium, redundant_envs; "
        "e = gymnasium.make('redundant_envs/RPRPReach-v0', render_mode='rgb_array'); e.reset(); e.render(); "
        "sys.exit('pygame' in sys.modules or 'matplotlib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
