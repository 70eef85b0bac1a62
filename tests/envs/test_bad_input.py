"""Errors name the field, the value and what is allowed."""

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.named import RPRPReachVectorEnv

ID = "redundant_envs/RPRPReach-v0"


def made():
    env = gym.make(ID, disable_env_checker=True).unwrapped
    env.reset(seed=0)
    return env


@pytest.mark.filterwarnings("ignore:.*render_mode")  # Gymnasium warns before our error
@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"scene": "nowhere"}, ["scene", "nowhere", "rprp_reach"]),
        ({"scene": 5}, ["scene", "int"]),
        ({"scene": {"robot": {"type": "Delta"}}}, ["robot.type", "Delta", "RPRP"]),
        ({"scene": {"robt": {}}}, ["robt", "robot"]),
        ({"render_mode": "ansi"}, ["render_mode", "ansi"]),
        ({"on_bad_action": "ignore"}, ["on_bad_action", "ignore", "terminate"]),
        ({"task": {"goal_tolerence": 1}}, ["goal_tolerence", "goal_tolerance"]),
        ({"task": {"goal_tolerance": -1}}, ["goal_tolerance", "-1", "positive"]),
    ],
)
def test_bad_keyword_at_make(kwargs, words):
    with pytest.raises(ValueError) as error:
        gym.make(ID, **kwargs)
    for word in words:
        assert word in str(error.value)


def test_unknown_keyword_is_refused():
    with pytest.raises(TypeError, match="efect"):
        gym.make(ID, efects=1)
    with pytest.raises(ValueError, match=r"make_sb3 has no argument 'efects'; valid: scene"):
        rde.make_sb3(ID, 2, efects=1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (5, "options is 5; give a mapping"), ([1], "options is|options has 1 entries"),
        ("q", "options is 'q'"),
        ({5: 1}, "options has the unknown key 5"), ({"q": object()}, "options['q'] is <object"),
        ({"q": "abc"}, "options['q'] is 'abc'; give real numbers"), ({"q": [[1], [1, 2]]}, "options['q'] is"),
        ({"qd": {}}, "options['qd'] is {}"), ({"goal": 1j}, "options['goal'] is 1j; give real numbers"),
        ({"goal": np.array([1j, 0])}, "options['goal'] is"), ({"goal": [10**400, 0]}, "options['goal'] is"),
        ({"parameters": 5}, "parameters is 5; give a mapping"),
        ({"parameters": {5: 1}}, "parameter is 5; this scene has masses"),
        ({"parameters": {"masses": {}}}, "masses is {}; give real numbers"),
        ({"parameters": {"masses": None}}, "masses is None; give real numbers"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("env_id", [ID, "redundant_envs/FourRGoalReach-v0"])
def test_options_of_a_wrong_kind_are_refused_by_name_on_every_face(options, words, env_id):
    def reset_sb3():
        env = rde.make_sb3(env_id, 2)
        env.set_options(options)
        env.reset()

    for reset in (
        lambda: gym.make(env_id).reset(options=options),
        lambda: gym.make_vec(env_id, 2).reset(options=options),
        reset_sb3,
    ):
        with pytest.raises(ValueError) as error:
            reset()
        assert any(word in str(error.value) for word in words.split("|"))
        assert len(str(error.value)) < 300


@pytest.mark.parametrize("duration", ["a", None, [1], 1j, 0, -1.0, float("inf"), float("nan"), 10**400])
def test_a_duration_is_a_positive_number(duration):
    batch = rde.BatchSimulator(rde.load_scene("four_r_free"), 2)
    with pytest.raises(ValueError, match=r"^duration is .* finite and positive"):
        batch.advance_partly(None, duration)


@pytest.mark.parametrize("kind", [float, np.float32, np.float64, np.longdouble])
@pytest.mark.filterwarnings("error")
def test_a_duration_may_be_a_number_of_any_kind(kind):
    batch = rde.BatchSimulator(rde.load_scene("four_r_free"), 2)
    assert not batch.advance_partly(None, kind(0.25)).numerics.any()


@pytest.mark.parametrize("efforts", ["a", 1j, {}, [[1], [1, 2]], np.array([1j] * 4), [10**400] * 4])
def test_efforts_are_real_numbers(efforts):
    batch = rde.BatchSimulator(rde.load_scene("four_r_free"), 2)
    with pytest.raises(ValueError, match=r"^efforts is .*; give real numbers"):
        batch.advance(efforts)


@pytest.mark.parametrize(
    "limit",
    [float("inf"), float("nan"), [1], (3,), "100", 1.5, 0, -2, True, 10**400, {}, np.array([3]), 1j],
    ids=lambda limit: type(limit).__name__,
)
def test_an_episode_limit_is_a_whole_number_on_every_face(limit):
    for make in (
        lambda: gym.make_vec(ID, 2, max_episode_steps=limit),
        lambda: rde.make_sb3(ID, 2, max_episode_steps=limit),
        lambda: RPRPReachVectorEnv("rprp_reach", 2, max_episode_steps=limit),
    ):
        with pytest.raises(ValueError, match=r"^max_episode_steps is .*; give a whole number") as error:
            make()
        assert len(str(error.value)) < 300


@pytest.mark.parametrize("limit", [None, -1, 1, 5.0, np.int64(7), 2**53])
def test_an_episode_limit_may_be_any_whole_number_or_none(limit):
    rde.make_sb3(ID, 2, max_episode_steps=limit).reset()


def scene_with(**robot):
    data = rde.load_scene("rprp_reach").to_dict()
    data["robot"].update(robot)
    return data


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_mass_or_length(value):
    with pytest.raises(ValueError, match=r"masses\[1\] is"):
        rde.Scene.from_dict(scene_with(masses=[1, value, 1, 1]))
    with pytest.raises(ValueError, match=r"lengths\[0\] is"):
        rde.Scene.from_dict(scene_with(lengths=[value, 1]))


def test_unknown_effect_and_effect_field_list_the_valid_ones():
    data = rde.load_scene("rprp_reach").to_dict()
    data["effects"][0] = {"type": "Gravitas"}
    with pytest.raises(ValueError, match=r"effects\[0\].type is 'Gravitas'; valid: .*Gravity"):
        rde.Scene.from_dict(data)
    data["effects"][0] = {"type": "Gravity", "gee": 1}
    with pytest.raises(ValueError, match=r"unknown key 'gee'; valid: g, down"):
        rde.Scene.from_dict(data)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pose": 1}, ["pose", "valid: q, qd, goal"]),
        ({"q": (0, 0.3, 0, 0)}, ["r1", "0.3", "0.25"]),
        ({"q": (0, 0.1, 0)}, ["q", "(3,)", "(4,)"]),
        ({"q": (0, np.nan, 0, 0)}, ["q", "non-finite"]),
        ({"goal": (3.0, 0.0)}, ["goal", "3 m", "reaches 1 m"]),
        ({"parameters": {"mass": 1}}, ["mass", "masses"]),
        ({"parameters": {"gravity.h": 1}}, ["gravity.h", "gravity.g"]),
        ({"parameters": {"masses": (1, 1, 0, 1)}}, ["masses", "0.0", "positive"]),
        ({"parameters": {"masses": (1, 1)}}, ["masses", "(2,)"]),
        ({"parameters": {"m1": -5.0}}, ["m1", "masses"]),
        ({"parameters": {"masses": (1, 1, 1, 1e-13)}}, ["masses", "ratio"]),
        ({"parameters": {"masses": 1e-31}}, ["masses", "1e-31", "1e-30"]),
        ({"parameters": {"effort_limits.limits": (1, 1, -1, 1)}}, ["EffortLimits.limits[2]", "-1"]),
        ({"parameters": {"prismatic_stop.upper": (-3, 1)}}, ["PrismaticStop", "upper", "-3"]),
        ({"parameters": {"prismatic_stop.restitution": 2}}, ["restitution", "0 to 1"]),
        ({"parameters": {"gravity.down": (1, 1)}}, ["Gravity.down", "length"]),
        ({"parameters": 3}, ["parameters", "mapping"]),
        ({"q": (0, 0.24, 0, 0), "parameters": {"prismatic_stop.upper": (0.05, 0.2)}}, ["r1", "0.24", "0.05"]),
        ({"reset_mask": [True]}, ["reset_mask", "vector"]),
    ],
)
def test_bad_reset_options(options, words):
    env = made()
    with pytest.raises(ValueError) as error:
        env.reset(options=options)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("action", "word"),
    [
        (np.zeros(3, np.float32), r"\(3,\)"),
        (np.zeros((1, 4), np.float32), r"\(1, 4\)"),
        (np.array(["a"] * 4), "dtype"),
        (np.array([0, 0, np.nan, 0], np.float32), "non-finite"),
        (np.array([np.inf, 0, 0, 0], np.float32), "non-finite"),
    ],
)
def test_bad_action_raises_in_a_single_environment(action, word):
    with pytest.raises(ValueError, match=word):
        made().step(action)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_refused_action_changes_nothing(bad):
    env, twin = made(), made()
    for e in (env, twin):
        e.reset(seed=3)
    with pytest.raises(ValueError, match="non-finite"):
        env.step(np.array([0, 0, 0, bad], np.float32))
    action = np.array([0.3, -0.1, 0.7, 0.2], np.float32)
    for _ in range(3):
        one, other = env.step(action), twin.step(action)
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:] == other[1:]


def test_bad_action_ends_the_episode_when_asked():
    env = gym.make(ID, on_bad_action="terminate", disable_env_checker=True).unwrapped
    before, _ = env.reset(seed=0)
    obs, _, terminated, _, info = env.step(np.array([np.nan, 0, 0, 0], np.float32))
    assert terminated
    assert info["numerics"] == rde.Numerics.BAD_ACTION
    np.testing.assert_array_equal(obs, before)


def test_bad_action_raises_in_a_vector_when_asked():
    env = gym.make_vec(ID, num_envs=2, on_bad_action="raise")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="non-finite"):
        env.step(np.full((2, 4), np.nan, np.float32))
    with pytest.raises(ValueError, match=r"\(3, 4\)"):
        env.step(np.zeros((3, 4), np.float32))


def test_step_before_reset_and_after_the_end():
    env = gym.make_vec(ID, num_envs=2, autoreset_mode="disabled")
    with pytest.raises(gym.error.ResetNeeded, match="before reset"):
        env.step(np.zeros((2, 4), np.float32))
    env.reset(seed=0)
    for _ in range(100):
        env.step(np.zeros((2, 4), np.float32))
    with pytest.raises(ValueError, match="reset_mask"):
        env.step(np.zeros((2, 4), np.float32))
    obs, _ = env.reset(options={"reset_mask": np.array([True, True])})
    assert np.isfinite(obs).all()


@pytest.mark.parametrize("kwargs", [{"num_envs": 0}, {"num_envs": 2, "autoreset_mode": "sometimes"}])
def test_bad_vector_arguments(kwargs):
    with pytest.raises(ValueError, match=r"(num_envs|autoreset_mode) is"):
        gym.make_vec(ID, **kwargs)


def test_seed_list_must_fit():
    env = gym.make_vec(ID, num_envs=3)
    with pytest.raises(ValueError, match="one per environment, 3"):
        env.reset(seed=[1, 2])


def test_scene_that_is_no_environment():
    with pytest.raises(ValueError, match="EffortLimits"):
        gym.make(ID, scene={"robot": {"type": "FourR", "masses": [1] * 4, "lengths": [1] * 4}})
    data = rde.load_scene("rprp_reach").to_dict()
    data["effects"] = [e for e in data["effects"] if e["type"] != "PrismaticStop"]
    with pytest.raises(ValueError, match=r"'r1'; add a PrismaticStop"):
        gym.make(ID, scene=data)


def test_a_scene_object_is_refused_with_the_fix():
    scene = rde.load_scene("rprp_reach")
    with pytest.raises(ValueError, match="to_dict"):
        gym.make(ID, scene=scene)
    with pytest.raises(ValueError, match="to_dict"):
        gym.make_vec(ID, num_envs=2, scene=scene)


@pytest.mark.parametrize(
    ("achieved", "desired"),
    [(np.zeros((5, 2)), np.zeros((4, 2))), (np.zeros((5, 3)), np.zeros((5, 3))), (np.zeros(3), np.zeros(2))],
)
def test_goals_of_the_wrong_shape(achieved, desired):
    env = gym.make("redundant_envs/FourRGoalReach-v0").unwrapped
    with pytest.raises(ValueError, match="goals have shapes"):
        env.compute_reward(achieved, desired, {})
    assert (env.compute_reward(np.zeros((50_000, 2)), np.zeros(2), {}) == 1.0).all()


def test_goal_environments_keep_their_geometry():
    env = gym.make("redundant_envs/RPRPGoalReach-v0").unwrapped
    for name, value in (("lengths", (0.4, 0.4)), ("prismatic_stop.upper", 0.2)):
        with pytest.raises(ValueError, match="keep lengths and travel"):
            env.reset(options={"parameters": {name: value}})


@pytest.mark.parametrize("value", [0, -2, 2.5, True])
def test_bad_episode_limits(value):
    with pytest.raises(ValueError, match="max_episode_steps is"):
        rde.make_sb3(ID, 2, max_episode_steps=value)


def test_large_finite_actions_saturate():
    rows = []
    for size in (1.0, 1e300, np.longdouble("1e300")):
        env = made()
        rows.append(env.step(np.full(4, size))[0])
    for row in rows[1:]:
        np.testing.assert_array_equal(rows[0], row)


def test_the_action_of_a_lane_that_begins_anew_is_ignored():
    env = gym.make_vec(ID, num_envs=2, on_bad_action="raise", max_episode_steps=3)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros((2, 4), np.float32))
    env.step(np.full((2, 4), np.nan, np.float32))
    with pytest.raises(ValueError, match="non-finite"):
        env.step(np.full((2, 4), np.nan, np.float32))


def test_snapshots_of_another_face_or_scene_are_refused():
    vector = gym.make_vec(ID, num_envs=1)
    vector.reset(seed=0)
    env = made()
    with pytest.raises(ValueError, match="state lacks ended"):
        vector.set_state(env.get_state())
    data = rde.load_scene("rprp_reach").to_dict()
    other = gym.make(ID, scene={**data, "integrator": "rk4", "tolerance": None}).unwrapped
    other.reset(seed=0)
    with pytest.raises(ValueError, match="another scene"):
        env.set_state(other.get_state())


@pytest.mark.parametrize("count", [1, 3, 9])
def test_snapshots_of_another_number_of_environments_change_nothing(count):
    vector, other = gym.make_vec(ID, num_envs=8), gym.make_vec(ID, num_envs=count)
    vector.reset(seed=0)
    other.reset(seed=1)
    before = vector.core.memory.save()
    with pytest.raises(ValueError, match=f"{count} environments.* 8"):
        vector.set_state(other.get_state())
    np.testing.assert_equal(vector.core.memory.save(), before)


def test_a_single_environment_steps_and_renders_only_after_reset():
    env = gym.make(ID, render_mode="rgb_array")
    for call in (lambda: env.step(np.zeros(4, np.float32)), env.render):
        with pytest.raises(gym.error.ResetNeeded, match="before reset"):
            call()
    env.reset(seed=0)
    assert env.render().ndim == 3
    with pytest.raises(ValueError, match="seed"):
        env.reset(seed="now")


def test_sb3_steps_only_after_reset_and_forgets_bad_options():
    env = rde.make_sb3(ID, 2)
    with pytest.raises(gym.error.ResetNeeded, match="before reset"):
        env.step(np.zeros((2, 4), np.float32))
    env.set_options({"reset_mask": 5})
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset()
    assert np.isfinite(env.reset()).all()


def test_simulate_refuses_what_is_not_finite():
    scene = rde.load_scene("four_r_free")
    with pytest.raises(ValueError, match="q or qd has non-finite"):
        rde.simulate(scene, (0, np.nan, 0, 0), (0, 0, 0, 0), [1.0])
    with pytest.raises(ValueError, match="efforts has non-finite"):
        rde.simulate(scene, (0, 0, 0, 0), (0, 0, 0, 0), [1.0], efforts=(np.inf, 0, 0, 0))
