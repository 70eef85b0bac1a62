"""The task: start, goal, success, reward, observation."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from small_scenes import OWN_IDS

import redundant_envs as rde
from redundant_envs.effects import EffortLimits

plain = [i for i in OWN_IDS if "Goal" not in i]
arms = pytest.mark.parametrize("env_id", plain)
WANTED_LIMITS = (1.7, 1.7 + 1.6 / 3, 1.7 + 3.2 / 3, 3.3)


@arms
def test_goals_are_uniform_over_the_area_of_the_annulus(env_id):
    env = gym.make_vec(env_id, num_envs=4096)
    env.reset(seed=0)
    goals = env.core.memory.read(("goal_x", "goal_y"))
    radius = np.linalg.norm(goals, axis=1) / env.core.reach
    assert radius.min() >= 0.1
    assert radius.max() <= 0.95
    share = (radius**2 - 0.1**2) / (0.95**2 - 0.1**2)
    quantiles = np.linspace(0.05, 0.95, 19)
    assert np.abs(np.quantile(share, quantiles) - quantiles).max() < 0.03
    angle = np.sort(np.arctan2(goals[:, 1], goals[:, 0]) / (2 * np.pi) + 0.5)
    assert np.abs(np.quantile(angle, quantiles) - quantiles).max() < 0.03


@arms
def test_start_is_at_rest_with_relative_angles_up_to_two_radians(env_id):
    env = gym.make_vec(env_id, num_envs=4096)
    env.reset(seed=0)
    arm = env.core.scene.robot
    joints = env.core.memory.read(arm.coordinates) @ arm.motor_map
    assert (env.core.memory.read(arm.rates) == 0.0).all()
    for k, (low, high) in enumerate(env.core.start_ranges()):
        assert joints[:, k].min() == pytest.approx(low, abs=0.01 * (high - low))
        assert joints[:, k].max() == pytest.approx(high, abs=0.01 * (high - low))
        if not arm.prismatic[k]:
            assert (low, high) == (-2.0, 2.0)


@arms
def test_effort_limits_stay_within_the_promised_multiples_of_the_static_load(env_id):
    scene = gym.make(env_id).unwrapped.core.scene
    limits = next(e for e in scene.effects if isinstance(e, EffortLimits)).limits
    arm = scene.robot
    travel = {k: scene.parameters()[high] for k, (_, high) in scene.travel().items()}
    for k in range(4):
        load = 0.0
        # revolute: stretched level; prismatic: the same arm stretched upright, where it weighs on it
        pose = np.array([travel.get(j, np.pi / 2 if arm.prismatic[k] else 0.0) for j in range(4)])
        load = abs(np.linalg.solve(arm.motor_map, arm.gravity_forces(pose))[k])
        assert limits[k] <= WANTED_LIMITS[k] * load


@arms
def test_joint_friction_is_at_most_a_fifth(env_id):
    scene = gym.make(env_id).unwrapped.core.scene
    assert sum(scene.robot.masses) == 2.0
    assert gym.make(env_id).unwrapped.core.reach == 1.0
    friction = next(e for e in scene.effects if type(e).__name__ == "ViscousFriction")
    assert max(friction.coefficients) <= 0.2


@arms
def test_hold_success_needs_ten_slow_steps_at_the_goal(env_id):
    env = gym.make(env_id, scene=floating(env_id))
    env.reset(seed=0)
    core = env.unwrapped.core
    q = core.memory.read(core.scene.robot.coordinates)[0]
    tip = core.scene.robot.forward_kinematics(q)
    env.reset(options={"q": q, "goal": tip})
    seen = [env.step(np.zeros(4, np.float32))[4] for _ in range(12)]
    assert [i["is_success"] for i in seen] == [False] * 9 + [True] * 3
    assert all(i["touch_success"] for i in seen)
    # moving fast through the goal counts as touched, not as held
    env.reset(options={"q": q, "goal": tip, "qd": (0.5, 0.0, 0.0, 0.0)})
    seen = [env.step(np.zeros(4, np.float32))[4] for _ in range(12)]
    assert seen[0]["touch_success"]
    assert not any(i["is_success"] for i in seen)


def floating(env_id):
    """The id's scene without gravity."""
    name = "rprp_reach" if "RPRP" in env_id else "four_r_reach"
    data = rde.load_scene(name).to_dict()
    data["effects"] = [e for e in data["effects"] if e["type"] != "Gravity"]
    return data


@arms
def test_reward_is_the_sum_of_the_terms_in_info(env_id):
    env = gym.make(env_id)
    env.reset(seed=4)
    total = 0.0
    for _ in range(100):
        _, reward, _, truncated, info = env.step(env.action_space.sample())
        total += reward
    assert truncated
    terms = {k: v for k, v in info.items() if k.startswith("return_")}
    names = ("far", "near", "precise", "effort", "settle", "rate", "end")
    assert set(terms) == {f"return_{t}" for t in names}
    assert sum(terms.values()) == pytest.approx(total, abs=1e-9)
    assert info["episode_steps"] == 100


@arms
def test_reward_at_the_goal_is_the_largest(env_id):
    env = gym.make(env_id, scene=floating(env_id))
    env.reset(seed=0)
    core = env.unwrapped.core
    q = core.memory.read(core.scene.robot.coordinates)[0]
    tip = core.scene.robot.forward_kinematics(q)
    env.reset(options={"q": q, "goal": tip})
    assert env.step(np.zeros(4, np.float32))[1] == pytest.approx(1.0, abs=1e-9)
    env.reset(options={"q": q, "goal": 0.9 * tip})
    assert env.step(np.zeros(4, np.float32))[1] < 0.9


@arms
def test_observation_and_reward_are_continuous_across_half_turns(env_id):
    scene = floating(env_id)
    env = gym.make(env_id, scene=scene)
    rows = []
    for sign in (-1.0, 1.0):
        edge = sign * (np.pi - 1e-12)
        q = [edge, 0.1, edge, 0.1] if "RPRP" in env_id else [edge] * 4
        env.reset(seed=1)
        obs, _ = env.reset(options={"q": q, "goal": (0.3, 0.3)})
        after, reward, *_ = env.step(np.zeros(4, np.float32))
        rows.append((obs, after, reward))
    np.testing.assert_allclose(rows[0][0], rows[1][0], atol=1e-6)
    np.testing.assert_allclose(rows[0][1], rows[1][1], atol=1e-6)
    assert rows[0][2] == pytest.approx(rows[1][2], abs=1e-9)


@arms
def test_observations_stay_in_their_box_at_any_speed(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    for k in range(4):
        rates = np.zeros(4)
        rates[k] = 40.0
        obs, _ = env.reset(options={"qd": rates})
        assert env.observation_space.contains(obs)


@arms
def test_a_lane_that_is_too_fast_ends_with_its_last_good_state(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    env.reset(options={"qd": (150.0, 0.0, 0.0, 0.0)})
    obs, reward, terminated, truncated, info = env.step(np.zeros(4, np.float32))
    assert terminated
    assert not truncated
    assert info["numerics"] == rde.Numerics.SPEED_BOUND
    assert np.isfinite(obs).all()
    assert np.isfinite(reward)


@arms
def test_saturated_actions_act_like_the_bounds_and_are_counted(env_id):
    rows = []
    for action in ([1.0, -1.0, 1.0, 0.5], [7.0, -3.0, 1.5, 0.5]):
        env = gym.make(env_id, disable_env_checker=True)
        env.reset(seed=0)
        obs, _, _, _, info = env.step(np.array(action, np.float32))
        rows.append((obs, info["saturated_actions"]))
    np.testing.assert_array_equal(rows[0][0], rows[1][0])
    assert [r[1] for r in rows] == [0, 3]


@pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" in i])
def test_goal_reward_is_exactly_compute_reward(env_id):
    env = gym.make_vec(env_id, num_envs=8)
    obs, _ = env.reset(seed=0)
    tip = obs["achieved_goal"] + 0.001
    obs, _ = env.reset(seed=0, options={"goal": tip})
    rewards = []
    for _ in range(30):
        obs, reward, *_ = env.step(np.zeros((8, 4), np.float32))
        again = env.compute_reward(obs["achieved_goal"], obs["desired_goal"], {})
        np.testing.assert_array_equal(reward, again)
        rewards.append(reward)
    assert set(np.unique(rewards)) == {0.0, 1.0}
    single = gym.make(env_id).unwrapped
    single.reset(seed=0)
    for i in range(8):
        one = single.compute_reward(obs["achieved_goal"][i], obs["desired_goal"][i], {})
        assert isinstance(one, float)
        assert one == again[i]


@arms
def test_options_set_everything_exactly(env_id):
    env = gym.make(env_id)
    q = np.array([0.3, 0.1, -0.2, 0.2])
    qd = np.array([0.1, -0.2, 0.3, 0.4])
    env.reset(seed=0)
    env.reset(
        options={
            "q": q,
            "qd": qd,
            "goal": (0.2, -0.4),
            "parameters": {"masses": (1, 2, 3, 4), "gravity.g": 1.6},
        }
    )
    core = env.unwrapped.core
    np.testing.assert_array_equal(core.memory.read(core.scene.robot.coordinates)[0], q)
    np.testing.assert_array_equal(core.memory.read(core.scene.robot.rates)[0], qd)
    np.testing.assert_array_equal(core.memory.read(("goal_x", "goal_y"))[0], (0.2, -0.4))
    np.testing.assert_array_equal(
        core.memory.read(("m1", "m2", "m3", "m4", "gravity.g"))[0], (1, 2, 3, 4, 1.6)
    )
    np.testing.assert_array_equal(core.memory.read(("inverse_m4",))[0], (0.25,))


@arms
def test_pages_agree_with_the_code(env_id):
    env = gym.make(env_id).unwrapped
    page = type(env).__doc__
    for heading in ("Description", "Action Space", "Observation Space", "Rewards", "Starting State",
                    "Episode End", "Arguments", "Version History"):  # fmt: skip
        assert f"## {heading}" in page
    section = page.split("## Observation Space")[1].split("## Rewards")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ") and line[2].isdigit()]
    assert len(rows) == env.observation_space.shape[0]
    limits = next(e for e in env.core.scene.effects if isinstance(e, EffortLimits)).limits
    for limit in limits:
        assert f"/ {limit:g} N" in page
    # every number of the task, and every keyword with its default
    for name in (field.name for field in dataclasses.fields(env.core.task)):
        assert f"| `{name}` | {getattr(env.core.task, name)} |" in page
    for name in ("scene", "render_mode", "on_bad_action", "task"):
        assert f"| `{name}` |" in page
    terms = [k.removeprefix("return_") for k in env.reset(seed=0)[1] if k.startswith("return_")]
    rewards = page.split("## Rewards")[1].split("## Starting")[0]
    assert [line.split("|")[1].strip() for line in rewards.splitlines() if line.startswith("| ")][2:] == terms


def test_limited_revolute_joints_start_inside_their_limits():
    data = rde.load_scene("four_r_reach").to_dict()
    data["effects"].append({"type": "LimitSpring", "coordinate": "joint2", "lower": -1.0, "upper": 0.5})
    env = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=2048, scene=data)
    env.reset(seed=0)
    arm = env.core.scene.robot
    joint = (env.core.memory.read(arm.coordinates) @ arm.motor_map)[:, 1]
    assert joint.min() >= -1.0
    assert joint.max() <= 0.5
    assert joint.max() - joint.min() > 1.4


def test_the_picture_shows_the_lanes_own_lengths():
    env = gym.make("redundant_envs/FourRReach-v0", render_mode="rgb_array")
    q = (0.3, 0.6, 0.2, -0.3)
    env.reset(seed=0, options={"q": q})
    first = env.render()
    env.reset(seed=0, options={"q": q, "parameters": {"lengths": (0.1, 0.1, 0.1, 0.1)}})
    env.unwrapped._renderer.clear()
    assert (env.render() != first).any()


def test_masks_of_infos_are_their_own():
    env = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=3)
    env.reset(seed=0)
    _, _, _, _, infos = env.step(np.zeros((3, 4), np.float32))
    masks = [name for name in infos if name.startswith("_")]
    infos[masks[0]][:] = False
    assert all(infos[name].all() for name in masks[1:])
    _, _, _, _, later = env.step(np.zeros((3, 4), np.float32))
    assert later[masks[0]].all()
