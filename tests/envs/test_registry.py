"""Every registered id: checkers, spec, page, and the values that users may read in every kind."""

import enum
import subprocess
import sys
import warnings
from collections import deque
from decimal import Decimal
from fractions import Fraction

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, KINDS, RANGES, actions, begin, drawing, made, running
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import redundant_envs as rde
from redundant_envs.envs import registration
from redundant_envs.scenes import config_folder
from redundant_envs.tasks import REGISTRY as TASKS

VALUES = ("q", "qd", "tip", "goal")


@pytest.mark.quick("redundant_envs/RPRPReach-v0")
def test_checkers_pass_without_a_warning(env_id):
    """Those of vectors are a promise of ``verify``, which test_properties.py holds every id to."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, render_mode="rgb_array").unwrapped)
        sb3_check_env(gym.make(env_id).unwrapped)
        rde.check_vec_env(made("sb3", env_id, 5))


Name = enum.StrEnum("Name", {"SCENE": "four_r_weak", "DISTANCE": "distance"})
Steps = enum.IntEnum("Steps", {"FEW": 3, "WIDE": 64})
FREE = drawing()
AS_USERS_WRITE = {
    "a path": {"scene": config_folder("scenes") / "four_r_reach.yaml"},
    "a scene": {"scene": rde.load_scene("four_r_weak")},
    "arrays in a scene": {
        "scene": FREE
        | {"robot": {k: np.array(v) if k != "type" else v for k, v in FREE["robot"].items()}}
        | {"randomize": {**RANGES, np.str_("gravity.g"): {"uniform": np.array([9.0, 10.0])}}}
    },
    "numbers of NumPy": {
        "task": {"goal_tolerance": np.float32(0.5), "hold_steps": np.int64(3)},
        "accuracy": np.float64(1e-5),
    },
    "exact numbers": {"task": {"goal_tolerance": Decimal("0.03"), "hold_speed": Fraction(1, 5)}},
    "members of enumerations": {
        "scene": Name.SCENE,
        "task": {"hold_steps": Steps.FEW},
        "render_width": Steps.WIDE,
        "info_keys": [Name.DISTANCE],
    },
    "names": {"observe_parameters": deque(["gravity.g"]), "info_keys": ["distance"]},
    "an array of names": {"observe_parameters": np.array(["gravity.g", "masses"])},
}


@pytest.mark.quick(*(f"{given}-single" for given in AS_USERS_WRITE))
@pytest.mark.parametrize("kind", ["single", "same_step"])
@pytest.mark.parametrize("given", AS_USERS_WRITE.values(), ids=AS_USERS_WRITE)
def test_specs_hold_plain_data_of_what_users_give(kind, given):
    env = made(kind, FOUR_R, 2, **given)
    spec = EnvSpec.from_json(env.spec.to_json())
    again = gym.make_vec(spec) if kind == "same_step" else spec.make().unwrapped
    assert kind != "same_step" or again.spec.to_json() == env.spec.to_json()
    for of_core in ("scene", "task", "simulated", "observed"):
        assert getattr(again.core, of_core) == getattr(env.core, of_core)


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_an_id_without_a_limit_has_none(mode):
    home, name = "redundant_envs.envs.named", "tests/Endless-v0"
    points = {"entry_point": f"{home}:FourRReachEnv", "vector_entry_point": f"{home}:FourRReachVectorEnv"}
    gym.register(name, **points, kwargs={"scene": "four_r_reach"})
    try:
        env = gym.make_vec(name, num_envs=2, vectorization_mode=mode)
        env.reset(seed=0)
        assert not any(env.step(np.zeros((2, 4), np.float32))[3].any() for _ in range(120))
    finally:
        del gym.registry[name]


def test_an_episode_is_truncated_at_its_limit_exactly():
    """Its count set to two steps before: float64 counts exactly that far."""
    env = made("next_step", FOUR_R, 2, max_episode_steps=2**53)
    env.reset(seed=0)
    env.core.memory.write(("steps",), float(2**53 - 2))
    truncated = [env.step(np.zeros((2, 4), np.float32))[3].tolist() for _ in range(2)]
    assert truncated == [[False, False], [True, True]]


@pytest.mark.long
def test_importing_and_drawing_import_nothing_heavy():
    made = "e = gymnasium.make('redundant_envs/RPRPReach-v0', render_mode='rgb_array'); e.reset(); e.render()"
    code = f"import sys, gymnasium, redundant_envs\nprint(*sys.modules)\n{made}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported, drawn = ({*line.split()} for line in done.stdout.splitlines())
    assert not {"torch", "sympy", "scipy", "stable_baselines3", "llvmlite"} & imported
    assert not {"pygame", "matplotlib"} & drawn


def test_values_are_those_of_the_simulation_in_every_kind(env_id):
    envs = {kind: made(kind, env_id) for kind in KINDS}
    table = actions(envs["sb3"], 7)
    for kind, env in envs.items():
        begin(env, seed=6 if kind == "single" else 5)
        for action in table:
            env.step(action[1] if kind == "single" else action)
    for name in VALUES:
        values = getattr(envs["disabled"], name)
        width = 2 if name in ("tip", "goal") else len(envs["single"].scene.robot.joints)
        assert (values.shape, values.dtype) == ((3, width), np.float64)
        for kind, env in envs.items():
            np.testing.assert_array_equal(getattr(env, name), values[1] if kind == "single" else values)
    arm, env = envs["single"].scene.robot, envs["disabled"]
    np.testing.assert_allclose(env.tip, arm.forward_kinematics(env.q), atol=1e-15)


def test_values_are_copies_and_the_tip_follows_a_lanes_own_lengths(kind):
    env = running(kind, FOUR_R, 3)
    lengths = np.array([[0.25] * 4, [0.1] * 4, [0.2] * 4])
    begin(env, {"q": (0.0,) * 4, "parameters": {"lengths": lengths[0] if kind == "single" else lengths}})
    tips = [[1.0, 0.0], [0.4, 0.0], [0.8, 0.0]]
    np.testing.assert_allclose(env.tip, tips[0] if kind == "single" else tips, atol=1e-15)
    for name in VALUES:
        kept = getattr(env, name)
        with pytest.raises(ValueError, match="set_options"):
            kept[...] = 7.0
        with pytest.raises(AttributeError, match="cannot be set"):
            setattr(env, name, kept)
        (kept + 0.0)[...] = 7.0  # a result is its owner's


def test_every_id_has_the_length_and_the_scene_of_its_arm_and_task(env_id):
    spec, (arm, task) = gym.spec(env_id), registration.IDS[env_id]
    assert spec.max_episode_steps == TASKS[task].steps
    assert spec.kwargs["scene"] == registration.scene_of(arm, task)
    assert rde.load_scene(spec.kwargs["scene"]).robot.kind == arm


def test_the_longest_name_that_ends_as_that_of_the_task_is_the_scene_of_an_arm(tmp_path, monkeypatch):
    for file in ("a_reach", "a_around", "a_track_around", "a_light", "b_reach", "b_reach_around"):
        (tmp_path / f"{file}.yaml").touch()
    monkeypatch.setattr(registration, "config_folder", lambda kind: tmp_path)
    monkeypatch.setattr(registration, "SCENES", {"A": "a_reach", "B": "b_reach"})
    monkeypatch.setattr(registration, "TASKS", ["Reach", "ReachAround", "TrackAround", "ReachLight"])
    assert registration._scenes_of_tasks() == {
        ("the task", "ReachAround"): {"A": "a_around", "B": "b_reach_around"},
        ("the task", "TrackAround"): {"A": "a_track_around"},
        ("the task", "ReachLight"): {"A": "a_light"},
    }


def page(env_id):
    return type(gym.make(env_id).unwrapped).__doc__


def section(text, heading):
    return text.split(f"## {heading}\n")[1].split("\n## ")[0]


def rows(text):
    lines = [line for line in text.splitlines() if line[:1] == "|"][2:]
    return [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in lines]


def test_pages_agree_with_the_code(env_id):
    env, text = made("single", env_id, info_keys="all"), page(env_id)
    observed = env.observation_space["observation"] if "Goal" in env_id else env.observation_space
    assert len(rows(section(text, "Observation Space"))) == observed.shape[0]
    limits = next(e for e in env.scene.effects if isinstance(e, rde.effects.EffortLimits)).limits
    assert all(f"/ {limit:g} N" in section(text, "Action Space") for limit in limits)
    for name in env.core.task.parameters():
        assert f"| `{name}` | {getattr(env.core.task, name)} |" in text
    assert " ".join(row[0] for row in rows(section(text, "Arguments"))) == (
        "scene accuracy render_mode on_bad_action task terminate_on_touch randomize "
        "observe_parameters info_keys action decide_every render_width render_height"
    )
    terms = [k.removeprefix("return_") for k in env.reset(seed=0)[1] if k.startswith("return_")]
    assert [row[0] for row in rows(section(text, "Rewards"))] == terms
    for heading in ("Starting State", "Episode End", "Version History"):
        assert section(text, heading)


def test_the_page_explains_every_key_of_info_and_no_other(env_id):
    found = set()
    for kind in KINDS:
        env = made(kind, env_id, max_episode_steps=4, info_keys="all")
        begin(env, seed=0)
        told = [env.step(action)[-1] for action in actions(env, 5 - (kind in ("single", "disabled")))]
        found |= {key for info in np.ravel(told) for key in info}
    found = {key.removeprefix("_") for key in found}
    sums = {f"return_{row[0]}" for row in rows(section(page(env_id), "Rewards"))}
    known = {key for key, *_ in rows(section(page(env_id), "Info"))} - {"return_*"}
    assert sums <= found <= known | sums
    scene = gym.make(env_id).unwrapped.scene
    only_elsewhere = {"parameters": not scene.randomize, "events": not scene.robot.sliders()}
    assert known - found == {"beyond_limit", *(key for key, absent in only_elsewhere.items() if absent)}


def test_an_id_may_have_the_module_that_registers_it():
    whole = f"redundant_envs:{FOUR_R}"
    vector = gym.make_vec(whole, num_envs=2)
    assert gym.make(whole).spec.id == vector.spec.id == FOUR_R
    assert rde.make_sb3(whole, 2).core.scene == vector.core.scene
    for env in (gym.make(FOUR_R).unwrapped, vector):  # skrl looks at these names
        assert any(base.__module__.startswith("gymnasium.") for base in type(env).__bases__)
