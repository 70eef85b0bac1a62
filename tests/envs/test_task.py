"""The task: starts and goals, observation, reward, success, early ends, and its numbers."""

import numpy as np
import pytest
from faces import FOUR_R, actions, begin, made, motion, running

import redundant_envs as rde

ZERO = np.zeros(4, np.float32)
WANTED_LIMITS = (1.7, 1.7 + 1.6 / 3, 1.7 + 3.2 / 3, 3.3)
"""Limits of efforts that the project promises, in multiples of the static load of the stretched arm."""


def weightless(env_id):
    """The scene of an id without gravity."""
    data = rde.load_scene("rprp_reach" if "RPRP" in env_id else "four_r_reach").to_dict()
    return data | {"effects": [x for x in data["effects"] if x["type"] != "Gravity"]}


def at_the_goal(env_id, share=1.0, **options):
    """An environment without gravity whose tip is at its goal, or whose goal is nearer by a share."""
    env = made("single", env_id, scene=weightless(env_id))
    begin(env, seed=0)
    begin(env, {"q": env.q, "goal": share * env.tip, **options})
    return env


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
    arm = env.scene.robot
    joints = env.q @ arm.motor_map
    assert (env.qd == 0.0).all()
    for k, (low, high) in enumerate(env.core.start_ranges()):
        ends = joints[:, k].min(), joints[:, k].max()
        assert ends == pytest.approx((low, high), abs=0.01 * (high - low))
        assert arm.prismatic[k] or (low, high) == (-2.0, 2.0)


def test_strength_reach_mass_and_friction_are_those_promised(plain_id):
    env = made("single", plain_id)
    assert (sum(env.scene.robot.masses), env.core.reach) == (2.0, 1.0)
    effects, arm = {type(x).__name__: x for x in env.scene.effects}, env.scene.robot
    assert max(effects["ViscousFriction"].coefficients) <= 0.2
    travel = {k: env.scene.parameters()[high] for k, (_, high) in env.scene.travel().items()}
    for k in range(4):
        # revolute: stretched level; prismatic: the same arm stretched upright, where it weighs on it
        pose = np.array([travel.get(j, np.pi / 2 if arm.prismatic[k] else 0.0) for j in range(4)])
        load = abs(np.linalg.solve(arm.motor_map, arm.gravity_forces(pose))[k])
        assert effects["EffortLimits"].limits[k] <= WANTED_LIMITS[k] * load


def test_options_set_everything_exactly(goal_id):
    env = made("single", goal_id)
    given = {"q": (0.3, 0.1, -0.2, 0.2), "qd": (0.1, -0.2, 0.3, 0.4), "goal": (0.2, -0.4)}
    begin(env, {**given, "parameters": {"masses": (1, 2, 3, 4), "gravity.g": 1.6}}, seed=0)
    for name, value in given.items():
        np.testing.assert_array_equal(getattr(env, name), value)
    prepared = "inverse_m4" if "RPRP" in goal_id else "ratio34"  # numbers that follow from the masses
    read = env.core.memory.read(("m1", "m2", "m3", "m4", "gravity.g", prepared))[0]
    np.testing.assert_array_equal(read, (1, 2, 3, 4, 1.6, 0.25 if "RPRP" in goal_id else 0.75))


@pytest.mark.long
def test_observation_and_reward_are_continuous_across_half_turns(plain_id):
    rows = []
    for sign in (-1.0, 1.0):
        edge = sign * (np.pi - 1e-12)
        q = [edge, 0.1, edge, 0.1] if "RPRP" in plain_id else [edge] * 4
        env = made("single", plain_id, scene=weightless(plain_id))
        obs = begin(env, {"q": q, "goal": (0.3, 0.3)}, seed=1)
        after, reward, *_ = env.step(ZERO)
        rows.append([*obs, *after, reward])
    np.testing.assert_allclose(*rows, atol=1e-6)
    assert rows[0][-1] == pytest.approx(rows[1][-1], abs=1e-9)


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
    slow, fast, short = (
        [env.step(ZERO)[4] for _ in range(12)]
        for env in (
            at_the_goal(plain_id), at_the_goal(plain_id, qd=(0.5, 0.0, 0.0, 0.0)),
            at_the_goal(plain_id, parameters={"hold_steps": 3}),
        )
    )  # fmt: skip
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
    names = ("far", "near", "precise", "effort", "settle", "rate", "end")
    assert set(terms) == {f"return_{t}" for t in names}
    assert sum(terms.values()) == pytest.approx(total + reward, abs=1e-9)
    assert info["episode_steps"] == 100
    assert at_the_goal(plain_id).step(ZERO)[1] == pytest.approx(1.0, abs=1e-9)
    assert at_the_goal(plain_id, 0.9).step(ZERO)[1] < 0.9


def test_every_reward_term_lies_between_nothing_and_its_weight(plain_id):
    env = running("next_step", plain_id, 64, info_keys="all")
    rng = np.random.default_rng(0)
    for _ in range(30):
        env.reset(options={"qd": 10.0 ** rng.uniform(-2, 1.5, (64, 4))})
        *_, infos = env.step(rng.choice([-1.0, 1.0], (64, 4)).astype(np.float32))
        going = infos["numerics"] == 0
        terms = {k: v[going] for k, v in infos.items() if k.startswith("return_") and k != "return_end"}
        assert all((v >= 0.0).all() for v in terms.values())
        assert (sum(terms.values()) <= 1.0).all()


@pytest.mark.long
def test_goal_environments_pay_one_at_the_goal_and_nothing_elsewhere(goal_id):
    """The reward is exactly compute_reward, of a pair or of many, as hindsight replay calls it."""
    env = made("next_step", goal_id, 8, info_keys="all")
    tips = begin(env, seed=0)["achieved_goal"]
    begin(env, {"goal": tips + 0.001}, seed=0)
    seen, total = set(), 0.0
    for _ in range(100):
        obs, reward, _, _, infos = env.step(np.zeros((8, 4), np.float32))
        goals = obs["achieved_goal"], obs["desired_goal"]
        near = np.linalg.norm(goals[0] - goals[1], axis=1) <= 0.02 * env.core.reach
        np.testing.assert_array_equal(reward, near)
        np.testing.assert_array_equal(reward, env.compute_reward(*goals, {}))
        seen, total = seen | {*reward}, total + reward
    assert seen == {0.0, 1.0}
    assert [k for k in infos if k.startswith("return_")] == ["return_reached"]
    np.testing.assert_array_equal(infos["return_reached"], total)
    single, sb3 = running("single", goal_id), running("sb3", goal_id)
    ones = [single.compute_reward(a, d, {}) for a, d in zip(*goals, strict=True)]
    assert all(isinstance(one, float) for one in ones)
    assert ones == reward.tolist()
    many = sb3.env_method("compute_reward", *goals, [{}] * 8)
    np.testing.assert_array_equal(many, [reward] * 3)


def test_an_early_end_takes_back_what_was_paid_and_says_so(plain_id):
    env = made("single", plain_id, info_keys="all")
    begin(env, seed=0)
    rewards = [env.step(ZERO)[1] for _ in range(5)]
    assert min(rewards) > 0.0
    state, last = env.get_state(), env.q
    env.core.memory.write((env.scene.robot.rates[0],), 150.0)
    obs, reward, terminated, truncated, info = env.step(ZERO)
    assert (terminated, truncated, info["numerics"]) == (True, False, rde.Numerics.SPEED_BOUND)
    assert np.isfinite(obs).all()
    np.testing.assert_array_equal(env.q, last)  # its last good state
    assert sum(rewards) + reward == pytest.approx(0.0, abs=1e-12)
    paid = sum(v for k, v in info.items() if k.startswith("return_") and k != "return_end")
    assert info["return_end"] == pytest.approx(-paid, abs=1e-12)
    env.set_state(state)
    *_, terminated, _, info = env.step(ZERO)
    assert (terminated, info["return_end"]) == (False, 0.0)


def test_goals_follow_the_annulus_given_at_the_reset_and_stay_in_it(face):
    env, inner = running(face), 0.5 if face == "single" else np.array([0.2, 0.4, 0.6])
    begin(env, {"parameters": {"inner": inner, "outer": inner + 0.01, "hold_steps": 5}}, seed=0)
    for _ in range(10):
        radius = np.linalg.norm(np.atleast_2d(env.goal), axis=1) / env.core.reach
        assert ((radius >= inner) & (radius <= inner + 0.01)).all()
        begin(env, {})  # a reset that gives no parameters keeps them
    if face == "next_step":
        begin(env, {"reset_mask": np.array([False, True, False]), "parameters": {}})
        np.testing.assert_array_equal(env.core.memory.read(("inner",))[:, 0], [0.2, 0.1, 0.6])
    begin(env, {"parameters": {}})
    assert (env.core.memory.read(("inner", "outer")) == (0.1, 0.95)).all()


def test_a_reset_with_them_gives_the_bits_of_an_environment_made_with_them():
    numbers = {"goal_tolerance": 0.1, "hold_speed": 0.5, "rate_scale": 2.0, "outer": 0.6}
    one, other = made("single", task=numbers), made("single")
    np.testing.assert_array_equal(begin(one, seed=4), begin(other, {"parameters": numbers}, seed=4))
    assert motion(one) == motion(other)


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


@pytest.mark.quick("single")
def test_a_scene_that_says_nothing_is_standard_and_one_that_does_is_kept(face):
    data = rde.load_scene("four_r_reach").to_dict()
    bare = {k: v for k, v in data.items() if k not in ("integrator", "substeps", "tolerance")}
    for kwargs, tolerance in (
        ({}, 1e-6), ({"accuracy": "exact"}, 1e-12), ({"scene": bare}, 1e-6),
        ({"scene": bare, "accuracy": 1e-8}, 1e-8),
        ({"scene": {**bare, "integrator": "rk4", "substeps": 2}}, None),
    ):  # fmt: skip
        env = made(face, FOUR_R, **kwargs)
        assert env.scene.tolerance == tolerance
        assert ("error_estimate" in env.core.columns.names) == (tolerance is not None)
