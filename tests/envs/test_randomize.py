"""Numbers that every episode draws: whose draws they are, how faces show them, what is refused.

That a distribution has its quantiles is tested in ``tests/test_ranges.py``.
"""

import hashlib

import numpy as np
import pytest
from faces import FOUR_R, ID, MODES, RANGES, actions, begin, drawing, flat, made, motion, refused, running
from gymnasium.utils import seeding

import redundant_envs as rde
from redundant_envs.scenes.ranges import ranges
from redundant_envs.simulator.batch.environment import philox

GOAL = "redundant_envs/FourRGoalReach-v0"
OF_GOALS = {name: RANGES[name] for name in ("masses", "gravity.g", "viscous_friction.coefficients")}
STOPS = {
    "prismatic_stop.lower": {"uniform": [-0.05, 0.05]},
    "prismatic_stop.upper": {"uniform": [0.2, 0.3]},
    "masses": {"uniform": [0.3, 0.8]},
}


def drawn(env):
    """Present numbers that episodes draw, by name."""
    return {one.name: env.unwrapped.parameters[one.name].value for one in env.unwrapped.scene.randomize}


def assert_equal_numbers(some, others, lane=...):
    assert some.keys() == others.keys()
    for name, value in some.items():
        np.testing.assert_array_equal(value, others[name][lane])


def test_a_number_follows_from_the_seed_and_its_name_by_philox():
    """The second word of the counter has its highest bit, which no draw of an interval has."""
    env, plain = (made("single", FOUR_R, **kwargs) for kwargs in ({"scene": drawing()}, {}))
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
        found, nominal = (np.atleast_1d(e.parameters[one.name].value) for e in (env, plain))
        expected = np.broadcast_to(value, found.shape) if len(found) > 1 else value[:1]
        np.testing.assert_allclose(found, one.drawn(expected, nominal), rtol=4e-16)


def test_a_range_changes_no_other_draw_neither_starts_nor_goals():
    one, some, none = (
        running("next_step", FOUR_R, scene=drawing(numbers))
        for numbers in (RANGES, {"gravity.g": RANGES["gravity.g"]}, {})
    )
    np.testing.assert_array_equal(one.parameters["gravity.g"].value, some.parameters["gravity.g"].value)
    for env in (one, some, none):
        begin(env, seed=5)
    np.testing.assert_array_equal(one.q, none.q)
    np.testing.assert_array_equal(some.q, none.q)
    np.testing.assert_array_equal(some.goal, none.goal)  # those of others are in units of their lengths


@pytest.mark.quick("redundant_envs/FourRReach-v0-four_r_reach-numbers0")
@pytest.mark.parametrize(
    ("env_id", "name", "numbers"),
    [(FOUR_R, "four_r_reach", RANGES), (ID, "rprp_reach", STOPS), (GOAL, "four_r_reach", OF_GOALS)],
)
def test_an_episode_is_that_of_the_fixed_scene_with_these_numbers_to_the_last_bit(env_id, name, numbers):
    """Also all that follows from the numbers, which the compiled reset computes as NumPy does."""
    env = made("next_step", env_id, 11, scene=drawing(numbers, name))
    fixed = made("next_step", env_id, 11)
    for seed in (3, None):
        observation = env.reset(seed=seed)[0]
        present = drawn(env)
        assert all(len(np.unique(value)) > 1 for value in present.values())
        assert flat(observation) == flat(fixed.reset(seed=seed, options={"parameters": present})[0])
        for action in actions(env, 5):
            assert flat(env.step(action)[:4]) == flat(fixed.step(action)[:4])


def test_an_environments_numbers_depend_on_its_seed_alone():
    """Not on the number of environments or on threads; over several episodes."""
    rows = {}
    for count, threads in ((41, 1), (41, 3), (1, 1)):
        env = made("next_step", FOUR_R, count, threads=threads, scene=drawing(), max_episode_steps=4)
        env.reset(seed=5)
        rows[count, threads] = []
        for action in actions(made("next_step", FOUR_R, 41), 11):
            env.step(action[:count])
            rows[count, threads].append({**drawn(env), "q": env.q, "goal": env.goal})
    for (count, _), found in rows.items():
        for one, other in zip(found, rows[41, 1], strict=True):
            assert_equal_numbers(one, other, slice(count))
    assert len(np.unique([row["gravity.g"][0] for row in rows[1, 1]])) == 3


def test_options_win_and_stay_until_parameters_are_given_again(face):
    env = made(face, FOUR_R, scene=drawing())
    given = {"gravity.g": 1.6, "masses": 2.0, "viscous_friction.coefficients[1]": 0.7}
    begin(env, {"parameters": given}, seed=1)
    first = drawn(env)
    begin(env)  # without the option they stay
    for numbers in (first, drawn(env)):
        assert (numbers["gravity.g"] == 1.6).all()
        assert (numbers["masses"] == 2.0).all()
        friction = np.atleast_2d(numbers["viscous_friction.coefficients"])
        assert (friction[:, 1] == 0.7).all()
        assert {*friction[:, [0, 2, 3]].ravel()} <= {0.05, 0.1, 0.3}  # the other entries are drawn
    assert (first["lengths"] != drawn(env)["lengths"]).all()
    begin(env, {"parameters": {}})
    assert (drawn(env)["gravity.g"] >= 9.0).all()


def test_without_randomize_environments_have_the_numbers_of_the_scene(kind):
    one = made(kind, FOUR_R, scene=drawing(), randomize=False, max_episode_steps=4)
    other = made(kind, FOUR_R, max_episode_steps=4)
    for env in (one, other):
        begin(env, seed=3)
    assert motion(one) == motion(other)
    told = one.reset_infos[0] if kind == "sb3" else one.reset()[1]
    assert "parameters" not in told


@pytest.mark.long
def test_a_start_or_goal_of_options_has_to_be_possible_with_all_that_may_be_drawn():
    env = running("next_step", scene=drawing(STOPS, "rprp_reach"))
    refused(env, lambda env: begin(env, {"q": (0.0, 0.25, 0.0, 0.1)}), "stops are at 0.05 and 0.2 m")
    ends = [rde.load_scene("rprp_reach").parameters()[f"prismatic_stop.upper[{k}]"] for k in (0, 1)]
    upper = env.core.reach - sum(end - 0.2 for end in ends) + 1e-9  # travels may end at 0.2
    refused(env, lambda env: begin(env, {"goal": (upper, 0.0)}), "the arm reaches")
    begin(env, {"q": (0.0, 0.25, 0.0, 0.1), "parameters": {"prismatic_stop.upper": 0.3}})
    assert (env.q[:, 1] == 0.25).all()


def test_infos_of_single_environments_and_of_sb3_have_what_their_episodes_have_drawn():
    env = made("single", FOUR_R, scene=drawing())
    for info in (env.reset(seed=3)[1], env.step(actions(env, 1)[0])[4]):
        assert_equal_numbers(info["parameters"], drawn(env))
    env = made("sb3", FOUR_R, scene=drawing(), max_episode_steps=3)
    begin(env, seed=3)
    first = drawn(env)
    for lane, info in enumerate(env.reset_infos):
        assert_equal_numbers(info["parameters"], first, lane)
    for action in actions(env, 3):
        infos = env.step(action)[3]
    for lane, (info, after) in enumerate(zip(infos, env.reset_infos, strict=True)):
        assert_equal_numbers(info["parameters"], first, lane)  # of the episode that ended
        assert_equal_numbers(after["parameters"], drawn(env), lane)


@pytest.mark.parametrize("mode", MODES)
def test_infos_of_a_vector_have_what_the_episodes_have_drawn_with_masks(mode):
    env = made(mode, FOUR_R, scene=drawing(), max_episode_steps=3)
    _, info = env.reset(seed=3)
    first = drawn(env)
    assert {*info["parameters"]} == {*first, *(f"_{name}" for name in first)}
    for action in actions(env, 3):
        info = env.step(action)[4]
    last = info["final_info"]["parameters"] if mode == "same_step" else info["parameters"]
    assert_equal_numbers({name: last[name] for name in first}, first)
    assert_equal_numbers({name: info["parameters"][name] for name in first}, drawn(env))
    if mode == "disabled":
        mask = np.array([True, False, True])
        told = env.reset(options={"reset_mask": mask})[1]
        np.testing.assert_array_equal(told["parameters"]["_gravity.g"], mask)
        np.testing.assert_array_equal(told["_parameters"], mask)


@pytest.mark.long
def test_observations_end_with_the_numbers_that_are_asked_for(kind):
    asked = ("gravity.g", "masses", "hold_steps", "effort_limits.limits", "viscous_friction.coefficients[2]")
    env = made(kind, FOUR_R, scene=drawing(), observe_parameters=asked)
    plain = made(kind, FOUR_R, scene=drawing())
    space = getattr(env, "single_observation_space", env.observation_space)
    np.testing.assert_array_equal(space.low[-11:-5], np.float32([9.0, *[0.4] * 4, 3.0]))
    np.testing.assert_array_equal(space.high[-11:-5], np.float32([10.0, *[0.625] * 4, 8.0]))
    np.testing.assert_array_equal(space.high[-5:-1], np.inf)  # options may set a number without a range
    lanes = 1 if kind == "single" else 3
    for seed in range(2):
        observation, other = begin(env, seed=seed), begin(plain, seed=seed)
        found = {name: np.reshape(p.value, (lanes, -1)) for name, p in env.unwrapped.parameters.items()}
        found[asked[-1]] = found["viscous_friction.coefficients"][:, [2]]
        rows = np.hstack([found[name] for name in asked]).astype(np.float32)
        np.testing.assert_array_equal(np.atleast_2d(observation)[:, -11:], rows)
        np.testing.assert_array_equal(observation[..., :-11], other)
        action = actions(env, 1)[0]
        np.testing.assert_array_equal(np.atleast_2d(env.step(action)[0])[:, -11:], rows)
    fixed = made(kind, FOUR_R, scene=drawing(), observe_parameters=asked, randomize=False)
    assert fixed.observation_space == env.observation_space
    expected = np.float32([9.81, *[0.5] * 4, 10, 20, 12, 8, 4, 0.2])
    assert (begin(fixed)[..., -11:] == expected).all()


REFUSED = {
    "randomize is None; True draws the ranges of the scene, False": (FOUR_R, {"randomize": None}),
    "observe_parameters is 'gravity.g'; give names": (FOUR_R, {"observe_parameters": "gravity.g"}),
    "parameter is 'gravity.x'; this scene has masses, .*hold_steps": (
        FOUR_R, {"observe_parameters": ("gravity.x",)},
    ),
    "observe_parameters has m1 twice": (FOUR_R, {"observe_parameters": ("masses", "masses")}),
    "unknown name: parameter is 'hold_step'; this scene has": (FOUR_R, {"hold_step": {"choice": [1]}}),
    "goal_tolerance is -1.0; it must be positive": (FOUR_R, {"goal_tolerance": {"uniform": [-1, 1]}}),
    "hold_steps is 4.5; give a whole number": (FOUR_R, {"hold_steps": {"choice": [1, 4.5, 9]}}),
    "inner is 0.6, outer is 0.5; inner must be below": (
        FOUR_R, {"inner": {"uniform": [0.1, 0.6]}, "outer": {"uniform": [0.5, 0.9]}},
    ),
    "'goal_tolerance'; goal environments keep travel": (GOAL, {"goal_tolerance": RANGES["goal_tolerance"]}),
    "goal environments keep travel, lengths": (GOAL, {"lengths": RANGES["lengths"]}),
}  # fmt: skip


@pytest.mark.parametrize(("words", "given"), REFUSED.items(), ids=REFUSED)
def test_numbers_that_no_environment_can_draw_or_show(face, words, given):
    env_id, kwargs = given
    if not {"randomize", "observe_parameters"} & {*kwargs}:
        kwargs = {"scene": drawing(kwargs)}
    with pytest.raises(ValueError, match=words):
        made(face, env_id, **kwargs)


@pytest.mark.parametrize("scene", [None, drawing()], ids=["fixed", "drawing"])
def test_a_lane_that_options_reset_changes_no_number_and_no_bit_of_others(scene):
    given = {} if scene is None else {"scene": scene}
    one, other = (running("disabled", FOUR_R, **given) for _ in range(2))
    for env in (one, other):
        begin(env, {"parameters": {"inner": [0.2, 0.4, 0.6], "gravity.g": [1.0, 2.0, 3.0]}}, seed=5)
    mask = np.array([False, True, False])
    for numbers in ({"gravity.g": 1.6}, {}):
        one.reset(options={"reset_mask": mask, "parameters": numbers})
        np.testing.assert_array_equal(one.parameters["inner"].value, [0.2, 0.1, 0.6])
        np.testing.assert_array_equal(one.parameters["gravity.g"].value[[0, 2]], [1.0, 3.0])
        for env in (one, other):
            env.step(actions(env, 1)[0])
        np.testing.assert_array_equal(one.q[[0, 2]], other.q[[0, 2]])
