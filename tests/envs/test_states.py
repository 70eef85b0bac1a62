"""States and resets that are refused: by name, and nothing changes."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from faces import ID, every_face, plain, sb3, single, vector

import redundant_envs as rde

SCENE = rde.load_scene("rprp_reach").to_dict()


def changed(**changes):
    return {"scene": {**SCENE, **changes}}


def with_effect(kind, **numbers):
    return changed(effects=[{**x, **numbers} if x["type"] == kind else x for x in SCENE["effects"]])


OTHERS = {
    "tolerance is 1e-12 there and 1e-06 here": {"accuracy": "exact"},
    "tolerance is 0.0001 there": {"accuracy": 1e-4},
    "control_dt is 0.01 there and 0.02 here": changed(control_dt=0.01),
    "masses": changed(robot={**SCENE["robot"], "masses": [1.0, 0.5, 0.3, 0.1]}),
    "effects": with_effect("Gravity", g=1.6),
    "restitution is 0.5 there": with_effect("PrismaticStop", restitution=0.5),
    "tolerance is None there": changed(tolerance=None, substeps=2),
    "task.goal_tolerance is 0.05 there and 0.02 here": {"task": {"goal_tolerance": 0.05}},
    "task.speed_bound is 20": {"task": {"speed_bound": 20.0}},
    "max_episode_steps is 50.0 there": {"max_episode_steps": 50},
    "of another scene": {"id": "redundant_envs/FourRReach-v0"},
    "goal_conditioned|another scene": {"id": "redundant_envs/RPRPGoalReach-v0"},
}


@every_face
@pytest.mark.parametrize(("words", "kwargs"), OTHERS.items(), ids=OTHERS)
def test_a_state_of_another_scene_is_refused_by_name_and_changes_nothing(make, words, kwargs):
    if make is single and "max_episode_steps" in kwargs:
        return  # there the limit is a wrapper's
    env, other = make(), make(**kwargs)
    before = plain(env.get_state())
    with pytest.raises(ValueError, match=words):
        env.set_state(other.get_state())
    with pytest.raises(ValueError, match="another scene"):
        other.set_state(env.get_state())
    assert plain(env.get_state()) == before


def test_a_state_of_another_face_is_refused():
    envs = [single(), vector(1), sb3(1), vector(2)]
    for a in envs:
        for b in envs:
            if a is not b:
                with pytest.raises(ValueError, match="state"):
                    a.set_state(b.get_state())
    for mode in ("same_step", "disabled"):
        with pytest.raises(ValueError, match=f"autoreset_mode '{mode}' and this one 'next_step'"):
            vector().set_state(vector(autoreset_mode=mode).get_state())


def without(state, key):
    return {k: v for k, v in state.items() if k != key}


CHANGES = {
    r"a float": lambda s: 0.5,
    r"a NoneType": lambda s: None,
    r"unknown keys more": lambda s: {**s, "more": 1},
    r"\['simulator'\] is": lambda s: {**s, "simulator": "0123"},
    r"of a version before": lambda s: {**without(without(s, "states"), "parameters"), "numbers": s["states"]},
    r"\['states'\] is 0.5": lambda s: {**s, "states": 0.5},
    r"\['states'\] has shape \(5,\)": lambda s: {**s, "states": s["states"][:5]},
    r"\['states'\] has shape .* float32": lambda s: {**s, "states": s["states"].astype(np.float32)},
    r"\['states'\] has a .* not finite": lambda s: {**s, "states": s["states"] + np.nan},
    r"\['parameters'\] is 0.5": lambda s: {**s, "parameters": 0.5},
    r"\['parameters'\] is an array of shape \(5,\)": lambda s: {**s, "parameters": s["parameters"][:5]},
    r"\['parameters'\] has a .* not finite": lambda s: {**s, "parameters": s["parameters"] + np.nan},
    r"belongs to the scene": lambda s: {**s, "parameters": 2.0 * s["parameters"]},
    r"\['keys'\] has shape \(4,\)": lambda s: {**s, "keys": s["keys"][0]},
    r"\['keys'\] is 7": lambda s: {**s, "keys": 7},
    r"\['keys'\] .*int64": lambda s: {**s, "keys": s["keys"].astype(np.int64)},
    r"\['mask'\] is False": lambda s: {**s, "mask": False},
    r"\['mask'\] has shape": lambda s: {**s, "mask": np.zeros(9, np.uint32)},
    r"\['waiting'\] .*float64": lambda s: {**s, "waiting": s["waiting"].astype(float)},
    r"\['generators'\] must": lambda s: {**s, "generators": []},
    r"\['generators'\] has 5": lambda s: {**s, "generators": [5] * len(s["generators"])},
    r"\['generators'\] must be": lambda s: {**s, "generators": None},
}


@every_face
@pytest.mark.parametrize(("words", "change"), CHANGES.items(), ids=CHANGES)
def test_what_is_no_state_is_refused_and_changes_nothing(make, words, change):
    env = make()
    before = plain(env.get_state())
    with pytest.raises(ValueError, match=f"state.*{words}"):
        env.set_state(change(env.get_state()))
    assert plain(env.get_state()) == before


@every_face
def test_every_part_of_a_state_is_needed(make):
    env = make()
    for key in env.get_state():
        with pytest.raises(ValueError, match=f"state lacks {key}"):
            env.set_state(without(env.get_state(), key))


@pytest.mark.parametrize("ended", [True, np.zeros(2, bool), np.zeros((3, 1), bool), np.zeros(3), [False] * 3])
def test_ended_of_the_wrong_shape_is_refused_and_changes_nothing(ended):
    env = vector()
    before = plain(env.get_state())
    with pytest.raises(ValueError, match=r"state\['ended'\]"):
        env.set_state({**vector().get_state(), "ended": ended})
    assert plain(env.get_state()) == before


@every_face
def test_parameters_of_lanes_are_part_of_a_state(make):
    env = make()
    options = {"parameters": {"masses": (1.0, 0.5, 0.4, 0.3), "prismatic_stop.upper": 0.2}}
    if make is sb3:
        env.set_options(options)
        env.reset()
    else:
        env.reset(options=options)
    state = pickle.loads(pickle.dumps(env.get_state()))
    twin = make()
    twin.set_state(state)
    assert plain(twin.get_state()) == plain(state)
    assert twin.core.memory.read(("m2",))[0, 0] == 0.5
    action = np.full(env.action_space.shape if make is not sb3 else (3, 4), 0.3, np.float32)
    for a, b in zip(env.step(action)[:3], twin.step(action)[:3], strict=True):
        np.testing.assert_array_equal(a, b)


def test_an_environment_of_stable_baselines3_may_begin_with_a_state():
    env, fresh = sb3(), rde.make_sb3(ID, 3)
    fresh.set_state(env.get_state())
    action = np.full((3, 4), 0.3, np.float32)
    np.testing.assert_array_equal(fresh.step(action)[0], env.step(action)[0])


# ---- resets ----------------------------------------------------------------------------------------

BAD_OPTIONS = [
    {"goal": (9.0, 9.0)},
    {"pose": 1},
    {"q": (0.0, 9.0, 0.0, 0.0)},
    {"parameters": {"masses": (1, 1, 1, -1)}},
    {"parameters": {"masses": (1, 1, 1, 1)}, "goal": (9.0, 9.0)},
    {"parameters": 3},
    {"qd": (0.0, np.nan, 0.0, 0.0)},
]


def parts(env):
    """The state that a refused call must not change."""
    spread = plain(env.get_state())
    if isinstance(env, gym.Env):
        spread["np_random"] = plain(env.np_random)
        spread["np_random_seed"] = env.np_random_seed
        assert env.core.generators[0] is env.np_random
    return spread


@pytest.mark.parametrize("options", BAD_OPTIONS, ids=str)
@pytest.mark.parametrize("seed", [None, 8, [8, 9, 10]], ids=str)
@every_face
def test_a_reset_with_bad_options_changes_nothing(make, seed, options):
    env = make()
    if make is single:
        seed = 8 if isinstance(seed, list) else seed
    kwargs = {"seed": seed, "options": options}
    if make is sb3:
        kwargs = {}
        env.seed(8)
        env.set_options([{}, {"parameters": {"masses": 1.0}}, options])
    before = parts(env)
    with pytest.raises(ValueError):
        env.reset(**kwargs)
    assert parts(env) == before


def test_a_partial_reset_with_bad_options_changes_nothing():
    env = vector()
    mask = np.array([True, False, True])
    before = parts(env)
    for options in BAD_OPTIONS:
        with pytest.raises(ValueError):
            env.reset(seed=[5, 6, 7], options={**options, "reset_mask": mask})
    assert parts(env) == before


def test_a_refused_first_reset_leaves_no_seed():
    env = gym.make(ID).unwrapped
    with pytest.raises(ValueError):
        env.reset(seed=4, options={"goal": (9.0, 9.0)})
    assert env._np_random is None
    assert env.core.generators == [None]
    with pytest.raises((ValueError, gym.error.ResetNeeded)):
        env.step(np.zeros(4, np.float32))


def test_bad_options_of_stable_baselines3_are_forgotten_and_seeds_wait_on():
    env, twin = sb3(), sb3()
    env.seed(8)
    env.set_options({"goal": (9.0, 9.0)})
    with pytest.raises(ValueError, match="goal"):
        env.reset()
    twin.seed(8)
    np.testing.assert_array_equal(env.reset(), twin.reset())
    with pytest.raises(ValueError, match="options has 2 entries; give one per environment, 3"):
        env.set_options([{}, {}])


BAD_SEEDS = [1.5, True, np.True_, -1, np.int64(-3), "7", np.float64(2.0), 1j, b"1"]


@every_face
@pytest.mark.parametrize("seed", BAD_SEEDS, ids=repr)
def test_seeds_that_are_no_whole_numbers_are_refused_and_change_nothing(make, seed):
    env = make()
    before = parts(env)
    with pytest.raises(ValueError, match=r"seed is .*whole number of at least 0"):
        env.seed(seed) if make is sb3 else env.reset(seed=seed)
    assert parts(env) == before
    if make is sb3:
        assert env._seeds == [None] * 3


@pytest.mark.parametrize(
    ("seeds", "words"),
    [
        ([1.7, 2, 3], r"seed\[0\] is 1.7"),
        ([1, True, 3], r"seed\[1\] is True"),
        ([1, 2, -3], r"seed\[2\] is -3"),
        ([1, None, "3"], r"seed\[2\] is '3'"),
        ((1, 2), "one per environment, 3"),
        ("123", "seed is '123'"),
        (np.array([1.0, 2.0, 3.0]), r"seed\[0\] is"),
        (np.array([[1, 2, 3]]), "seed has 1 entries"),
        (np.zeros((3, 1), int), r"seed\[0\] is"),
        ({1, 2, 3}, "seed is"),
        ({"a": 1}, "seed is"),
    ],
    ids=str,
)
def test_bad_seeds_of_a_vector_are_refused_by_their_place(seeds, words):
    env = vector()
    before = parts(env)
    with pytest.raises(ValueError, match=words):
        env.reset(seed=seeds)
    assert parts(env) == before


def test_whole_numbers_of_any_kind_are_seeds():
    expected = vector().reset(seed=5)[0]
    for seed in (np.int64(5), np.uint8(5), [5, 6, 7], (5, np.int32(6), 7), np.array([5, 6, 7]), range(5, 8)):
        np.testing.assert_array_equal(vector().reset(seed=seed)[0], expected)
    np.testing.assert_array_equal(single().reset(seed=np.int64(5))[0], expected[0])
    env = sb3()
    env.seed(np.int64(5))
    np.testing.assert_array_equal(env.reset(), expected)
    assert len(env.seed()) == 3
    env.reset()


# ---- steps -----------------------------------------------------------------------------------------


@every_face
def test_a_step_with_a_refused_action_changes_nothing(make):
    kwargs = {} if make is single else {"on_bad_action": "raise"}
    env = make(**kwargs)
    shape = (4,) if make is single else (3, 4)
    before = parts(env)
    for action in (np.zeros(3), np.zeros((2, 4)), np.full(shape, np.nan), np.full(shape, "a"), None):
        with pytest.raises(ValueError):
            env.step(action)
    assert parts(env) == before


def test_refused_actions_are_not_kept_for_the_second_half_of_a_step():
    env = sb3(on_bad_action="raise")
    twin = copy.deepcopy(env)
    good = np.full((3, 4), 0.2, np.float32)
    for e in (env, twin):
        e.step_async(good)
    with pytest.raises(ValueError, match="non-finite"):
        env.step_async(np.full((3, 4), np.nan, np.float32))
    np.testing.assert_array_equal(env.step_wait()[0], twin.step_wait()[0])
