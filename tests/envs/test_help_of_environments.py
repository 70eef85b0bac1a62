"""``help`` of an environment shows its own page and methods, and nothing of the classes below it."""

import pydoc

import gymnasium as gym
import pytest

import redundant_envs  # noqa: F401 - registers the ids


def shown(env):
    return pydoc.render_doc(env, renderer=pydoc.plaintext)


OF_GYMNASIUM = ("get_wrapper_attr", "with-statement", "np_random", "Method resolution order", "Env instance")
METHODS = ("reset(*, seed=None, options=None)", "step(action", "render()", "close()", "set_state(state)")
VALUES = ("q", "qd", "tip", "goal", "scene", "parameters")


@pytest.mark.parametrize("env_id", ["redundant_envs/RPRPReach-v0", "redundant_envs/FourRGoalReach-v0"])
def test_help_of_an_environment_is_its_page(env_id):
    env = gym.make(env_id).unwrapped
    text = shown(env)
    for heading in ("Action Space", "Rewards", "Episode End", "Methods", "Values"):
        assert f"## {heading}" in text
    for words in (*METHODS, *(f"`{name}`" for name in VALUES)):
        assert words in text
    assert "Begin a new episode." in text
    assert "One control step" in text
    assert not [words for words in OF_GYMNASIUM if words in text]
    assert ("compute_reward(achieved_goal, desired_goal, info)" in text) == env.goal_conditioned


def test_help_of_a_vector_has_its_methods_and_where_the_page_is():
    text = shown(gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2).unwrapped)
    assert "help(redundant_envs.envs.named.RPRPReachEnv)" in text
    for words in ("reset(*, seed=None, options=None)", "reset_mask", "step(actions)", "`parameters`"):
        assert words in text
    assert not [words for words in OF_GYMNASIUM if words in text]


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_every_method_and_value_has_text_of_its_own(make):
    env = make("redundant_envs/RPRPReach-v0").unwrapped
    methods = shown(env).partition("## Methods")[2]
    entries = [line for line in methods.splitlines() if line.strip().startswith("* ")]
    assert len(entries) >= 12
    assert not [line for line in entries if line.rstrip().endswith(":")]


def test_the_class_keeps_its_page():
    kind = type(gym.make("redundant_envs/RPRPReach-v0").unwrapped)
    assert kind.__doc__.startswith("A planar revolute-prismatic")
    assert "## Methods" not in kind.__doc__
