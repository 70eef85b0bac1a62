"""Outputs of every kind of environment: coordinates, tips and goals, info keys that the page explains,
specs."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from small_scenes import OWN_IDS

import redundant_envs as rde

every_id = pytest.mark.parametrize("env_id", OWN_IDS)
NAMES = ("q", "qd", "tip", "goal")


def faces(env_id, n=3, **kwargs):
    """A vector environment and an SB3 environment with the same episodes, after a few steps."""
    vector, sb3 = gym.make_vec(env_id, num_envs=n, **kwargs), rde.make_sb3(env_id, n, **kwargs)
    vector.reset(seed=5)
    sb3.seed(5)
    sb3.reset()
    for action in np.random.default_rng(0).uniform(-1, 1, (7, n, 4)).astype(np.float32):
        vector.step(action)
        sb3.step(action)
    return vector, sb3


@every_id
def test_q_qd_tip_and_goal_are_those_of_the_simulation_on_every_face(env_id):
    vector, sb3 = faces(env_id)
    single = gym.make(env_id)
    single.reset(seed=6)
    for action in np.random.default_rng(0).uniform(-1, 1, (7, 3, 4)).astype(np.float32)[:, 1]:
        single.step(action)
    for name, width in zip(NAMES, (4, 4, 2, 2), strict=True):
        values = getattr(vector.unwrapped, name)
        assert values.shape == (3, width)
        assert values.dtype == np.float64
        np.testing.assert_array_equal(getattr(sb3, name), values)
        own = getattr(single.unwrapped, name)
        assert own.shape == (width,)
        np.testing.assert_array_equal(own, values[1])
    robot = single.unwrapped.core.scene.robot
    np.testing.assert_allclose(vector.unwrapped.tip, robot.forward_kinematics(vector.unwrapped.q), atol=1e-15)
    assert (vector.unwrapped.qd != 0.0).all()


@every_id
def test_q_qd_tip_and_goal_are_copies_and_change_nothing(env_id):
    vector, sb3 = faces(env_id)
    single = gym.make(env_id).unwrapped
    single.reset(seed=0)
    for env in (vector.unwrapped, sb3, single):
        before = env.core.memory.save()
        for name in NAMES:
            kept = getattr(env, name)
            kept[...] = 7.0
            assert (getattr(env, name) != 7.0).all()
        np.testing.assert_equal(env.core.memory.save(), before)


@pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" in i])
def test_tip_and_goal_are_the_goals_of_a_goal_environment(env_id):
    env = gym.make(env_id)
    obs, _ = env.reset(seed=1)
    for _ in range(3):
        np.testing.assert_array_equal(env.unwrapped.tip, obs["achieved_goal"])
        np.testing.assert_array_equal(env.unwrapped.goal, obs["desired_goal"])
        obs, *_ = env.step(env.action_space.sample())


def test_the_tip_follows_a_lanes_own_lengths():
    env = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=2)
    lengths = np.array([[0.25] * 4, [0.1] * 4])
    env.reset(seed=0, options={"q": (0.0, 0.0, 0.0, 0.0), "parameters": {"lengths": lengths}})
    np.testing.assert_allclose(env.unwrapped.tip, [[1.0, 0.0], [0.4, 0.0]], atol=1e-15)


@every_id
def test_sb3_attributes_are_given_per_environment(env_id):
    _, env = faces(env_id, n=4)
    for name in NAMES:
        rows = env.get_attr(name)
        assert len(rows) == 4
        np.testing.assert_array_equal(rows, getattr(env, name))
        np.testing.assert_array_equal(env.get_attr(name, indices=[2, 0]), getattr(env, name)[[2, 0]])
        np.testing.assert_array_equal(env.get_attr(name, indices=1), getattr(env, name)[[1]])
        with pytest.raises(ValueError, match="set_options"):
            env.set_attr(name, 0.0)
    env.set_attr("on_bad_action", "raise")
    assert env.get_attr("on_bad_action") == ["raise"] * 4
    with pytest.raises(AttributeError):
        env.get_attr("nothing_of_that_name")
    assert not env.has_attr("nothing_of_that_name")


@every_id
def test_sb3_tells_the_spec_of_every_environment(env_id):
    env = rde.make_sb3(env_id.split("/")[1], 3, accuracy="exact", max_episode_steps=7)
    specs = env.get_attr("spec")
    assert len(specs) == 3
    for spec in specs:
        assert isinstance(spec, EnvSpec)
        assert (spec.id, spec.max_episode_steps, spec.kwargs["accuracy"]) == (env_id, 7, "exact")
    again = EnvSpec.from_json(specs[0].to_json()).make()
    assert again.unwrapped.core.scene.tolerance == 1e-12
    assert gym.spec(env_id).max_episode_steps == 100  # the registered one is as it was
    assert "accuracy" not in gym.spec(env_id).kwargs


@pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" in i])
def test_compute_reward_is_reached_as_hindsight_replay_reaches_it(env_id):
    env = rde.make_sb3(env_id, 4)
    obs = env.reset()
    goals = obs["achieved_goal"], obs["desired_goal"]
    (reward,) = env.env_method("compute_reward", *goals, [{}] * 4, indices=[0])
    assert reward.shape == (4,)
    assert len(env.env_method("compute_reward", *goals, [{}] * 4)) == 4


def explained(env_id):
    page = type(gym.make(env_id).unwrapped).__doc__
    rows = [line.split("|") for line in page.split("## Info")[1].split("## Arguments")[0].splitlines()]
    keys = {row[1].strip(" `") for row in rows if len(row) == 5 and row[1].strip().startswith("`")}
    sums = {word for word in page.split("## Rewards")[1].split("`") if word.startswith("return_")}
    assert all(row[2].strip() for row in rows if len(row) == 5)
    return (keys - {"return_*"}) | sums


@every_id
def test_every_key_of_info_stands_in_the_table_of_the_page(env_id):
    known = explained(env_id)
    single = gym.make(env_id)
    _, info = single.reset(seed=0)
    found = set(info) | set(single.step(single.action_space.sample())[4])
    _, sb3 = faces(env_id, max_episode_steps=4)
    found |= {key for info in sb3.reset_infos for key in info}
    for mode in ("next_step", "same_step", "disabled"):
        env = gym.make_vec(env_id, num_envs=2, autoreset_mode=mode, max_episode_steps=2)
        _, infos = env.reset(seed=0)
        found |= set(infos)
        for _ in range(2):
            found |= set(env.step(env.action_space.sample())[4])
    sb3.reset()
    for _ in range(4):
        *_, infos = sb3.step(np.zeros((3, 4), np.float32))
        found |= set(infos[0])
    assert {key for key in found if key.removeprefix("_") not in known} == set()


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["rk4", "rk8", "dop853"])
@pytest.mark.parametrize("limited", [False, True])
def test_the_table_also_explains_the_keys_of_other_scenes(integrator, limited):
    data = rde.load_scene("rprp_reach").to_dict()
    data.update(integrator=integrator, tolerance=None)
    if limited:
        data["effects"].append({"type": "LimitSpring", "coordinate": "joint1", "lower": -3.0, "upper": 3.0})
    env = gym.make("redundant_envs/RPRPReach-v0", scene=data)
    assert set(env.reset(seed=0)[1]) <= explained("redundant_envs/RPRPReach-v0")


@every_id
def test_the_page_draws_the_arm_with_all_its_names(env_id):
    env = gym.make(env_id).unwrapped
    drawing = type(env).__doc__.split("## Description")[1].split("## Action Space")[0]
    robot = env.core.scene.robot
    lines = [line for line in drawing.splitlines() if line.startswith("    ")]
    assert len(lines) == 4
    for name in (*robot.coordinates, *robot.parameter_values(), "tip"):
        assert any(name in line for line in lines), name


@every_id
def test_the_table_holds_no_key_that_nothing_gives(env_id):
    always = {key for key in explained(env_id) if not key.startswith("return_")}
    _, info = gym.make(env_id).reset(seed=0)
    elsewhere = {
        "final_obs",
        "final_info",
        "terminal_observation",
        "TimeLimit.truncated",
        "episode",
        "beyond_limit",
    }
    assert always - set(info) <= elsewhere | ({"events"} if "FourR" in env_id else set())
