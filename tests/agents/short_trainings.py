"""Trainings of seconds: their settings by algorithm, how they are killed, and whether two are equal."""

import pytest
import torch
from run_folders import RPRP

from redundant_envs_train.config import Config, checked
from redundant_envs_train.policies import read_weights
from redundant_envs_train.training import checkpoint
from redundant_envs_train.training.train import train
from redundant_envs_train.training.watch import Watch

TINY = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=1024", "curve_every=512",
    "curve_episodes=5", "evaluation_episodes=5", "telemetry=[]",
]  # fmt: skip
"""Settings of a training of PPO that takes less than a second."""
SMALL = [*TINY, "env_kwargs.max_episode_steps=20"]
REPLAY = {"learning_starts": 400, "buffer_size": 1200, "gradient_steps": 1, "batch_size": 32}
"""A replay buffer that is smaller than a run, so that its oldest rows are overwritten."""
CASES = {
    "ppo": {"total_steps": 2048, "stagger": True, "ppo": {"n_steps": 16, "batch_size": 256}},
    "plain_ppo": {"plain_ppo": {"n_steps": 16, "batch_size": 64}},
    "auto": {"algo": "sac", "sac": {**REPLAY, "ent_coef": "auto", "schedule": "linear"}},
    "her": {
        "env": "redundant_envs/RPRPGoalReach-v0", "total_steps": 4800,
        "her": {**REPLAY, "learning_starts": 1600, "buffer_size": 3200},
    },
    "demonstrated": {
        "algo": "sac", "sac": REPLAY, "env_kwargs": {"action": "joint_velocity", "decide_every": 5},
        "demonstrations": {"episodes": 20, "share": 0.25},
    },
    "best": {"algo": "sac", "sac": REPLAY, "keep": "best", "curve_every": 200},
    "moved": {
        "algo": "sac", "sac": REPLAY,
        "curriculum": {"parameters": {"effort_limits.limits": [10.0, 16.0, 4.0, 8.0]}, "until": 0.5},
    },
    **{algo: {algo: REPLAY} for algo in ("sac", "plain_sac", "td3", "tqc", "crossq")},
}  # fmt: skip
"""Settings of short trainings, by algorithm or by what is special."""


def small_config(case, **more):
    """The configuration of a short training."""
    return checked(Config, {
        "config_version": 2, "env": RPRP, "algo": case, "seed": 4, "num_envs": 16, "total_steps": 2400,
        "curve_every": 1000, "curve_episodes": 5, "evaluation_episodes": 5, "telemetry": [],
        "checkpoint_seconds": 0, "env_kwargs": {"max_episode_steps": 40}, **CASES[case], **more,
    })  # fmt: skip


def kill(folder, case, steps=1900, **settings):
    """A training that ends without a trace at so many steps, a few checkpoints after the first."""
    plain, save = Watch._on_step, checkpoint.save

    def on_step(self):
        if self.num_timesteps >= steps:
            raise SystemExit
        return plain(self)

    def save_late(folder, model, *more):
        if model.num_timesteps > 0.9 * steps - 200:
            save(folder, model, *more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Watch, "_on_step", on_step)
        patch.setattr(checkpoint, "save", save_late)
        with pytest.raises(SystemExit):
            train(small_config(case, **settings), folder)


def assert_same_policy(one, other):
    """The policies of two run folders are equal to the bit."""
    expected, found = (read_weights(folder / "policy.zip", "silu")[0] for folder in (one, other))
    torch.testing.assert_close(found, expected, rtol=0.0, atol=0.0)
