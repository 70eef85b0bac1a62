"""The SB3 environment: attributes, seeds, options, learners."""

import time

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

import redundant_envs as rde


def test_attributes_and_methods():
    env = rde.make_sb3("RPRPReach-v0", 3)
    assert env.get_attr("render_mode") == [None] * 3
    assert env.env_is_wrapped(VecMonitor) == [False] * 3
    assert len(env.env_method("get_state", indices=[0, 2])) == 2
    with pytest.raises(ValueError, match="set_options"):
        env.set_attr("goal", True, indices=[0])
    with pytest.raises(ValueError, match=r"env_id is 'Nope-v0'; valid: redundant_envs/"):
        rde.make_sb3("Nope-v0")


def test_seeds_and_options_are_used_up_by_the_next_reset():
    env = rde.make_sb3("FourRReach-v0", 3)
    env.seed(5)
    first = env.reset()
    env.set_options([{"goal": (0.1, 0.2)}, {}, {"parameters": {"masses": (1, 1, 1, 1)}}])
    env.seed(5)
    second = env.reset()
    np.testing.assert_array_equal(env.core.goals()[0], (0.1, 0.2))
    assert (second[0] != first[0]).any()
    np.testing.assert_array_equal(second[1], first[1])
    third = env.reset()
    assert (third != second).any(axis=1).all()
    assert (env.core.goals()[0] != (0.1, 0.2)).any()


def test_images():
    env = rde.make_sb3("FourRReach-v0", 2, render_mode="rgb_array")
    env.reset()
    assert env.render().size == 2 * 480 * 480 * 3
    assert rde.make_sb3("FourRReach-v0", 2).get_images() == [None, None]


@pytest.mark.parametrize("env_id", ["RPRPReach-v0", "RPRPGoalReach-v0"])
def test_episodes_are_those_that_vec_monitor_counts(env_id):
    own = rde.make_sb3(env_id, 5, max_episode_steps=7)
    other = VecMonitor(rde.make_sb3(env_id, 5, monitor=False, max_episode_steps=7))
    for env in (own, other):
        env.seed(3)
        env.reset()
    rng, ended = np.random.default_rng(0), 0
    begun = time.time()
    for step in range(20):
        actions = rng.uniform(-1, 1, (5, 4)).astype(np.float32)
        if step == 10:
            actions[2] = np.nan  # ends that episode
        (*_, dones, infos), (*_, expected) = own.step(actions), other.step(actions)
        for done, info, theirs in zip(dones, infos, expected, strict=True):
            assert ("episode" in info) == bool(done)
            if done:
                ended += 1
                assert info["episode"]["l"] == theirs["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(float(theirs["episode"]["r"]), abs=2e-6)
                assert 0.0 <= info["episode"]["t"] <= time.time() - begun + 60.0
                assert [type(info["episode"][k]) for k in "rlt"] == [float, int, float]
    assert ended == 11


def test_returns_of_episodes_survive_a_state():
    first, second = (rde.make_sb3("RPRPReach-v0", 2, max_episode_steps=6) for _ in range(2))
    first.reset()
    actions = np.full((2, 4), 0.5, np.float32)
    for _ in range(4):
        first.step(actions)
    second.set_state(first.get_state())
    for _ in range(2):
        ends = [env.step(actions)[3] for env in (first, second)]
    assert [info["episode"]["r"] for info in ends[0]] == [info["episode"]["r"] for info in ends[1]]
    assert [info["episode"]["l"] for info in ends[1]] == [6, 6]


def test_monitoring_can_be_left_out():
    env = rde.make_sb3("RPRPReach-v0", 2, monitor=False, max_episode_steps=1)
    env.reset()
    *_, dones, infos = env.step(np.zeros((2, 4), np.float32))
    assert dones.all()
    assert not any("episode" in info for info in infos)
    assert env.env_is_wrapped(Monitor) == [False, False]
    with pytest.raises(ValueError, match="monitor is 'yes'; give True or False"):
        rde.make_sb3("RPRPReach-v0", 2, monitor="yes")


@pytest.mark.parametrize("env_id", ["RPRPReach-v0", "FourRReach-v0"])
def test_ppo_and_evaluate_policy_run_without_a_warning(env_id):
    env = rde.make_sb3(env_id, 64)
    assert env.env_is_wrapped(Monitor) == [True] * 64
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=256, n_epochs=1, device="cpu", seed=0)
    model.learn(64 * 112)
    assert len(model.ep_info_buffer) == 64  # what rollout/ep_rew_mean is the mean of
    assert max(episode["l"] for episode in model.ep_info_buffer) == 100
    mean, _ = evaluate_policy(model, env, n_eval_episodes=64)
    assert np.isfinite(mean)


def test_sac_with_hindsight_replay_on_a_goal_environment():
    env = rde.make_sb3("FourRGoalReach-v0", 4, max_episode_steps=20)
    model = SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=100, device="cpu"
    )
    model.learn(200)
    sample = model.replay_buffer.sample(64)
    assert set(np.unique(sample.rewards)) <= {0.0, 1.0}
    assert (sample.rewards == 1.0).any()
