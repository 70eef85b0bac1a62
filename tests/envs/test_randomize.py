"""Numbers that every episode draws: their distributions, whose draws they are, how faces show them."""

import copy
import dataclasses
import hashlib
import json
from statistics import NormalDist

import gymnasium as gym
import numpy as np
import pytest
import yaml
from catalogue import SCENES, assert_same_bits
from faces import FOUR_R, ID, MODES, actions, begin, flat, made, motion, parts, refused, running
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.scenes.ranges import ranges
from redundant_envs.simulator.batch.environment import philox

GOAL = "redundant_envs/FourRGoalReach-v0"
TASK = {"goal_tolerance": {"uniform": [0.01, 0.03]}, "hold_steps": {"choice": [3, 5, 8]}}
RANGES = {
    "masses": {"scale": {"log_uniform": [0.8, 1.25]}, "shared": True},
    "lengths": {"scale": {"uniform": [0.9, 1.1]}},
    "gravity.g": {"normal": [9.81, 0.3], "within": [9.0, 10.0]},
    "viscous_friction.coefficients": {"choice": [0.05, 0.1, 0.3]},
    **TASK,
}
OF_GOALS = {name: RANGES[name] for name in ("masses", "gravity.g", "viscous_friction.coefficients")}
STOPS = {
    "prismatic_stop.lower": {"uniform": [-0.05, 0.05]}, "prismatic_stop.upper": {"uniform": [0.2, 0.3]},
    "masses": {"uniform": [0.3, 0.8]},
}  # fmt: skip


def scene(randomize=RANGES, name="four_r_reach"):
    return {**rde.load_scene(name).to_dict(), "randomize": randomize}


def drawn(env, numbers=None):
    """Present numbers that episodes draw, by name."""
    return {one.name: env.parameters[one.name].value for one in numbers or env.scene.randomize}


def of_lane(numbers, lane):
    return {name: value[lane] for name, value in numbers.items()}


def assert_equal_numbers(some, others):
    assert some.keys() == others.keys()
    for name, value in some.items():
        np.testing.assert_array_equal(value, others[name])


# ---- distributions ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def many():
    """Numbers of 20480 episodes: 4096 environments, begun 5 times."""
    env = made("next_step", FOUR_R, 4096, scene=scene())
    rows = []
    for seed in (0, None, None, None, None):
        env.reset(seed=seed)
        rows.append(drawn(env))
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def assert_uniform(shares, most=4.0):
    """Mean, variance and the greatest distance of the distribution function, within 4 standard errors."""
    n = len(shares)
    assert abs(shares.mean() - 0.5) < most / np.sqrt(12.0 * n)
    assert abs(shares.var() - 1.0 / 12.0) < most / np.sqrt(180.0 * n)
    order = np.sort(shares)
    assert np.abs(order - (np.arange(n) + 0.5) / n).max() < 2.0 / np.sqrt(n)


@pytest.mark.long
def test_uniform_factors_are_uniform_and_those_of_the_entries_independent(many):
    factors = many["lengths"] / 0.25
    assert factors.min() >= 0.9 - 1e-15
    assert factors.max() <= 1.1 + 1e-15
    for column in factors.T:
        assert_uniform((column - 0.9) / 0.2)
    others = np.corrcoef(factors.T) - np.eye(4)
    assert np.abs(others).max() < 4.0 / np.sqrt(len(factors))


def test_shared_factors_are_one_factor_whose_logarithm_is_uniform(many):
    factors = many["masses"] / 0.5
    assert (factors == factors[:, :1]).all()
    assert_uniform(np.log(factors[:, 0] / 0.8) / np.log(1.25 / 0.8))


def test_a_truncated_normal_number_has_the_shares_of_its_distribution_and_none_lies_at_an_end(many):
    normal = NormalDist(9.81, 0.3)
    below, above = normal.cdf(9.0), normal.cdf(10.0)
    shares = np.array([normal.cdf(g) for g in many["gravity.g"]])
    assert_uniform((shares - below) / (above - below))
    assert many["gravity.g"].min() > 9.0
    assert many["gravity.g"].max() < 10.0


@pytest.mark.parametrize("name", ["viscous_friction.coefficients", "hold_steps"])
def test_the_values_of_a_choice_are_equally_frequent(many, name):
    choices = [0.05, 0.1, 0.3] if "friction" in name else [3.0, 5.0, 8.0]
    values, counts = np.unique(many[name], return_counts=True)
    np.testing.assert_array_equal(values, choices)
    n = counts.sum()
    assert np.abs(counts / n - 1.0 / 3.0).max() < 4.0 * np.sqrt(2.0 / 9.0 / n)


def test_numbers_of_different_ranges_are_independent(many):
    table = np.stack([many[name].reshape(len(many["masses"]), -1)[:, 0] for name in many])
    assert np.abs(np.corrcoef(table) - np.eye(len(table))).max() < 4.0 / np.sqrt(table.shape[1])


# ---- whose draws they are --------------------------------------------------------------------------------


def test_a_number_follows_from_the_seed_and_its_name_by_philox():
    """The second word of the counter has its highest bit, which no draw of an interval has."""
    env = made("single", FOUR_R, scene=scene())
    env.reset(seed=7)
    generator, _ = seeding.np_random(7)
    key = [int(word) for word in generator.bit_generator.random_raw(2).astype("<u8").view("<u4")]
    for one in ranges(RANGES):
        digest = hashlib.sha256(one.name.encode()).digest()
        first = int.from_bytes(digest[:4], "big") // 256 * 256
        second = 2**31 + int.from_bytes(digest[4:8], "big") // 2
        words = philox(key[:2], [first, second, *key[2:]])
        draws = (np.array(words[:1] if one.shared else words) + 0.5) / 2.0**32
        value = one.distribution.formula(draws, *one.distribution.numbers().values())
        found = np.atleast_1d(env.parameters[one.name].value)
        nominal = np.atleast_1d(made("single", FOUR_R).parameters[one.name].value)
        expected = np.broadcast_to(value, found.shape) if len(found) > 1 else value[:1]
        np.testing.assert_allclose(found, one.drawn(expected, nominal), rtol=4e-16)


def test_a_range_changes_no_other_draw_neither_starts_nor_goals():
    one, some, none = (
        running("next_step", FOUR_R, scene=scene(numbers))
        for numbers in (RANGES, {"gravity.g": RANGES["gravity.g"]}, {})
    )
    np.testing.assert_array_equal(one.parameters["gravity.g"].value, some.parameters["gravity.g"].value)
    for env in (one, some, none):
        begin(env, seed=5)
    np.testing.assert_array_equal(one.q, none.q)
    np.testing.assert_array_equal(some.q, none.q)
    np.testing.assert_array_equal(some.goal, none.goal)  # those of others are in units of their lengths
    begin(none, {"parameters": {"lengths": one.parameters["lengths"].value}}, seed=5)
    np.testing.assert_array_equal(one.goal, none.goal)


@pytest.mark.quick("redundant_envs/FourRReach-v0-four_r_reach-numbers0")
@pytest.mark.parametrize(("env_id", "name", "numbers"), [
    (FOUR_R, "four_r_reach", RANGES), (ID, "rprp_reach", STOPS), (GOAL, "four_r_reach", OF_GOALS),
])  # fmt: skip
def test_an_episode_is_that_of_the_fixed_scene_with_these_numbers_to_the_last_bit(env_id, name, numbers):
    """Also all that follows from the numbers, which the compiled reset computes as NumPy does."""
    env = made("next_step", env_id, 11, scene=scene(numbers, name))
    fixed = made("next_step", env_id, 11)
    for seed in (3, None):
        observation = env.reset(seed=seed)[0]
        present = drawn(env)
        assert all(len(np.unique(value)) > 1 for value in present.values())
        assert flat(observation) == flat(fixed.reset(seed=seed, options={"parameters": present})[0])
        for action in actions(env, 5):
            assert flat(env.step(action)[:4]) == flat(fixed.step(action)[:4])


@pytest.mark.parametrize("mode", MODES)
def test_an_environments_numbers_depend_on_its_seed_alone(mode):
    """Not on the number of environments, on threads, or on its place; over several episodes."""
    kwargs = {"scene": scene(), "max_episode_steps": 4}
    table = actions(made(mode, FOUR_R, 41), 11)
    rows = {}
    for count, threads in ((41, 1), (41, 3), (8, 1), (1, 1)):
        env = made(mode, FOUR_R, count, threads=threads, **kwargs)
        env.reset(seed=5)
        rows[count, threads] = []
        for action in table:
            if mode == "disabled" and env._ended.any():
                env.reset(options={"reset_mask": env._ended.copy()})
            env.step(action[:count])
            rows[count, threads].append({**drawn(env), "q": env.q, "goal": env.goal})
    for (count, _), found in rows.items():
        for one, other in zip(found, rows[41, 1], strict=True):
            assert_equal_numbers(one, of_lane(other, slice(count)))
    assert len(np.unique([row["gravity.g"][0] for row in rows[1, 1]])) == 3


def test_a_neighbour_that_options_reset_changes_no_bit_of_a_lane():
    one, other = (running("disabled", FOUR_R, 3, scene=scene()) for _ in range(2))
    one.reset(options={"reset_mask": np.array([False, True, False]), "parameters": {"gravity.g": 1.6}})
    for env in (one, other):
        env.step(actions(env, 1)[0])
    for lane in (0, 2):
        np.testing.assert_array_equal(one.q[lane], other.q[lane])


@pytest.mark.long
def test_what_follows_from_drawn_numbers_has_the_bits_of_numbers_that_options_set():
    """Here also what bounds the mobility of the joints of a chain, with sums of products."""
    numbers = {name: {"scale": {"uniform": [0.5, 2.0]}} for name in ("masses", "lengths")}
    one = dataclasses.replace(SCENES["RRR every effect 1e-6"], randomize=numbers)
    core = Core(one, 40, rde.ReachTask())
    core.begin(np.ones(40, bool), {})
    memory, prepared = core.memory, core.memory.dynamics.parameters.prepared
    found = memory.read(prepared)
    assert "least_step_rate" in prepared
    assert len(np.unique(found[:, prepared.index("least_step_rate")])) == 40
    memory.prepare()
    np.testing.assert_array_equal(found, memory.read(prepared))


def test_options_of_one_lane_leave_all_numbers_of_the_others_as_they_are():
    env = running("disabled", FOUR_R, 3, scene=scene())
    env.core.memory.column("ay")[0, 0] = -7.0  # as if other code had computed it
    env.reset(options={"reset_mask": np.array([False, True, False]), "parameters": {"gravity.g": 1.6}})
    np.testing.assert_array_equal(env.core.memory.column("ay")[0, :2], [-7.0, 1.6])


# ---- options, and fixed numbers --------------------------------------------------------------------------


def test_options_win_and_stay_until_parameters_are_given_again(kind):
    env = made(kind, FOUR_R, scene=scene(), max_episode_steps=3)
    core = getattr(env, "unwrapped", env).core
    face = getattr(env, "unwrapped", env)
    begin(env, {"parameters": {"gravity.g": 1.6, "masses": 2.0, "hold_steps": 4}}, seed=1)
    lengths = face.parameters["lengths"].value
    for _ in range(2):
        for name, value in (("gravity.g", 1.6), ("masses", 2.0), ("hold_steps", 4.0)):
            assert (face.parameters[name].value == value).all()
        assert (np.abs(face.parameters["lengths"].value / 0.25 - 1.0) <= 0.1 + 1e-15).all()
        if kind in ("single", "disabled"):
            begin(env)  # without the option they stay
        else:
            for action in actions(env, 4):
                env.step(action)
    assert not (face.parameters["lengths"].value == lengths).any()
    begin(env, {"parameters": {}})
    assert len(np.unique(face.parameters["gravity.g"].value)) == core.num_envs
    assert (face.parameters["gravity.g"].value >= 9.0).all()


def test_an_option_for_one_entry_fixes_only_that_one():
    env = running("next_step", FOUR_R, 40, scene=scene())
    begin(env, {"parameters": {"viscous_friction.coefficients[1]": 0.7}})
    found = env.parameters["viscous_friction.coefficients"].value
    assert (found[:, 1] == 0.7).all()
    assert {*np.unique(found[:, [0, 2, 3]])} == {0.05, 0.1, 0.3}


def test_without_randomize_environments_have_the_numbers_of_the_scene(kind):
    one = made(kind, FOUR_R, scene=scene(), randomize=False, max_episode_steps=4)
    other = made(kind, FOUR_R, max_episode_steps=4)
    for env in (one, other):
        begin(env, seed=3)
    assert motion(one) == motion(other)
    told = one.reset_infos[0] if kind == "sb3" else one.reset()[1]
    assert "parameters" not in told
    assert getattr(one, "unwrapped", one).scene == rde.Scene.from_dict(scene())


@pytest.mark.parametrize("given", [None, 1, "no", RANGES])
def test_randomize_is_true_or_false(kind, given):
    with pytest.raises(ValueError, match=r"randomize is .*; True draws the ranges of the scene, False"):
        made(kind, FOUR_R, scene=scene(), randomize=given)


@pytest.mark.long
def test_a_start_or_goal_of_options_has_to_be_possible_with_all_that_may_be_drawn():
    env = running("next_step", scene=scene(STOPS, "rprp_reach"))
    refused(env, lambda env: begin(env, {"q": (0.0, 0.25, 0.0, 0.1)}), "stops are at 0.05 and 0.2 m")
    ends = [rde.load_scene("rprp_reach").parameters()[f"prismatic_stop.upper[{k}]"] for k in (0, 1)]
    upper = env.core.reach - sum(end - 0.2 for end in ends) + 1e-9  # travels may end at 0.2
    refused(env, lambda env: begin(env, {"goal": (upper, 0.0)}), "the arm reaches")
    begin(env, {"q": (0.0, 0.25, 0.0, 0.1), "parameters": {"prismatic_stop.upper": 0.3}})
    assert (env.q[:, 1] == 0.25).all()
    for _ in range(20):
        begin(env, {"q": (0.0, 0.2, 0.0, 0.05), "parameters": {}})
        q, low, high = env.q, *(env.parameters[f"prismatic_stop.{end}"].value for end in ("lower", "upper"))
        assert (q[:, [1, 3]] >= low).all()
        assert (q[:, [1, 3]] <= high).all()


# ---- what is shown ---------------------------------------------------------------------------------------


def test_info_has_what_the_episode_has_drawn(kind):
    env = made(kind, FOUR_R, scene=scene(), max_episode_steps=3)
    face = getattr(env, "unwrapped", env)
    if kind == "sb3":
        begin(env, seed=3)
        first = drawn(face)
        for lane, info in enumerate(env.reset_infos):
            assert_equal_numbers(info["parameters"], of_lane(first, lane))
        for action in actions(env, 3):
            infos = env.step(action)[3]
        for lane, (info, after) in enumerate(zip(infos, env.reset_infos, strict=True)):
            assert_equal_numbers(info["parameters"], of_lane(first, lane))  # of the episode that ended
            assert_equal_numbers(after["parameters"], of_lane(drawn(face), lane))
        return
    _, info = env.reset(seed=3)
    first = drawn(face)
    if kind == "single":
        assert_equal_numbers(info["parameters"], first)
        assert_equal_numbers(copy.deepcopy(env.step(actions(face, 1)[0])[4])["parameters"], first)
        return
    told = dict(info)
    assert told["_parameters"].all()
    masks = {name for name in told["parameters"] if name.startswith("_")}
    assert masks == {f"_{name}" for name in first}
    assert_equal_numbers({n: v for n, v in told["parameters"].items() if n not in masks}, first)
    for action in actions(env, 3):
        info = env.step(action)[4]
    last = info["final_info"]["parameters"] if kind == "same_step" else info["parameters"]
    assert_equal_numbers({name: last[name] for name in first}, first)
    now = info["parameters"]
    assert_equal_numbers({name: now[name] for name in first}, drawn(face))
    if kind == "disabled":
        mask = np.array([True, False, True])
        told = env.reset(options={"reset_mask": mask})[1]
        np.testing.assert_array_equal(told["parameters"]["_gravity.g"], mask)
        np.testing.assert_array_equal(told["_parameters"], mask)


OBSERVED = ("gravity.g", "masses", "hold_steps", "effort_limits.limits", "viscous_friction.coefficients[2]")


@pytest.mark.long
def test_observations_end_with_the_numbers_that_are_asked_for(kind):
    env = made(kind, FOUR_R, scene=scene(), observe_parameters=OBSERVED, max_episode_steps=3)
    face, plain = getattr(env, "unwrapped", env), made(kind, FOUR_R, scene=scene(), max_episode_steps=3)
    space = getattr(env, "single_observation_space", env.observation_space)
    low, high = (np.float32(end) for end in ([9.0, *[0.4] * 4, 3.0], [10.0, *[0.625] * 4, 8.0]))
    np.testing.assert_array_equal(space.low[-11:-5], low)
    np.testing.assert_array_equal(space.high[-11:-5], high)
    np.testing.assert_array_equal(space.high[-5:-1], np.inf)  # options may set a number without a range
    assert (space.low[-1], space.high[-1]) == (np.float32(0.05), np.float32(0.3))
    for step in range(5):
        if step == 0:
            observation, other = begin(env, seed=3), begin(plain, seed=3)
        elif kind in ("single", "disabled"):
            observation, other = begin(env), begin(plain)
        else:
            action = actions(env, 1)[0]
            observation, other = env.step(action)[0], plain.step(action)[0]
        found = {name: np.asarray(p.value) for name, p in face.parameters.items()}
        if kind == "single":
            found = {name: value[None] for name, value in found.items()}
        found["viscous_friction.coefficients[2]"] = found["viscous_friction.coefficients"][:, 2]
        rows = np.column_stack([found[name] for name in OBSERVED])
        rows = rows[0] if kind == "single" else rows
        np.testing.assert_array_equal(observation[..., -11:], rows.astype(np.float32))
        np.testing.assert_array_equal(observation[..., :-11], other)
        assert env.observation_space.contains(observation) or kind == "sb3"


@pytest.mark.long
def test_fixed_numbers_are_observed_too_and_spaces_do_not_depend_on_whether_ranges_are_drawn():
    drawn_or_not = [
        made("single", FOUR_R, scene=scene(), randomize=r, observe_parameters=OBSERVED) for r in (True, False)
    ]
    assert drawn_or_not[0].observation_space == drawn_or_not[1].observation_space
    observation = drawn_or_not[1].reset(seed=0)[0]
    np.testing.assert_array_equal(observation[-11:], np.float32([9.81, *[0.5] * 4, 10, 20, 12, 8, 4, 0.2]))
    env = made("single", FOUR_R, observe_parameters=["gravity.g"])
    assert env.reset(options={"parameters": {"gravity.g": 1.5}})[0][-1] == 1.5


def test_goal_environments_observe_them_beside_the_goals():
    env = made("sb3", GOAL, scene=scene(OF_GOALS), observe_parameters=("gravity.g",))
    observation = begin(env, seed=1)
    np.testing.assert_array_equal(
        observation["observation"][:, -1], np.float32(env.parameters["gravity.g"].value)
    )
    assert env.observation_space["observation"].high[-1] == 10.0


NOT_OBSERVED = {
    "a text": ("gravity.g", "observe_parameters is 'gravity.g'; give names"),
    "a set, whose order differs from process to process": ({"gravity.g"}, "is {'gravity.g'}; give names"),
    "a number": (3, "observe_parameters is 3; give names"),
    "an unknown name": (
        ("gravity.x",),
        "unknown name: parameter is 'gravity.x'; this scene has masses, .*hold_steps",
    ),
    "no name": ((3,), "unknown name: parameter is 3; this scene has"),
    "one twice": (("masses", "masses"), "observe_parameters has m1 twice"),
}


@pytest.mark.parametrize("name", NOT_OBSERVED)
def test_names_that_no_observation_shows(kind, name):
    given, words = NOT_OBSERVED[name]
    with pytest.raises(ValueError, match=words):
        made(kind, FOUR_R, observe_parameters=given)


def test_a_side_without_a_stop_has_no_number_to_observe():
    data = rde.load_scene("rprp_reach").to_dict()
    stop = next(e for e in data["effects"] if e["type"] == "PrismaticStop")
    springs = [{"type": "LimitSpring", "coordinate": r, "lower": 0.0, "upper": 0.3} for r in ("r1", "r2")]
    stop["lower"] = [None, 0.0]
    with pytest.raises(ValueError, match=r"prismatic_stop.lower\[0\] is -inf, as where there is no stop"):
        made(
            "single",
            scene={**data, "effects": [*data["effects"], *springs]},
            observe_parameters=("prismatic_stop.lower",),
        )


# ---- what an environment refuses -------------------------------------------------------------------------

REFUSED = {
    "a number that neither scene nor task has": (
        FOUR_R, {"hold_step": {"choice": [1]}}, "unknown name: parameter is 'hold_step'; this scene has",
    ),
    "ends that the task refuses": (
        FOUR_R, {"goal_tolerance": {"uniform": [-1, 1]}}, "goal_tolerance is -1.0; it must be positive",
    ),
    "numbers that are not whole": (FOUR_R, {"hold_steps": {"uniform": [1, 9]}}, "give a whole number"),
    "a value that is not whole": (FOUR_R, {"hold_steps": {"choice": [1, 4.5, 9]}}, "give a whole number"),
    "ends that cross": (
        FOUR_R, {"inner": {"uniform": [0.1, 0.6]}, "outer": {"uniform": [0.5, 0.9]}},
        "inner is 0.6, outer is 0.5; inner must be below",
    ),
    "numbers of the reward of goals": (GOAL, TASK, "goal environments keep goal_tolerance, because"),
    "lengths in the reward of goals": (
        GOAL, {"lengths": RANGES["lengths"]}, "goal environments keep lengths and travel",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_ranges_that_the_task_of_an_environment_refuses(kind, name):
    env_id, numbers, words = REFUSED[name]
    with pytest.raises(ValueError, match=words):
        made(kind, env_id, scene=scene(numbers))


# ---- copies, states, specs, files ------------------------------------------------------------------------


@pytest.mark.quick("single-deepcopy")
def test_copies_go_on_to_the_same_bits(kind, way):
    env = made(kind, FOUR_R, scene=scene(), observe_parameters=OBSERVED, max_episode_steps=4)
    begin(env, {"parameters": {"hold_steps": 4}}, seed=3)
    other = way(env)
    assert_equal_numbers(drawn(getattr(env, "unwrapped", env)), drawn(getattr(other, "unwrapped", other)))
    assert motion(env) == motion(other)


def test_a_state_brings_back_numbers_ranges_and_what_options_fixed(kind):
    env = running(kind, FOUR_R, scene=scene())
    begin(env, {"parameters": {"hold_steps": 4}}, seed=3)
    state, before = env.get_state(), drawn(env)
    first = motion(env)
    begin(env, {"parameters": {}}, seed=8)
    env.set_state(state)
    assert_equal_numbers(drawn(env), before)
    assert motion(env) == first
    assert (env.parameters["hold_steps"].value == 4.0).all()


@pytest.mark.long
def test_lanes_that_are_alike_in_a_state_draw_numbers_of_their_own_after_it():
    env = running("next_step", FOUR_R, 8, scene=scene({"gravity.g": RANGES["gravity.g"]}))
    begin(env, {"parameters": {"gravity.g": 9.5}}, seed=3)
    env.set_state(env.get_state())
    begin(env, {"parameters": {}}, seed=3)
    assert len(np.unique(env.parameters["gravity.g"].value)) == 8


@pytest.mark.long
def test_a_state_with_another_range_is_refused():
    env = running("next_step", FOUR_R, scene=scene())
    other = running("next_step", FOUR_R, scene=scene({**RANGES, "gravity.g": {"uniform": [9, 10]}}))
    refused(env, lambda env: env.set_state(other.get_state()), "is of another scene: randomize.gravity.g")
    state = env.get_state()
    row = env.core.memory.layout.row_of("low of gravity.g")[1]
    blocks = state["parameters"].reshape(env.core.memory.arrays["parameter"].shape)
    blocks[0, row] = 5.0
    refused(env, lambda env: env.set_state(state), "low of gravity.g 5, this one 9")
    assert parts(env)


def test_a_spec_is_json_and_makes_the_same_environment(tmp_path):
    env = gym.make(FOUR_R, scene=scene(), observe_parameters=OBSERVED)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert json.loads(env.spec.to_json())["kwargs"]["scene"]["randomize"]["gravity.g"] == RANGES["gravity.g"]
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(scene()))
    of_file = gym.make(FOUR_R, scene=str(file), observe_parameters=OBSERVED)
    assert_same_bits(*zip(*((e.reset(seed=4)[0],) * 2 for e in (env, again)), strict=True))
    assert_same_bits([env.reset(seed=4)[0]], [of_file.reset(seed=4)[0]])


@pytest.mark.long
@pytest.mark.parametrize("kind", ["next_step", "sb3"])
def test_the_checker_of_vectors_finds_nothing(kind):
    rde.check_vec_env(made(kind, FOUR_R, scene=scene(), observe_parameters=("gravity.g", "masses")))


def test_other_ranges_of_the_same_kinds_compile_nothing_anew():
    other = {**RANGES, "gravity.g": {"normal": [5.0, 2.0], "within": [1.0, 8.0]}}
    identities = {made("single", FOUR_R, scene=scene(r)).core.simulator.identity for r in (RANGES, other)}
    assert len(identities) == 1
