"""The task: starts and goals, observation, reward, success, early ends, and its numbers."""

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, ID, actions, begin, made, running

import redundant_envs as rde
from redundant_envs.envs.core import start_ranges

LANES = 512
ALL = (-2.0, 2.0), (0.0, 0.25)
"""Ranges of starts without other limits: of revolute joints, rad, and of sliders, m."""


def changed(env_id, *springs, without=()):
    """The scene of an id with limit springs (joint, lower, upper), and without some effects."""
    data = gym.make(env_id).unwrapped.scene.to_dict()
    data["effects"] = [x for x in data["effects"] if x["type"] not in without]
    for joint, lower, upper in springs:
        data["effects"].append({"type": "LimitSpring", "coordinate": joint, "lower": lower, "upper": upper})
    return data


def still(env):
    """The action without effort."""
    return np.zeros(env.action_space.shape, np.float32)


def at_the_goal(env_id, share=1.0, **options):
    """An environment without gravity whose tip is at its goal, or whose goal is nearer by a share."""
    env = made("single", env_id, scene=changed(env_id, without=("Gravity",)))
    begin(env, seed=0)
    begin(env, {"q": env.q, "goal": share * env.tip, **options})
    return env


def joints(env):
    return np.atleast_2d(env.q @ env.scene.robot.motor_map)


def assert_inside(positions, lower, upper):
    """Positions in the whole of a range and never beyond it."""
    lower, upper = np.asarray(lower), np.asarray(upper)
    assert (positions >= lower - 1e-14).all()
    assert (positions <= upper + 1e-14).all()
    assert np.ptp((positions - lower) / (upper - lower)) > 0.9


def test_goals_and_starts_have_the_promised_distributions(plain_id):
    env = made("next_step", plain_id, 4096)
    begin(env, seed=0)
    radius = np.linalg.norm(env.goal, axis=1) / env.core.reach
    assert radius.min() >= 0.1
    assert radius.max() <= 0.95
    angle = np.arctan2(env.goal[:, 1], env.goal[:, 0]) / (2 * np.pi) + 0.5
    quantiles = np.linspace(0.05, 0.95, 19)
    for share in ((radius**2 - 0.1**2) / (0.95**2 - 0.1**2), angle):
        assert np.abs(np.quantile(share, quantiles) - quantiles).max() < 0.03
    assert (env.qd == 0.0).all()
    for k, slides in enumerate(env.scene.robot.prismatic):
        assert_inside(joints(env)[:, k], *ALL[slides])


@pytest.mark.quick("a spring beyond a stop")
@pytest.mark.parametrize(
    ("env_id", "springs", "without", "expected"),
    [
        (FOUR_R, (("joint1", 2.5, 3.0), ("joint3", -6.0, 6.0)), (), {0: (2.5, 3.0), 2: ALL[0]}),
        (FOUR_R, (("joint1", 1.5, 9.0), ("joint3", 4.0, 12.0)), (), {0: (1.5, 2.0), 2: (4.0, 8.0)}),
        (ID, (("r1", 0.3, 0.4),), (), {1: (0.15, 0.25), 3: ALL[1]}),
        (ID, (("r1", 0.05, 0.1), ("r2", -0.1, 0.3)), ("PrismaticStop",), {1: (0.05, 0.1), 3: (-0.1, 0.3)}),
    ],
    ids=["beyond the usual range", "across its end", "a spring beyond a stop", "springs alone"],
)
def test_starts_lie_in_springs_and_stops_even_where_the_usual_range_does_not(
    env_id, springs, without, expected
):
    env = made("next_step", env_id, LANES, scene=changed(env_id, *springs, without=without))
    begin(env, seed=0)
    for k, (lower, upper) in expected.items():
        assert_inside(joints(env)[:, k], lower, upper)
        assert start_ranges(env.core.scene, env.core.task)[k] == pytest.approx((lower, upper))


def test_a_slider_with_one_stop_needs_a_spring_at_its_other_end():
    data = changed(ID)
    next(e for e in data["effects"] if e["type"] == "PrismaticStop")["upper"] = [None, 0.25]
    with pytest.raises(ValueError, match=r"limited travel of 'r1'.*both ends"):
        gym.make(ID, scene=data)


def test_goals_have_no_bounds_where_sliders_have_springs_alone():
    springs = changed(ID, ("r1", 0.0, 0.25), ("r2", 0.0, 0.25), without=("PrismaticStop",))
    for scene, bounded in (("rprp_reach", True), (springs, False)):
        space = gym.make("redundant_envs/RPRPGoalReach-v0", scene=scene).observation_space
        assert (np.isfinite(space["desired_goal"].high) == bounded).all()


def test_the_observation_of_a_goal_environment_holds_nothing_of_the_goal(goal_id):
    env, rows = made("single", goal_id), []
    for goal in ((0.3, 0.2), (-0.5, 0.1)):
        first = begin(env, {"goal": goal}, seed=3)
        rows.append([first, *(env.step(action)[0] for action in actions(env, 20))])
    for one, other in zip(*rows, strict=True):
        np.testing.assert_array_equal(one["observation"], other["observation"])
        np.testing.assert_array_equal(one["achieved_goal"], other["achieved_goal"])
        assert (one["desired_goal"] != other["desired_goal"]).any()


@pytest.mark.quick("redundant_envs/RPRPReach-v0")
def test_hold_success_needs_ten_slow_steps_at_the_goal(plain_id):
    joints = len(made("single", plain_id).scene.robot.joints)
    changes = ({}, {"qd": (0.5, *(joints - 1) * (0.0,))}, {"parameters": {"hold_steps": 3}})
    slow, fast, short = (
        [env.step(still(env))[4] for _ in range(12)] for env in (at_the_goal(plain_id, **c) for c in changes)
    )
    assert [i["is_success"] for i in slow] == [False] * 9 + [True] * 3
    assert all(i["touch_success"] for i in slow)
    assert fast[0]["touch_success"]
    assert not any(i["is_success"] for i in fast)  # the goal is touched, not held
    assert [i["is_success"] for i in short] == [False] * 2 + [True] * 10


def test_reward_is_the_sum_of_its_terms_and_largest_at_the_goal(plain_id):
    env = running("single", plain_id, info_keys="all")
    table = actions(env, 100)
    env.reset(seed=4)
    total = sum(env.step(action)[1] for action in table[1:])
    _, reward, _, _, info = env.step(table[0])
    terms = {k: v for k, v in info.items() if k.startswith("return_")}
    assert set(terms) == {
        f"return_{t}" for t in ["far", "near", "precise", "effort", "settle", "rate", "end"]
    }
    assert sum(terms.values()) == pytest.approx(total + reward, abs=1e-9)
    assert info["episode_steps"] == 100
    there, near = at_the_goal(plain_id), at_the_goal(plain_id, 0.9)
    assert there.step(still(there))[1] == pytest.approx(1.0, abs=1e-9)
    assert near.step(still(near))[1] < 0.9


@pytest.mark.long
def test_goal_environments_pay_one_at_the_goal_and_nothing_elsewhere(goal_id):
    """The reward is exactly compute_reward, of a pair or of many, as hindsight replay calls it."""
    env, single, seen = made("next_step", goal_id, 8), running("single", goal_id), set()
    begin(env, {"goal": begin(env, seed=0)["achieved_goal"] + 0.001}, seed=0)
    for _ in range(100):
        obs, reward, *_ = env.step(still(env))
        goals = obs["achieved_goal"], obs["desired_goal"]
        near = np.linalg.norm(goals[0] - goals[1], axis=1) <= 0.02 * env.core.reach
        np.testing.assert_array_equal(reward, near)
        np.testing.assert_array_equal(reward, env.compute_reward(*goals, {}))
        assert reward.tolist() == [single.compute_reward(a, d, {}) for a, d in zip(*goals, strict=True)]
        seen |= {*reward}
    assert seen == {0.0, 1.0}


def test_an_early_end_takes_back_what_was_paid_and_says_so(plain_id):
    env = made("single", plain_id, info_keys="all")
    begin(env, seed=0)
    rewards = [env.step(still(env))[1] for _ in range(5)]
    assert min(rewards) > 0.0
    last = env.q
    env.core.memory.write((env.scene.robot.rates[0],), 150.0)
    obs, reward, terminated, truncated, info = env.step(still(env))
    assert (terminated, truncated, info["numerics"]) == (True, False, rde.Numerics.SPEED_BOUND)
    assert np.isfinite(obs).all()
    np.testing.assert_array_equal(env.q, last)  # its last good state
    assert sum(rewards) + reward == pytest.approx(0.0, abs=1e-12)
    paid = sum(v for k, v in info.items() if k.startswith("return_") and k != "return_end")
    assert info["return_end"] == pytest.approx(-paid, abs=1e-12)


def test_accuracy_chooses_the_tolerance():
    states, evaluations = [], []
    for accuracy, tolerance in (("standard", 1e-6), (1e-9, 1e-9), ("exact", 1e-12)):
        env = running("single", FOUR_R, accuracy=accuracy)
        for action in actions(env, 19):
            *_, info = env.step(action)
        states.append(env.q)
        evaluations.append(info["evaluations"])
        assert 0.0 < info["error_estimate"] <= tolerance
    standard, between, exact = states
    assert 0.0 < np.abs(between - exact).max() < np.abs(standard - exact).max() < 1e-3
    assert 12 * 20 <= evaluations[0] < evaluations[1] < evaluations[2]


def test_a_start_beyond_springs_tells_how_far():
    env = made("single", FOUR_R, scene=changed(FOUR_R, ("joint1", -1.0, 1.0), ("joint3", -0.5, 2.0)))
    for numbers, depth in (({}, 0.25), ({"limit_spring.joint1.upper": 0.5}, 0.75)):
        _, info = env.reset(seed=0, options={"q": (1.25, 1.5, 1.5, 1.5), "parameters": numbers})
        assert info["beyond_limit"] == pytest.approx(depth, abs=1e-12)
    info = env.step(still(env))[4]
    assert info["beyond_limit"] == pytest.approx(max(joints(env)[0, 0] - 0.5, 0.0), abs=1e-12)
