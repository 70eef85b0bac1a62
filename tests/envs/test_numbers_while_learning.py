"""Numbers, starts and goals that are set between resets: each environment's next episode has them, whatever
begins it; what could have no effect is refused."""

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, MODES, actions, begin, flat, made, refused, running
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3.common.vec_env import DummyVecEnv

SHORT = 3
"""Control steps of an episode."""
NEW = {"parameters": {"goal_tolerance": 0.2}}
OF_VECTORS = {
    "set_attr": lambda env: env.set_attr("goal_tolerance", 0.2),
    "a list": lambda env: env.set_attr("goal_tolerance", [0.2] * env.num_envs),
    "call": lambda env: env.call("set_options", NEW),
    "attribute": lambda env: setattr(env, "goal_tolerance", 0.2),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("way", OF_VECTORS.values(), ids=OF_VECTORS)
def test_numbers_of_vectors_change_with_each_environments_next_episode(way, mode):
    env = RecordEpisodeStatistics(made(mode, FOUR_R, max_episode_steps=SHORT))
    inner = env.unwrapped
    env.reset(seed=0)
    for step, action in enumerate(actions(inner, 2 * SHORT)):
        if step == 1:
            inner.reset(options={"reset_mask": np.array([True, False, False])})  # begins before the change
            way(inner)
        ended = np.any(env.step(action)[2:4], axis=0)
        if mode == "disabled" and ended.any():
            env.reset(options={"reset_mask": ended})
        begins = {"next_step": SHORT, "same_step": SHORT - 1, "disabled": SHORT - 1}[mode]
        expected = [0.2 if step >= begins + own else 0.02 for own in (1, 0, 0)]
        assert [*env.unwrapped.get_attr("goal_tolerance")] == expected


@pytest.mark.parametrize("kind", ["next_step", "same_step", "sb3"])
def test_an_episode_of_an_autoreset_is_that_of_a_reset_with_the_same_options(kind):
    """Key, draws, observation and motion are the same; the step that ended keeps its own outputs."""
    given = {"q": (0.1, 0.2, 0.3, 0.4), "goal": (0.3, 0.2), "parameters": {"masses": (0.4, 0.5, 0.6, 0.7)}}
    env, plain, again = (made(kind, FOUR_R, max_episode_steps=SHORT, info_keys="all") for _ in range(3))
    for one in (env, plain):
        begin(one, seed=4)
    begin(again, given, seed=0)
    env.set_options(given)
    ends = SHORT if kind == "next_step" else SHORT - 1
    for step, action in enumerate(actions(env, ends + SHORT)):
        result, usual = env.step(action), plain.step(action)
        if step < ends:
            assert flat(result) == flat(usual)
        elif step == ends:
            assert flat(result[1:3]) == flat(usual[1:3])  # of the episode that ended, or of none
            np.testing.assert_array_equal(result[0], again.core.observe()[0])
        else:
            assert flat(result[:2]) == flat(again.step(action)[:2])
    for action in actions(env, 2):  # a start and a goal are those of one episode, parameters stay
        env.step(action)
    assert (env.goal != given["goal"]).any(axis=1).all()
    np.testing.assert_array_equal(env.parameters["masses"].value, [given["parameters"]["masses"]] * 3)


def test_options_wait_for_one_episode_and_parameters_stay(face):
    env = running(face, FOUR_R)
    env.set_options({"goal": (0.1, 0.2), "parameters": {"gravity.g": 1.0}})
    env.goal_tolerance = 0.3  # joins what waits
    env.set_options({"qd": (1.0, 0.0, 0.0, 0.0)})
    assert np.unique(env.parameters["goal_tolerance"].value) == [0.02]
    env.reset()
    assert (env.goal == (0.1, 0.2)).all()
    assert (env.qd == (1.0, 0.0, 0.0, 0.0)).all()
    env.reset()
    assert (env.goal != (0.1, 0.2)).any()
    for name, value in {"gravity.g": 1.0, "goal_tolerance": 0.3}.items():
        assert np.unique(env.parameters[name].value) == [value]
    env.set_options({"parameters": {"gravity.g": 2.0}})  # parameters replace all others, as in a reset
    env.reset()
    assert np.unique(env.parameters["goal_tolerance"].value) == [0.02]
    env.set_options({"goal": (0.1, 0.2)})
    env.set_options({})  # forgets what waits
    env.reset()
    assert (env.goal != (0.1, 0.2)).any()


def test_the_options_of_a_reset_replace_those_of_the_same_name_that_wait():
    env = running("next_step", FOUR_R)
    env.set_options({"goal": (0.1, 0.2), "q": (0.1, 0.2, 0.3, 0.4)})
    env.reset(options={"goal": (0.2, 0.1), "reset_mask": np.array([True, False, True])})
    np.testing.assert_array_equal(env.goal[[0, 2]], [(0.2, 0.1)] * 2)
    np.testing.assert_array_equal(env.q[[0, 2]], [(0.1, 0.2, 0.3, 0.4)] * 2)
    env.reset()
    np.testing.assert_array_equal(env.goal == (0.1, 0.2), [[False] * 2, [True] * 2, [False] * 2])


def test_some_environments_of_stable_baselines3_alone():
    env = running("sb3", FOUR_R, 4)
    env.env_method("set_options", {"goal": [(0.1, 0.2), (0.3, 0.1)]}, indices=[2, 0])
    env.set_attr("gravity.g", 3.0, [1])
    env.set_attr("masses[3]", 0.9, [1, 3])
    env.reset()
    np.testing.assert_array_equal(env.goal[[2, 0]], [(0.1, 0.2), (0.3, 0.1)])
    assert env.get_attr("gravity.g") == [9.81, 3.0, 9.81, 9.81]
    assert env.get_attr("m4") == [0.5, 0.9, 0.5, 0.9]


def test_single_environments_in_vectors_of_others_take_them():
    dummy = DummyVecEnv([lambda: gym.make(FOUR_R)])
    sync = gym.vector.SyncVectorEnv([lambda: gym.make(FOUR_R)] * 2)
    dummy.env_method("set_options", NEW)
    sync.set_attr("goal_tolerance", [0.1, 0.2])
    assert sync.get_attr("goal_tolerance") == (0.02, 0.02)
    dummy.reset()
    sync.reset()
    assert dummy.get_attr("goal_tolerance") == [0.2]
    assert sync.get_attr("goal_tolerance") == (0.1, 0.2)


REFUSED = {
    "an unknown name": ("goal_tolerence", 0.1, "'goal_tolerence'.* no effect.* goal_tolerance"),
    "a start": ("q", (0.0,) * 4, "'q'.*set_options"),
    "a mapping": ("parameters", {"goal_tolerance": 0.2}, "set_options"),
    "what follows from the scene": ("num_masses", 3, "no effect"),
    "a bad value": ("goal_tolerance", -1.0, "goal_tolerance is -1.0; it must be positive"),
    "a bad choice": ("on_bad_action", "nothing", "choose 'raise' or 'terminate'"),
    "a bad mode": ("render_mode", "ansi", "choose None or 'rgb_array'"),
    "a space": ("action_space", None, "'action_space'.* no effect"),
}


@pytest.mark.parametrize("kind", ["next_step", "sb3"])
@pytest.mark.parametrize(("name", "value", "words"), REFUSED.values(), ids=REFUSED)
def test_what_can_have_no_effect_is_refused(kind, name, value, words):
    env = running(kind, FOUR_R)
    refused(env, lambda env: env.set_attr(name, value), words)
    assert not env.core.waiting_options


SET = {
    "attribute": lambda env, name: setattr(env.unwrapped, name, True),
    "set_attr": lambda env, name: env.unwrapped.set_attr(name, True),
    "set_wrapper_attr": lambda env, name: env.set_wrapper_attr(name, True),
}
WAYS = {"single": ("attribute", "set_wrapper_attr"), "next_step": ("attribute", "set_attr")}
OF_MAKE = (
    "scene", "task", "terminate_on_touch", "decide_every", "info_keys", "max_episode_steps", "render_width",
    "autoreset_mode", "start_angle", "hold_steps",
)  # fmt: skip
"""Arguments, and numbers that mean nothing in the task."""


@pytest.mark.quick("terminate_on_touch-single", "decide_every-next_step", "scene-sb3")
@pytest.mark.parametrize("kind", ["single", "next_step", "sb3"])
@pytest.mark.parametrize("name", OF_MAKE)
def test_arguments_are_refused_in_every_way_to_set_them(kind, name):
    env = made(kind, "redundant_envs/FourRTrackAround-v0", max_episode_steps=SHORT)
    begin(env, seed=3)
    messages = set()
    for way in WAYS.get(kind, WAYS["next_step"]):
        with pytest.raises(ValueError, match=rf"'{name}'.* no effect; make another environment") as error:
            SET[way](env, name)
        messages.add(str(error.value))
        assert not any(vars(one).get(name) is True for one in (env, env.unwrapped))
    assert len(messages) == 1
    env.unwrapped.of_a_library = 3
    assert env.unwrapped.of_a_library == 3


@pytest.mark.parametrize("name", ["on_bad_action", "render_mode"])
def test_attributes_of_all_have_valid_choices_alone(face, name):
    refused(running(face, FOUR_R), lambda env: setattr(env, name, "ansi"), f"{name} is 'ansi'; choose ")
