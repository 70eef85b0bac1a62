"""Starts lie inside each lane's limits; options may pass springs, not stops; sliders stay between these."""

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, ID, actions, begin, made

import redundant_envs as rde

LANES = 512
ALL = (-2.0, 2.0), (0.0, 0.25)
"""Ranges of starts without other limits: of revolute joints, rad, and of sliders, m."""


def limited(env_id, *limits, stop=True):
    """The id's scene with limit springs (joint, lower, upper), and with or without its hard stops."""
    data = rde.load_scene("rprp_reach" if env_id == ID else "four_r_reach").to_dict()
    data["effects"] = [e for e in data["effects"] if stop or e["type"] != "PrismaticStop"]
    for joint, lower, upper in limits:
        data["effects"].append({"type": "LimitSpring", "coordinate": joint, "lower": lower, "upper": upper})
    return data


def joints(env):
    return np.atleast_2d(env.q @ env.scene.robot.motor_map)


def assert_inside(positions, lower, upper):
    """Positions in the whole of a range and never beyond it."""
    lower, upper = np.asarray(lower), np.asarray(upper)
    assert (positions >= lower - 1e-14).all()
    assert (positions <= upper + 1e-14).all()
    assert np.ptp((positions - lower) / (upper - lower)) > 0.9


@pytest.mark.long
def test_starts_of_every_episode_follow_limits_that_a_lane_moved():
    scene = limited(FOUR_R, ("joint1", -6.0, 6.0), ("joint3", -1.0, 1.0))
    env = made("same_step", FOUR_R, LANES, max_episode_steps=2, scene=scene)
    lower = np.linspace(-2.2, 1.8, LANES)
    moved = {"limit_spring.joint3.lower": lower, "limit_spring.joint3.upper": lower + 0.3}
    _, infos = env.reset(seed=0, options={"parameters": moved})
    assert (infos["beyond_limit"] <= 1e-14).all()
    for _ in range(2):
        assert_inside(joints(env)[:, 2], np.clip(lower, -2.0, None), np.clip(lower + 0.3, None, 2.0))
        for k in (0, 1, 3):
            assert_inside(joints(env)[:, k], *ALL[0])
        for _ in range(2):  # a start releases no energy of limit springs
            assert np.abs(env.qd).max() < 5.0
            *_, infos = env.step(np.zeros((LANES, 4), np.float32))
            assert not infos["numerics"].any()


@pytest.mark.long
@pytest.mark.parametrize(
    ("env_id", "springs", "stop", "expected"),
    [
        (FOUR_R, (("joint1", 2.5, 3.0), ("joint3", -6.0, 6.0)), True, {0: (2.5, 3.0), 2: ALL[0]}),
        (FOUR_R, (("joint1", 1.5, 9.0), ("joint3", 4.0, 12.0)), True, {0: (1.5, 2.0), 2: (4.0, 8.0)}),
        (ID, (("r1", 0.3, 0.4),), True, {1: (0.15, 0.25), 3: ALL[1]}),
        pytest.param(
            ID, (("r1", 0.05, 0.1), ("r2", -0.1, 0.3)), False, {1: (0.05, 0.1), 3: (-0.1, 0.3)},
            marks=pytest.mark.long,
        ),
    ],
    ids=str,
)  # fmt: skip
def test_starts_lie_in_springs_and_stops_even_where_the_usual_range_does_not(env_id, springs, stop, expected):
    env = made("next_step", env_id, LANES, scene=limited(env_id, *springs, stop=stop))
    begin(env, seed=0)
    for k, (lower, upper) in expected.items():
        assert_inside(joints(env)[:, k], lower, upper)
        assert env.core.start_ranges()[k] == pytest.approx((lower, upper))


@pytest.mark.long
def test_a_start_beyond_a_spring_is_allowed_and_shown():
    env = made("single", FOUR_R, scene=limited(FOUR_R, ("joint1", -1.0, 1.0), ("joint3", -0.5, 2.0)))
    q = (1.25, 1.5, 1.5, 1.5)
    _, info = env.reset(seed=0, options={"q": q})
    assert info["beyond_limit"] == pytest.approx(0.25, abs=1e-12)
    *_, info = env.step(np.zeros(4, np.float32))
    depth = max(*(joints(env)[0, [0, 2]] - (1.0, 2.0)), 0.0)
    assert info["beyond_limit"] == pytest.approx(depth, abs=1e-12)
    # limits that leave the given start behind
    _, info = env.reset(options={"q": q, "parameters": {"limit_spring.joint1.upper": 0.5}})
    assert info["beyond_limit"] == pytest.approx(0.75, abs=1e-12)


@pytest.mark.long
def test_a_slider_with_one_stop_needs_a_spring_at_its_other_end_and_reach_counts_no_angles():
    data = limited(ID)
    next(e for e in data["effects"] if e["type"] == "PrismaticStop")["upper"] = [None, 0.25]
    with pytest.raises(ValueError, match=r"limited travel of 'r1'.*both ends"):
        gym.make(ID, scene=data)
    data["effects"].append({"type": "LimitSpring", "coordinate": "r1", "lower": -0.1, "upper": 0.2})
    env = made("next_step", ID, LANES, scene=data)
    begin(env, seed=0)
    assert_inside(joints(env)[:, 1], 0.0, 0.2)
    with pytest.raises(ValueError, match=r"r1 is -0.05 m; its stops are at 0 and inf m"):
        begin(env, {"q": (0.0, -0.05, 0.0, 0.0)})
    _, infos = env.reset(options={"q": (0.0, 0.25, 0.0, 0.0)})
    assert infos["beyond_limit"] == pytest.approx(0.05)
    env = made("single", scene=limited(ID, ("joint1", -1.0, 1.5)))
    assert env.core.reach == made("single").core.reach
    with pytest.raises(ValueError, match="the arm reaches 1 m"):
        begin(env, {"goal": (1.2, 0.0)})


def test_goals_have_no_bounds_where_sliders_have_springs_alone():
    springs = limited(ID, ("r1", 0.0, 0.25), ("r2", 0.0, 0.25), stop=False)
    for scene, bounded in (("rprp_reach", True), (springs, False)):
        space = gym.make("redundant_envs/RPRPGoalReach-v0", scene=scene).observation_space
        assert (np.isfinite(space["desired_goal"].high) == bounded).all()


def test_a_start_at_a_stop_rests_there_and_a_lane_may_move_its_stops(face):
    env = made(face)
    begin(env, {"q": (-1.5, 0.25, -1.5, 0.0)}, seed=0)
    rest = np.zeros_like(actions(env, 1)[0])
    for _ in range(5):
        env.step(rest)
    assert (env.core.memory.read(("active_stop_r1", "active_stop_r2")) != 0.0).any(axis=1).all()
    begin(env, {"parameters": {"prismatic_stop.upper": (0.1, 0.2), "prismatic_stop.restitution": 0.5}})
    for action in actions(env, 50):
        env.step(action)
        sliders = np.atleast_2d(env.q)[:, [1, 3]]
        assert ((sliders >= 0.0) & (sliders <= (0.1, 0.2))).all()
