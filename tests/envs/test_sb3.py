"""Environments of stable-baselines3: attributes, options, episodes that a monitor counts, learners."""

import numpy as np
import pytest
from faces import FOUR_R, ID, actions, begin, made, running
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor


def test_attributes_are_given_per_environment(env_id):
    env = running("sb3", env_id, 4)
    begin(env, {"parameters": {"gravity.g": [1.0, 2.0, 3.0, 4.0]}})
    for name in ("q", "qd", "tip", "goal"):
        for chosen in (None, [2, 0], 1):
            rows = np.arange(4)[slice(None) if chosen is None else np.atleast_1d(chosen)]
            np.testing.assert_array_equal(env.get_attr(name, indices=chosen), getattr(env, name)[rows])
    found = env.get_attr("parameters", indices=[0, 2])
    assert [p["gravity.g"].value for p in found] == [1.0, 3.0]
    assert found[0]["masses"].value.shape == (4,)
    for name, value in (("q", 0.0), ("parameters", {})):
        with pytest.raises(ValueError, match="set_options"):
            env.set_attr(name, value)
    with pytest.raises(ValueError, match="set_options"):  # all share it
        env.set_attr("on_bad_action", "raise", [0])
    env.set_attr("on_bad_action", "raise")
    assert env.get_attr("on_bad_action") == ["raise"] * 4
    assert env.env_is_wrapped(VecMonitor) == [False] * 4
    assert len(env.env_method("get_state", indices=[0, 2])) == 2
    assert not env.has_attr("nothing_of_that_name")


def test_seeds_and_options_are_used_up_by_the_next_reset_and_replace_each_other():
    env = made("sb3", FOUR_R)
    first = begin(env, seed=5)
    second = begin(env, [{"goal": (0.1, 0.2)}, {}, {}], seed=5)
    np.testing.assert_array_equal(env.goal[0], (0.1, 0.2))
    np.testing.assert_array_equal(second[1:], first[1:])
    assert (env.reset() != second).any(axis=1).all()
    assert (env.goal[0] != (0.1, 0.2)).any()
    env.set_options({"goal": (0.1, 0.2)})
    begin(env, [{"goal": (0.2, 0.1)}, {}, {}])
    assert (env.goal == (0.2, 0.1)).all(axis=1).tolist() == [True, False, False]
    assert (env.goal != (0.1, 0.2)).all()


@pytest.mark.quick(ID)
@pytest.mark.parametrize("env_id", [ID, "redundant_envs/RPRPGoalReach-v0"])
def test_episodes_are_those_that_vec_monitor_counts(env_id):
    own = made("sb3", env_id, 5, max_episode_steps=7)
    other = VecMonitor(made("sb3", env_id, 5, monitor=False, max_episode_steps=7))
    for env in (own, other):
        env.seed(3)
        env.reset()
        assert env.env_is_wrapped(Monitor) == [env is own] * 5
    ended = 0
    for step, action in enumerate(actions(own, 20)):
        if step == 10:
            action[2] = np.nan  # ends that episode
        (*_, dones, infos), (*_, expected) = own.step(action), other.step(action)
        for done, info, theirs in zip(dones, infos, expected, strict=True):
            assert ("episode" in info) == bool(done)
            if done:
                ended += 1
                assert info["episode"]["l"] == theirs["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(float(theirs["episode"]["r"]), abs=2e-6)
                assert info["episode"]["t"] >= 0.0
                assert [type(info["episode"][k]) for k in "rlt"] == [float, int, float]
    assert ended == 11
