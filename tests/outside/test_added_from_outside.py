"""Arms, effects, a task, an integrator and an observation from outside the package work like its own."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import circle
import elbow  # noqa: F401 - registers its task
import gymnasium as gym
import heun
import numpy as np
import pytest
import rrp
import three_r
from gymnasium.utils.env_checker import check_env

import redundant_envs as rde
from redundant_envs.verify import environments, verify
from redundant_envs.verify.checks import checks_of
from redundant_envs.verify.subjects import subject_of


@pytest.mark.long
@pytest.mark.parametrize("name", ["RRPCircle-v0", "ThreeRElbowReach-v0"])
def test_environments_of_all_kinds_are_sound_and_have_the_same_bits(name):
    assert verify(subject_of(name), 64, checks=checks_of(environments)).misses == ()
    check_env(gym.make(f"redundant_envs/{name}").unwrapped, skip_render_check=True)
    vector, sb3 = gym.make_vec(f"redundant_envs/{name}", num_envs=3), rde.make_sb3(name, 3)
    rde.check_vec_env(sb3)
    sb3.seed(4)
    np.testing.assert_array_equal(vector.reset(seed=4)[0], sb3.reset())
    for _ in range(20):
        actions = vector.action_space.sample()
        np.testing.assert_array_equal(vector.step(actions)[0], sb3.step(actions)[0])


def test_a_target_moves_before_it_is_measured_and_observed_and_stays_while_a_fault_holds_its_lane():
    env = gym.make("redundant_envs/RRPCircle-v0", task={"period": 2.0}, on_bad_action="terminate").unwrapped
    env.reset(seed=0, options={"goal": (0.6, 0.0)})
    for k in range(1, 6):
        _, _, _, _, info = env.step(np.zeros(3, np.float32))
        angle = 2.0 * np.pi * 0.02 * k / 2.0
        assert np.allclose(env.goal, 0.6 * np.array([np.cos(angle), np.sin(angle)]), atol=1e-14)
        assert info["distance"] == pytest.approx(np.linalg.norm(env.goal - env.tip), abs=1e-14)
    goal = env.goal
    assert env.step(np.full(3, np.nan, np.float32))[2]
    assert np.array_equal(env.goal, goal)


def test_one_more_observation_has_its_value():
    env = gym.make("redundant_envs/ThreeRElbowReach-v0").unwrapped
    obs, _ = env.reset(seed=3)
    height, reach = env.core.scene.robot.points(env.q)[1, 1], env.core.reach
    assert obs[-1] == np.float32(height / np.sqrt(reach**2 + height**2))


def test_the_page_of_an_id_tells_of_the_arm_and_of_the_numbers_of_the_task():
    page = type(gym.make("redundant_envs/RRPCircle-v0").unwrapped).__doc__
    assert "effort at r / 16 N" in page
    assert "| `goal_tolerance` | 0.02 | reaches | 1e-09 to 2 | Largest distance from the goal" in page
    assert "| `period` | 8.0 | s | positive | Time of a turn. |" in page


def test_registering_again_does_nothing_and_other_methods_of_the_name_are_refused():
    rde.register_arm(three_r.ThreeR, three_r.SCENE)
    rde.register_task(circle.CircleTask)
    rde.register_integrator(heun.HEUN)
    lists = dataclasses.replace(heun.HEUN, a=[[], [1]], b=np.array([0.5, 0.5]), c=[0, 1])
    assert (lists, hash(lists)) == (heun.HEUN, hash(heun.HEUN))
    for change, said in (
        ({"name": "rk4"}, "'rk4' is taken"), ({"name": "wrong", "b": (0.5, 0.6)}, "weights of the tableau"),
        ({"b": "no"}, "Tableau.b is 'no'"), ({"a": [[], [None]]}, r"Tableau.a\[1\]\[0\] is None"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            rde.register_integrator(dataclasses.replace(heun.HEUN, **change))


class AmongTask(rde.ReachTask):
    """Reach beside an obstacle, in short episodes."""

    name = "ReachAmong"
    steps = 7
    metrics = (*rde.ReachTask.metrics, "clearance1")


def test_a_pair_of_arm_and_task_has_a_scene_of_its_own_and_a_task_the_length_of_its_episodes():
    discs, arm_among = {**three_r.SCENE}, "redundant_envs/ThreeRReachAmong-v0"
    discs["effects"] = [*discs["effects"], {"type": "KeepOut", "centre": [0.6, 0.5], "radius": 0.1}]
    rde.register_task(AmongTask, {"FourR": "four_r_around"})
    rde.register_arm(three_r.ThreeR, three_r.SCENE, {"ReachAmong": discs})
    envs = gym.make_vec("redundant_envs/FourRReachAmong-v0", 2)
    assert envs.unwrapped.scene == rde.load_scene("four_r_around")
    assert gym.make(arm_among).unwrapped.scene == rde.load_scene(discs)
    with pytest.raises(ValueError, match="clearance1"):  # its reach scene has no obstacle
        gym.make("redundant_envs/RPRPReachAmong-v0")
    page = type(gym.make(arm_among).unwrapped).__doc__
    assert "Truncation: after 7 steps" in page
    assert "KeepOut" in page
    for made, steps in ((envs, 7), (gym.make_vec(arm_among, 2, max_episode_steps=3), 3)):
        made.reset(seed=0)
        ends = [made.step(0.0 * made.action_space.sample())[3].all() for _ in range(steps)]
        assert ends == [False] * (steps - 1) + [True]
    rde.register_task(AmongTask)
    assert gym.spec("redundant_envs/FourRReachAmong-v0").kwargs["scene"] == "four_r_reach"
    assert gym.spec(arm_among).kwargs["scene"] == discs
    rde.register_arm(three_r.ThreeR, three_r.SCENE)
    assert gym.spec(arm_among).kwargs["scene"] == three_r.SCENE


def test_scenes_of_an_arm_from_outside_are_plain_data():
    scene = rde.load_scene(rrp.SCENE)
    assert rde.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    with pytest.raises(ValueError, match="RRP"):
        gym.make("redundant_envs/ThreeRReach-v0", scene=rrp.SCENE)


@pytest.mark.long
def test_spawned_processes_import_the_module_of_an_environment():
    program = (
        "import sys, gymnasium as gym; from gymnasium.envs.registration import EnvSpec;"
        "env = gym.make(EnvSpec.from_json(sys.argv[1])); print(env.reset(seed=0)[0].shape)"
    )
    spec = gym.spec("redundant_envs/ThreeRCircle-v0").to_json()
    command, folder = [sys.executable, "-c", program, spec], Path(__file__).parent
    assert subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout[0] == "("
