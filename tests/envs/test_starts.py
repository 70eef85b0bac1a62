"""Starts lie inside each lane's own limits; options may pass some limits, and not others."""

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde

FOUR_R, RPRP = "redundant_envs/FourRReach-v0", "redundant_envs/RPRPReach-v0"
LANES = 512


def limited(env_id, *limits, stop=True):
    """The id's scene with limit springs (joint, lower, upper), and with or without its hard stops."""
    data = rde.load_scene("rprp_reach" if env_id == RPRP else "four_r_reach").to_dict()
    if not stop:
        data["effects"] = [e for e in data["effects"] if e["type"] != "PrismaticStop"]
    for joint, lower, upper in limits:
        data["effects"].append({"type": "LimitSpring", "coordinate": joint, "lower": lower, "upper": upper})
    return data


def joints(env):
    core = env.unwrapped.core
    return core.memory.read(core.scene.robot.coordinates) @ core.scene.robot.motor_map


def assert_inside(positions, lower, upper):
    """Positions in the whole of a range and never beyond it."""
    width = np.asarray(upper) - lower
    assert (positions >= np.asarray(lower) - 1e-14).all()
    assert (positions <= np.asarray(upper) + 1e-14).all()
    share = (positions - lower) / width
    assert share.max() - share.min() > 0.9


def test_starts_follow_limits_that_a_lane_moved():
    env = gym.make_vec(FOUR_R, num_envs=LANES, scene=limited(FOUR_R, ("joint2", -1.0, 1.0)))
    lower = np.linspace(-2.2, 1.8, LANES)
    upper = lower + 0.3
    moved = {"limit_spring.joint2.lower": lower, "limit_spring.joint2.upper": upper}
    _, infos = env.reset(seed=0, options={"parameters": moved})
    assert_inside(joints(env)[:, 1], np.clip(lower, -2.0, None), np.clip(upper, None, 2.0))
    assert (infos["beyond_limit"] <= 1e-14).all()
    for k in (0, 2, 3):
        assert_inside(joints(env)[:, k], -2.0, 2.0)
    env.reset()  # later episodes too
    assert_inside(joints(env)[:, 1], np.clip(lower, -2.0, None), np.clip(upper, None, 2.0))


@pytest.mark.long
def test_starts_of_an_autoreset_follow_moved_limits():
    env = gym.make_vec(
        FOUR_R, num_envs=LANES, max_episode_steps=2, autoreset_mode="same_step",
        scene=limited(FOUR_R, ("joint3", -1.0, 1.0)),
    )  # fmt: skip
    env.reset(seed=0, options={"parameters": {"limit_spring.joint3.lower": 0.7}})
    for _ in range(2):
        env.step(np.zeros((LANES, 4), np.float32))
    assert_inside(joints(env)[:, 2], 0.7, 1.0)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ((2.5, 3.0), (2.5, 3.0)),
        ((-3.1, -2.9), (-3.1, -2.9)),
        ((-6.0, 6.0), (-2.0, 2.0)),
        ((1.5, 9.0), (1.5, 2.0)),
        ((4.0, 12.0), (4.0, 8.0)),
    ],
)
def test_starts_lie_in_the_limits_even_where_the_usual_range_does_not(limits, expected):
    env = gym.make_vec(FOUR_R, num_envs=LANES, scene=limited(FOUR_R, ("joint1", *limits)))
    env.reset(seed=0)
    assert_inside(joints(env)[:, 0], *expected)
    assert env.unwrapped.core.start_ranges()[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("springs", "stop", "expected"),
    [
        pytest.param(
            (("r1", 0.05, 0.1), ("r2", -0.1, 0.3)), False, ((0.05, 0.1), (-0.1, 0.3)), marks=pytest.mark.long
        ),
        pytest.param((("r1", 0.05, 0.1),), True, ((0.05, 0.1), (0.0, 0.25)), marks=pytest.mark.long),
        pytest.param(
            (("r1", -0.2, 0.1), ("r2", 0.2, 0.9)), True, ((0.0, 0.1), (0.2, 0.25)), marks=pytest.mark.long
        ),
        ((("r1", 0.3, 0.4),), True, ((0.15, 0.25), (0.0, 0.25))),
    ],
)
def test_sliders_start_inside_springs_and_stops_alike(springs, stop, expected):
    env = gym.make_vec(RPRP, num_envs=LANES, scene=limited(RPRP, *springs, stop=stop))
    env.reset(seed=0)
    for k, (lower, upper) in zip((1, 3), expected, strict=True):
        assert_inside(joints(env)[:, k], lower, upper)
        assert env.unwrapped.core.start_ranges()[k] == pytest.approx((lower, upper))


@pytest.mark.long
def test_starts_of_sliders_follow_moved_stops_and_springs():
    env = gym.make_vec(RPRP, num_envs=LANES, scene=limited(RPRP, ("r1", 0.0, 0.2), ("joint1", -1.0, 1.0)))
    upper = np.linspace(0.05, 0.22, LANES)
    env.reset(seed=0, options={"parameters": {
        "prismatic_stop.upper": np.stack([upper, 0.1 + 0 * upper], axis=1),
        "limit_spring.r1.lower": upper - 0.04, "limit_spring.joint1.upper": -0.5,
    }})  # fmt: skip
    assert_inside(joints(env)[:, 1], upper - 0.04, np.minimum(upper, 0.2))
    assert_inside(joints(env)[:, 3], 0.0, 0.1)
    assert_inside(joints(env)[:, 0], -1.0, -0.5)


def test_a_start_releases_no_energy_of_limit_springs():
    env = gym.make_vec(FOUR_R, num_envs=LANES, scene=limited(FOUR_R, ("joint2", -1.0, 1.0)))
    env.reset(seed=0, options={"parameters": {"limit_spring.joint2.upper": np.linspace(-0.9, 0.9, LANES)}})
    *_, infos = env.step(np.zeros((LANES, 4), np.float32))
    assert not infos["numerics"].any()
    assert np.abs(env.unwrapped.core.memory.read(env.unwrapped.core.scene.robot.rates)).max() < 5.0


@pytest.mark.parametrize("env_id", [FOUR_R, pytest.param(RPRP, marks=pytest.mark.long)])
def test_a_start_beyond_a_spring_is_allowed_and_shown(env_id):
    scene = limited(env_id, ("joint1", -1.0, 1.0), ("joint2", -0.5, 2.0))
    env = gym.make(env_id, scene=scene)
    q = (1.25, 0.1, 1.0, 0.1) if env_id == RPRP else (1.25, 1.5, 1.5, 1.5)
    _, info = env.reset(seed=0, options={"q": q})
    assert info["beyond_limit"] == pytest.approx(0.25, abs=1e-12)
    *_, info = env.step(np.zeros(4, np.float32))
    depth = max(*(joints(env)[0, [0, 1 + (env_id == RPRP)]] - (1.0, 2.0)), 0.0)
    assert info["beyond_limit"] == pytest.approx(depth, abs=1e-12)
    _, info = env.reset(seed=0)
    assert info["beyond_limit"] <= 1e-14
    # limits that leave the given start behind
    _, info = env.reset(options={"q": q, "parameters": {"limit_spring.joint1.upper": 0.5}})
    assert info["beyond_limit"] == pytest.approx(0.75, abs=1e-12)


def test_scenes_without_limit_springs_have_no_depth_to_show():
    _, info = gym.make(RPRP).reset(seed=0)
    assert "beyond_limit" not in info


@pytest.mark.parametrize("make", [
    lambda **k: gym.make(RPRP, **k),
    lambda **k: gym.make_vec(RPRP, num_envs=3, **k),
], ids=["single", "vector"])  # fmt: skip
@pytest.mark.parametrize(
    "options",
    [
        {"q": (0.0, 0.2500001, 0.0, 0.0)},
        {"q": (0.0, 0.1, 0.0, -1e-9)},
        {"q": (0.0, 0.2, 0.0, 0.0), "parameters": {"prismatic_stop.upper": (0.1, 0.2)}},
    ],
)
def test_options_beyond_a_hard_stop_are_refused(make, options):
    env = make(scene=limited(RPRP, ("r1", -1.0, 1.0)))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"options\['q'\]: r[12] is .* m; its stops are at 0 and "):
        env.reset(options=options)


@pytest.mark.long
def test_a_slider_with_one_stop_needs_a_spring_at_its_other_end():
    data = limited(RPRP)
    stop = next(e for e in data["effects"] if e["type"] == "PrismaticStop")
    stop["upper"] = [None, 0.25]
    with pytest.raises(ValueError, match=r"limited travel of 'r1'.*both ends"):
        gym.make(RPRP, scene=data)
    data["effects"].append({"type": "LimitSpring", "coordinate": "r1", "lower": -0.1, "upper": 0.2})
    env = gym.make_vec(RPRP, num_envs=LANES, scene=data)
    env.reset(seed=0)
    assert_inside(joints(env)[:, 1], 0.0, 0.2)
    with pytest.raises(ValueError, match=r"r1 is -0.05 m; its stops are at 0 and inf m"):
        env.reset(options={"q": (0.0, -0.05, 0.0, 0.0)})
    _, infos = env.reset(options={"q": (0.0, 0.25, 0.0, 0.0)})
    assert infos["beyond_limit"] == pytest.approx(0.05)


@pytest.mark.long
def test_the_reach_of_a_slider_arm_counts_no_angles():
    plain = gym.make(RPRP).unwrapped.core.reach
    env = gym.make(RPRP, scene=limited(RPRP, ("joint1", -1.0, 1.5)))
    assert env.unwrapped.core.reach == plain
    env.reset(seed=0)
    with pytest.raises(ValueError, match="the arm reaches 1 m"):
        env.reset(options={"goal": (1.2, 0.0)})


def test_a_simulator_refuses_stops_that_leave_a_slider_behind_and_takes_springs_that_do():
    scene = rde.Scene.from_dict(limited(RPRP, ("joint1", -1.0, 1.0)))
    batch = rde.BatchSimulator(scene, num_envs=4)
    batch.set_state((0.5, 0.2, 0.0, 0.1), (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"r1 is 0\.2 m; its stops are at 0 and 0\.1 m"):
        batch.set_parameters({"prismatic_stop.upper": (0.1, 0.2)})
    batch.set_parameters({"limit_spring.joint1.upper": 0.2})
    assert batch.advance().finite.all()
