"""Stock algorithms train through the same configuration, and their policies are like all others."""

import base64
import json
import zipfile

import numpy as np
import pytest
import torch
from run_folders import assert_same_policy
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import PPO, SAC, TD3

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.learners.build import NormalNoise, make_model
from redundant_envs_train.policies import load_policy
from redundant_envs_train.presets import presets
from redundant_envs_train.run_folder import read_config
from redundant_envs_train.training.train import resume, train
from redundant_envs_train.training.watch import Watch

PLAIN = {"plain_ppo": PPO, "plain_sac": SAC, "td3": TD3, "tqc": TQC, "crossq": CrossQ}
OFF_POLICY = {"learning_starts": 200, "buffer_size": 1000, "gradient_steps": 1, "batch_size": 32}
STEPS = 1600


def config(algo, **more):
    settings = {"n_steps": 16, "batch_size": 64} if algo == "plain_ppo" else OFF_POLICY
    steps = STEPS if algo not in more else 50_000  # other settings may begin to learn later
    data = {
        "config_version": 2, "env": "redundant_envs/RPRPReach-v0", "algo": algo, "seed": 4, "num_envs": 16,
        "total_steps": steps, "curve_every": 800, "curve_episodes": 5, "telemetry": [], algo: settings,
    }  # fmt: skip
    return checked(Config, {**data, **more})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A short training of each algorithm, run when it is first needed."""
    made = {}

    def run(algo):
        if algo not in made:
            made[algo] = tmp_path_factory.mktemp(algo) / "run"
            train(config(algo, checkpoint_seconds=0), made[algo])
        return made[algo]

    return run


class Killed(Exception):
    """The process ends here."""


@pytest.mark.parametrize(
    "algo",
    ["td3", *(pytest.param(a, marks=pytest.mark.long) for a in ("plain_ppo", "crossq", "plain_sac", "tqc"))],
)
def test_a_killed_baseline_goes_on_to_the_same_bits(algo, runs, tmp_path, monkeypatch):
    plain = Watch._on_step

    def on_step(self):
        if self.num_timesteps >= 0.7 * STEPS:
            raise Killed
        return plain(self)

    with monkeypatch.context() as patch:
        patch.setattr(Watch, "_on_step", on_step)
        with pytest.raises(Killed):
            train(config(algo, checkpoint_seconds=1e-9), tmp_path / "run")
    resume(tmp_path / "run")
    assert_same_policy(runs(algo), tmp_path / "run")


@pytest.mark.parametrize("algo", PLAIN)
def test_the_policy_of_a_baseline_acts_the_same_however_it_is_read(algo, runs):
    folder = runs(algo)
    env = make_sb3("redundant_envs/RPRPReach-v0", 64)
    env.seed(7)
    observations = env.reset()
    theirs = PLAIN[algo].load(folder / "policy.zip", device="cpu")
    ours = load_policy(folder, read_config(folder))
    expected = theirs.predict(observations, deterministic=True)[0]
    np.testing.assert_array_equal(ours.predict(observations, deterministic=True)[0], expected)
    assert np.ptp(expected) > 0.01
    with zipfile.ZipFile(folder / "policy.zip") as archive:  # nothing that only this package could load
        about = json.loads(archive.read("data"))
    pickled = [base64.b64decode(v[":serialized:"]) for v in about.values() if ":serialized:" in str(v)]
    assert len(pickled) > 2
    assert not [data for data in pickled if b"redundant_envs" in data]


@pytest.mark.parametrize("algo", PLAIN)
def test_what_is_set_reaches_the_algorithm(algo):
    settings = {
        "gamma": 0.77, "learning_rate": 3e-4, "net_arch": [24, 8], "activation": "tanh", "batch_size": 64,
    }  # fmt: skip
    replay = {"buffer_size": 3200, "learning_starts": 77, "gradient_steps": 3}
    more = {
        "plain_ppo": {"n_steps": 16, "n_epochs": 7, "ent_coef": 0.02, "gae_lambda": 0.8},
        "plain_sac": {**replay, "ent_coef": 0.3, "tau": 0.01},
        "td3": {**replay, "tau": 0.01, "policy_delay": 5, "target_policy_noise": 0.3,
                "target_noise_clip": 0.6},
        "tqc": {**replay, "ent_coef": 0.3, "tau": 0.01, "top_quantiles_to_drop_per_net": 4},
        "crossq": {**replay, "ent_coef": 0.3, "policy_delay": 5},
    }[algo]  # fmt: skip
    made = make_model(config(algo, **{algo: settings | more}), make_sb3("redundant_envs/RPRPReach-v0", 16))
    assert type(made).train is PLAIN[algo].train
    assert type(made).collect_rollouts is PLAIN[algo].collect_rollouts
    for name, value in {**more, "batch_size": 64}.items():
        assert getattr(made, name) == value, name
    assert (made.gamma, made.lr_schedule(1.0), made.seed) == (0.77, 3e-4, 4)
    weights = made.policy.state_dict()
    inner = [name.partition(".")[0] for name, tensor in weights.items() if tensor.shape == (8, 24)]
    assert len(inner) >= 2  # of the actor and of the critics
    kinds = {type(module) for module in made.policy.modules()}
    assert torch.nn.Tanh in kinds
    assert torch.nn.SiLU not in kinds


BAD = {
    "td3": {"tau": 0, "policy_delay": 0, "action_noise": -1, "target_policy_noise": 11,
            "target_noise_clip": float("nan"), "net_arch": [0], "activation": "gelu", "average": 0.9},
    "tqc": {"n_quantiles": 0, "top_quantiles_to_drop_per_net": -1, "ent_coef": "none", "tau": 2},
    "crossq": {"batch_size": 1, "policy_delay": 1.5, "tau": 0.1, "ent_coef": -1},
    "plain_sac": {"gamma": 5, "ent_coef": [1], "smoothness": 0.1, "learning_starts": -1},
    "plain_ppo": {"clip_range": -1, "n_epochs": 0, "batch_size": 1, "average": 0.5},
}  # fmt: skip


@pytest.mark.parametrize(("algo", "key"), [(algo, key) for algo, bad in BAD.items() for key in bad])
def test_bad_settings_are_refused_by_name(algo, key):
    with pytest.raises(ValueError, match=rf"^{algo}\.{key}"):
        config(algo, **{algo: {key: BAD[algo][key]}})


def test_crossq_has_no_networks_for_goal_environments():
    with pytest.raises(ValueError, match=r"env is .*GoalReach-v0; crossq .* choose redundant_envs/"):
        config("crossq", env="redundant_envs/RPRPGoalReach-v0")


def test_quantiles_that_are_all_dropped_are_refused():
    with pytest.raises(
        ValueError, match=r"top_quantiles_to_drop_per_net is 5; with 5 quantiles give at most 4"
    ):
        config("tqc", tqc={"n_quantiles": 5, "top_quantiles_to_drop_per_net": 5})
    made = make_model(config("tqc", tqc={"n_quantiles": 5}), make_sb3("redundant_envs/RPRPReach-v0", 16))
    assert made.critic.quantiles_total == 10


def test_noise_of_td3_is_drawn_for_all_environments_at_once():
    noise = NormalNoise((500, 4), 0.2)
    np.random.seed(0)
    drawn = noise()
    assert drawn.shape == (500, 4)
    assert drawn.std() == pytest.approx(0.2, rel=0.05)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.15
    made = make_model(config("td3", td3={"action_noise": 0.3}), make_sb3("redundant_envs/RPRPReach-v0", 16))
    assert made.action_noise.deviation == 0.3


@pytest.mark.parametrize("name", [name for name in presets() if "/" in name])
def test_baselines_are_given_the_same_seconds(name):
    found = load(name)
    assert found.max_seconds == 90.0
    assert found.algo in PLAIN
    assert found.settings.schedule == "constant"  # a linear rate would be cut off before its end


@pytest.mark.parametrize(("schedule", "half"), [("constant", 2e-3), ("linear", 1e-3)])
@pytest.mark.parametrize(("algo", "more"), [("ppo", {"batch_size": 64}), ("sac", {}), ("td3", {})])
def test_the_learning_rate_follows_its_schedule(algo, more, schedule, half):
    settings = {algo: {"learning_rate": 2e-3, "schedule": schedule, **more}}
    model = make_model(config(algo, **settings), make_sb3("redundant_envs/RPRPReach-v0", 16))
    assert (model.lr_schedule(1.0), model.lr_schedule(0.5)) == (2e-3, half)
    assert model.lr_schedule(-0.01) == (2e-3 if schedule == "constant" else 0.0)


def test_noise_of_actions_is_normal_about_zero():
    np.random.seed(0)
    noise = NormalNoise((20_000, 4), 0.3)()
    assert noise.shape == (20_000, 4)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(noise.std(axis=0), 0.3, rtol=0.02)
