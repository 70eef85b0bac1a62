"""The SB3 environment: attributes, seeds, options, learners."""

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
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


@pytest.mark.parametrize("env_id", ["RPRPReach-v0", "FourRReach-v0"])
def test_ppo_and_evaluate_policy_run_without_a_warning(env_id):
    env = VecMonitor(rde.make_sb3(env_id, 64), info_keywords=("is_success",))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=256, n_epochs=1, device="cpu")
    model.learn(2048)
    mean, _ = evaluate_policy(model, env, n_eval_episodes=64)
    assert np.isfinite(mean)


def test_sac_with_hindsight_replay_on_a_goal_environment():
    env = VecMonitor(rde.make_sb3("FourRGoalReach-v0", 4, max_episode_steps=20))
    model = SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=100, device="cpu"
    )
    model.learn(200)
    sample = model.replay_buffer.sample(64)
    assert set(np.unique(sample.rewards)) <= {0.0, 1.0}
    assert (sample.rewards == 1.0).any()
