"""Starts lie inside each lane's limits; options may pass springs, not stops; sliders stay between these."""

import gymnasium as gym
import numpy as np
import pytest
from faces import FACES, FOUR_R, ID, actions, begin, made, motion, running

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


def test_starts_follow_limits_that_a_lane_moved():
    env = made("next_step", FOUR_R, LANES, scene=limited(FOUR_R, ("joint2", -1.0, 1.0)))
    lower = np.linspace(-2.2, 1.8, LANES)
    moved = {"limit_spring.joint2.lower": lower, "limit_spring.joint2.upper": lower + 0.3}
    _, infos = env.reset(seed=0, options={"parameters": moved})
    assert (infos["beyond_limit"] <= 1e-14).all()
    for _ in range(2):  # later episodes too
        assert_inside(joints(env)[:, 1], np.clip(lower, -2.0, None), np.clip(lower + 0.3, None, 2.0))
        for k in (0, 2, 3):
            assert_inside(joints(env)[:, k], *ALL[0])
        env.reset()
    for _ in range(2):  # a start releases no energy of limit springs
        *_, infos = env.step(np.zeros((LANES, 4), np.float32))
        assert not infos["numerics"].any()
    assert np.abs(env.qd).max() < 5.0


@pytest.mark.long
def test_starts_of_an_autoreset_and_of_sliders_follow_moved_limits():
    scene = limited(FOUR_R, ("joint3", -1.0, 1.0))
    env = made("same_step", FOUR_R, LANES, max_episode_steps=2, scene=scene)
    begin(env, {"parameters": {"limit_spring.joint3.lower": 0.7}}, seed=0)
    for _ in range(2):
        env.step(np.zeros((LANES, 4), np.float32))
    assert_inside(joints(env)[:, 2], 0.7, 1.0)
    env = made("next_step", ID, LANES, scene=limited(ID, ("r1", 0.0, 0.2), ("joint1", -1.0, 1.0)))
    upper = np.linspace(0.05, 0.22, LANES)
    begin(env, {"parameters": {
        "prismatic_stop.upper": np.stack([upper, 0.1 + 0 * upper], axis=1),
        "limit_spring.r1.lower": upper - 0.04, "limit_spring.joint1.upper": -0.5,
    }}, seed=0)  # fmt: skip
    assert_inside(joints(env)[:, 1], upper - 0.04, np.minimum(upper, 0.2))
    assert_inside(joints(env)[:, 3], 0.0, 0.1)
    assert_inside(joints(env)[:, 0], -1.0, -0.5)


@pytest.mark.parametrize(
    ("env_id", "springs", "stop", "expected"),
    [
        *(
            (FOUR_R, (("joint1", *limits),), True, {0: starts})
            for limits, starts in (
                ((2.5, 3.0), (2.5, 3.0)), ((-3.1, -2.9), (-3.1, -2.9)), ((-6.0, 6.0), ALL[0]),
                ((1.5, 9.0), (1.5, 2.0)), ((4.0, 12.0), (4.0, 8.0)),
            )
        ),
        *(
            pytest.param(ID, *case, marks=pytest.mark.long)
            for case in (
                ((("r1", 0.05, 0.1), ("r2", -0.1, 0.3)), False, {1: (0.05, 0.1), 3: (-0.1, 0.3)}),
                ((("r1", 0.05, 0.1),), True, {1: (0.05, 0.1), 3: ALL[1]}),
                ((("r1", -0.2, 0.1), ("r2", 0.2, 0.9)), True, {1: (0.0, 0.1), 3: (0.2, 0.25)}),
            )
        ),
        (ID, (("r1", 0.3, 0.4),), True, {1: (0.15, 0.25), 3: ALL[1]}),
    ],
    ids=str,
)  # fmt: skip
def test_starts_lie_in_springs_and_stops_even_where_the_usual_range_does_not(env_id, springs, stop, expected):
    env = made("next_step", env_id, LANES, scene=limited(env_id, *springs, stop=stop))
    begin(env, seed=0)
    for k, (lower, upper) in expected.items():
        assert_inside(joints(env)[:, k], lower, upper)
        assert env.core.start_ranges()[k] == pytest.approx((lower, upper))


@pytest.mark.parametrize("env_id", [FOUR_R, pytest.param(ID, marks=pytest.mark.long)])
def test_a_start_beyond_a_spring_is_allowed_and_shown(env_id):
    env = made("single", env_id, scene=limited(env_id, ("joint1", -1.0, 1.0), ("joint2", -0.5, 2.0)))
    q = (1.25, 0.1, 1.0, 0.1) if env_id == ID else (1.25, 1.5, 1.5, 1.5)
    _, info = env.reset(seed=0, options={"q": q})
    assert info["beyond_limit"] == pytest.approx(0.25, abs=1e-12)
    *_, info = env.step(np.zeros(4, np.float32))
    depth = max(*(joints(env)[0, [0, 1 + (env_id == ID)]] - (1.0, 2.0)), 0.0)
    assert info["beyond_limit"] == pytest.approx(depth, abs=1e-12)
    assert env.reset(seed=0)[1]["beyond_limit"] <= 1e-14
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


# ---- motions at stops ----------------------------------------------------------------------------------


def resting(env):
    return env.core.memory.read(("active_stop_r1", "active_stop_r2")) != 0.0


@pytest.mark.parametrize("kind", ["next_step", "same_step", "sb3"])
def test_sliders_stay_between_their_stops_and_states_and_resets_know_those_that_rest(kind):
    env = made(kind, count=60)
    begin(env, seed=1)
    for action in actions(env, 130):
        *_, infos = env.step(action)
        assert ((env.q[:, [1, 3]] >= 0.0) & (env.q[:, [1, 3]] <= 0.25)).all()
        assert not env.core.memory.read(("numerics",)).any()
    if kind != "sb3":
        assert infos["events"].sum() > 20
        assert (infos["evaluations"] >= infos["episode_steps"]).all()
    at_rest = resting(env).any(axis=1)
    assert at_rest.any()
    state = env.get_state()
    first = motion(env)
    env.set_state(state)
    assert motion(env) == first
    env.set_state(state)
    begin(env, {} if kind == "sb3" else {"reset_mask": at_rest}, seed=2)
    assert not resting(env)[at_rest].any()


@pytest.mark.parametrize("integrator", [pytest.param("euler", marks=pytest.mark.long), "rk4"])
def test_a_lane_that_breaks_in_an_early_substep_shows_its_last_finite_state(integrator):
    scene = {**limited(ID), "integrator": integrator, "substeps": 20, "tolerance": None}
    env = made("disabled", ID, 9, scene=scene, task={"speed_bound": 1e308})
    qd = np.zeros((9, 4))
    qd[4] = 1e80, 0.0, -1e80, 0.0
    begin(env, {"q": (0.3, 0.1, 0.5, 0.1), "qd": qd}, seed=0)
    before = env.q[4], env.qd[4]
    obs, reward, terminated, _, infos = env.step(np.zeros((9, 4), np.float32))
    assert terminated.tolist() == [k == 4 for k in range(9)]
    assert np.isfinite(obs).all()
    assert np.isfinite(reward).all()
    np.testing.assert_array_equal((env.q[4], env.qd[4]), before)
    assert infos["numerics"][4] == 1


def test_a_start_at_a_stop_is_allowed_and_a_lane_may_move_its_stops(face):
    env = made(face)
    begin(env, {"q": (-1.5, 0.25, -1.5, 0.0)}, seed=0)
    for _ in range(5):
        env.step(np.zeros_like(actions(env, 1)[0]))
    assert not env.core.memory.read(("numerics",)).any()
    begin(env, {"parameters": {"prismatic_stop.upper": (0.1, 0.2), "prismatic_stop.restitution": 0.5}})
    for action in actions(env, 50):
        env.step(action)
        sliders = np.atleast_2d(env.q)[:, [1, 3]]
        assert ((sliders >= 0.0) & (sliders <= (0.1, 0.2))).all()


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_that_is_pressed_onto_its_stop_is_supported_when_the_other_one_strikes(restitution):
    """The same as if the other one starts a little before its stop; from a reset and from a state."""
    scene = limited(ID)
    stop = next(x for x in scene["effects"] if x["type"] == "PrismaticStop")
    stop["restitution"], upper = restitution, stop["upper"][0]
    ends = {}
    for gap in (0.0, 1e-15):
        for kind in FACES:
            env = running(kind, scene=scene)
            begin(env, {"q": (-1.2, upper, -0.4, upper - gap), "qd": (0.0, 0.0, 0.0, 1.0)}, seed=0)
            state = env.get_state()
            for _ in range(2):
                env.set_state(state)
                env.step(np.zeros_like(actions(env, 1)[0]))
                end = ends.setdefault(gap, np.concatenate([env.q, env.qd]))
                assert (np.concatenate([np.atleast_2d(env.q), np.atleast_2d(env.qd)], axis=1) == end).all()
        assert ends[gap][1] == upper
    assert np.abs(ends[0.0] - ends[1e-15]).max() < 1e-9
