"""Arms, effects, a task, an integrator and an observation from outside the package work like its own."""

import dataclasses
import json
import pickle
import re
import subprocess
import sys
from pathlib import Path

import actuator_lag  # noqa: F401 - registers its effect
import elbow
import gymnasium as gym
import heun
import numpy as np
import pytest
import rrp
import three_r
import track
from arms import e
from gymnasium.utils.env_checker import check_env
from three_r_by_hand import ThreeRByHand

import redundant_envs as rde
from redundant_envs.algebra import gives_of, physics
from redundant_envs.envs.named import task_table
from redundant_envs.verify import equations, kinematics, verify
from redundant_envs.verify.checks import checks_of

FOLDER = Path(__file__).parent


class Cart(rde.Arm):
    """A pendulum of two links on a cart, from the types of its joints alone."""

    joint_types = "PRR"


CART = {
    "robot": {"type": "Cart", "masses": [1.0, 0.5, 0.5], "lengths": [0.4, 0.3]},
    "effects": [
        {"type": "Gravity"},
        {"type": "EffortLimits", "limits": [40.0, 10.0, 4.0]},
        {"type": "PrismaticStop", "lower": [-0.3], "upper": [0.3], "restitution": 0.5},
    ],
    "tolerance": 1e-6,
}
rde.register_arm(Cart, CART)
IDS = [
    f"redundant_envs/{name}-v0"
    for name in ("ThreeRReach", "RRPReach", "RRPTrack", "FourRTrack", "ThreeRElbowReach", "CartReach")
]


# ---- equations -----------------------------------------------------------------------------------------


def test_the_arm_from_points_is_the_one_by_hand():
    arms = [kind((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)) for kind in (three_r.ThreeR, ThreeRByHand)]
    q, qd, Q = np.random.default_rng(0).uniform(-3.0, 3.0, (3, 100, 3))
    known = {"mass_matrix": (q,), "bias_forces": (q, qd), "gravity_forces": (q,), "jacobian_dot_qd": (q, qd)}
    for name, arguments in known.items():
        found, expected = (getattr(arm, name)(*arguments) for arm in arms)
        assert np.abs(found - expected).max() <= 2e-15 * np.abs(expected).max()
    accelerations = [a.forward_dynamics(q, qd, Q) for a in arms]
    assert np.abs(np.subtract(*accelerations)).max() <= 1e-13 * np.abs(accelerations[0]).max()
    assert {*arms[0].symbols()} >= {"M", "h", "G", "J", "T", "U"}


@pytest.mark.parametrize("base", [(three_r.points,), three_r.ThreeR.functions], ids=["points", "all"])
def test_a_mass_matrix_by_hand_replaces_the_derived_one_and_is_compared_with_it(base):
    def misses(factor):
        @physics(gives="M11 M12 M13 M21 M22 M23 M31 M32 M33")
        def matrix(m1, m2, m3, l1, l2, l3, s1, c1, s2, c2, s3, c3):
            m23 = m2 + m3
            M12 = m23 * l1 * l2 * (c1 * c2 + s1 * s2)
            M13 = factor * m3 * l1 * l3 * (c1 * c3 + s1 * s3)
            M23 = m3 * l2 * l3 * (c2 * c3 + s2 * s3)
            return (m1 + m23) * l1 * l1, M12, M13, M12, m23 * l2 * l2, M23, M13, M23, m3 * l3 * l3

        kind = type("Mixed", (three_r.ThreeR,), {"functions": (*base, matrix)})
        assert [f.__name__ for f in kind.functions if "M11" in gives_of(f)] == ["matrix"]
        scene = rde.Scene(kind((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)), (e.Gravity(),))
        return verify(scene, 24, checks=checks_of(equations, kinematics)).misses

    assert misses(1.0) == ()
    assert any(miss.startswith("mass matrix: ") for miss in misses(1.0 + 1e-6))


# ---- environments --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "env_id", [pytest.param(x, marks=[] if x in IDS[2::3] else [pytest.mark.long]) for x in IDS]
)
def test_single_vector_and_sb3_environments_are_sound_and_have_the_same_bits(env_id):
    single, vector = gym.make(env_id), gym.make_vec(env_id, num_envs=11)
    sb3 = rde.make_sb3(env_id, 11)
    check_env(single.unwrapped, skip_render_check=True)
    rde.check_vec_env(gym.make_vec(env_id, num_envs=3))
    rde.check_vec_env(rde.make_sb3(env_id, 3))
    obs, _ = vector.reset(seed=4)
    sb3.seed(4)
    assert np.array_equal(obs, sb3.reset())
    assert np.array_equal(obs[2], single.reset(seed=6)[0])
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-1.0, 1.0, vector.action_space.shape).astype(np.float32)
        obs, reward, *_, info = vector.step(actions)
        same, same_reward, *_ = sb3.step(actions)
        one, one_reward, *_, one_info = single.step(actions[2])
        assert np.array_equal(obs, same)
        assert np.array_equal(reward.astype(np.float32), same_reward)
        assert np.array_equal(obs[2], one)
        assert reward[2] == one_reward
        assert info["distance"][2] == one_info["distance"]
    assert len(single.unwrapped.core.task.observation(single.unwrapped.core.scene)) == len(obs[0])


@pytest.mark.parametrize("env_id", IDS[1:3])
def test_environments_copy_render_and_tell_of_themselves(env_id):
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    picture = env.render()
    assert picture.shape == (480, 480, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    json.dumps(dataclasses.asdict(env.spec)["kwargs"])
    assert "effort at r / 16 N" in type(env.unwrapped).__doc__
    twin = pickle.loads(pickle.dumps(env.unwrapped))
    action = np.full(3, 0.3, np.float32)
    assert np.array_equal(env.unwrapped.step(action)[0], twin.step(action)[0])


def test_a_target_moves_before_it_is_measured_and_observed():
    env = gym.make("redundant_envs/RPRPTrack-v0", task={"period": 2.0}).unwrapped
    env.reset(seed=0, options={"goal": (0.6, 0.0)})
    for k in range(1, 6):
        _, _, _, _, info = env.step(np.zeros(4, np.float32))
        angle = 2.0 * np.pi * 0.02 * k / 2.0
        assert np.allclose(env.goal, 0.6 * np.array([np.cos(angle), np.sin(angle)]), atol=1e-14)
        assert info["distance"] == pytest.approx(np.linalg.norm(env.goal - env.tip), abs=1e-14)


def test_a_target_stays_while_a_fault_holds_its_lane():
    env = gym.make("redundant_envs/RPRPTrack-v0", on_bad_action="terminate").unwrapped
    env.reset(seed=0)
    goal = env.goal
    _, _, terminated, *_ = env.step(np.full(4, np.nan, np.float32))
    assert terminated
    assert np.array_equal(env.goal, goal)


def test_effects_with_states_begin_anew_with_each_episode():
    scene = {**three_r.SCENE}
    scene["effects"] = [*scene["effects"], {"type": "ActuatorLag", "time_constant": 0.1}]
    env = gym.make_vec("redundant_envs/ThreeRReach-v0", num_envs=9, scene=scene, max_episode_steps=5)
    env.reset(seed=0)
    memory, action = env.unwrapped.core.memory, np.ones((9, 3), np.float32)
    names = tuple(env.unwrapped.core.simulator.dynamics.effect_states)
    for _ in range(5):
        env.step(action)
        assert memory.read(names).min() > 0.1
    env.step(action)
    assert not memory.read(names).any()
    restored = env.unwrapped.get_state()
    first = env.step(action)[0]
    env.unwrapped.set_state(restored)
    assert np.array_equal(env.step(action)[0], first)


def test_one_more_observation_has_its_value():
    env = gym.make("redundant_envs/FourRElbowReach-v0").unwrapped
    obs, _ = env.reset(seed=3)
    height, reach = env.core.scene.robot.points(env.q)[1, 1], env.core.reach
    assert obs[-1] == np.float32(height / np.sqrt(reach**2 + height**2))
    assert len(obs) % 2 == 1
    assert elbow.ElbowReachTask.name == "ElbowReach"


# ---- the table of a task's numbers on the page of an environment ---------------------------------------


def rows_of(text):
    cells = [[c.strip() for c in line[1:-1].split("|")] for line in text.splitlines()[2:]]
    return {name.strip("`"): rest for name, *rest in cells}


@pytest.mark.parametrize("kind", [rde.ReachTask, rde.tasks.GoalReachTask])
def test_every_number_of_a_task_has_a_default_a_unit_a_range_and_a_sentence(kind):
    rows = rows_of(task_table(kind()))
    assert list(rows) == [f.name for f in dataclasses.fields(kind)]
    assert set(kind.units) == set(rows)
    for name, (default, unit, allowed, meaning) in rows.items():
        assert float(default) == getattr(kind(), name)
        assert unit == kind.units[name]
        assert re.fullmatch(r"positive|\S+ to \S+|above \S+, at most \S+", allowed)
        assert meaning.endswith(".")
        assert len(meaning.split()) > 3
    assert rows["hold_speed"][1:3] == ["reaches/s", "1e-09 to 1e+09"]
    assert rows["start_angle"][1:3] == ["rad", "above 0, at most 1e+06"]


def test_the_page_of_an_id_and_tasks_from_outside_have_such_a_table():
    for env_id in ("redundant_envs/RPRPReach-v0", "redundant_envs/FourRGoalReach-v0"):
        page = type(gym.make(env_id).unwrapped).__doc__
        assert "| `goal_tolerance` | 0.02 | reaches | 1e-09 to 2 | Largest distance from the goal" in page
    assert rows_of(task_table(track.TrackTask()))["period"] == ["8.0", "s", "positive", "Time of a turn."]
    kind = dataclasses.make_dataclass("Odd", [("odd", float, 3.0)], bases=(rde.ReachTask,), frozen=True)
    assert rows_of(task_table(kind()))["odd"] == ["3.0", "", "positive", ""]


# ---- registration --------------------------------------------------------------------------------------


def test_registering_again_does_nothing_and_other_methods_of_the_name_are_refused():
    rde.register_arm(three_r.ThreeR, three_r.SCENE)
    rde.register_task(track.TrackTask)
    rde.register_integrator(heun.HEUN)
    for change, said in (
        ({"name": "rk4"}, "'rk4' is taken"), ({"name": "wrong", "b": (0.5, 0.6)}, "weights of the tableau"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            rde.register_integrator(dataclasses.replace(heun.HEUN, **change))


def test_scenes_of_an_arm_from_outside_are_plain_data():
    scene = rde.load_scene(rrp.SCENE)
    assert rde.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    with pytest.raises(ValueError, match="RRP"):
        gym.make("redundant_envs/ThreeRReach-v0", scene=rrp.SCENE)


def test_spawned_processes_import_the_module_of_an_environment():
    spec = gym.spec("redundant_envs/ThreeRTrack-v0")
    assert spec.entry_point == "redundant_envs.envs.named:three_r/track/ThreeRTrackEnv"
    assert gym.spec("redundant_envs/FourRReach-v0").entry_point == "redundant_envs.envs.named:FourRReachEnv"
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import gymnasium as gym;"
        "from gymnasium.envs.registration import EnvSpec;"
        "env = gym.make(EnvSpec.from_json(sys.argv[2])); print(env.reset(seed=0)[0].shape)"
    )
    command = [sys.executable, "-c", program, str(FOLDER), spec.to_json()]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout.startswith("(")


def test_without_its_module_an_environment_from_outside_says_what_is_missing():
    code = (
        "import redundant_envs, gymnasium as gym\n"
        "try: gym.make('redundant_envs/ThreeRReach-v0')\n"
        "except gym.error.Error as error: print(type(error).__name__)\n"
        "from redundant_envs.scene import load_scene\n"
        "try: load_scene({'robot': {'type': 'ThreeR'}})\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "robot.type is 'ThreeR'; valid: Chain, FourR, RPRP" in done.stdout
    make = "import gymnasium; gymnasium.make('three_r:redundant_envs/ThreeRReach-v0').reset()"
    command = [sys.executable, "-c", make]
    told = subprocess.run(command, capture_output=True, text=True, cwd=FOLDER, check=False)
    assert told.returncode == 0, told.stderr
