"""configs/zoo/: the settings of the presets for rl_zoo3; learning of rl_zoo3 to the same bits."""

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path

import pytest
import torch
import yaml
from stable_baselines3 import PPO, SAC
from torch import nn

from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.learners.build import policy_kwargs, policy_name
from redundant_envs_train.learners.ppo import AveragedPPO
from redundant_envs_train.learners.sac import AveragedSAC
from redundant_envs_train.presets import presets
from redundant_envs_train.training.train import train

ROOT = Path(__file__).parents[2]
CLASSES = {"averaged_ppo": AveragedPPO, "averaged_sac": AveragedSAC, "ppo": PPO, "sac": SAC}
OF_ZOO = {"policy", "n_envs", "n_timesteps", "policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs"}
OF_POLICY = {"net_arch", "log_std_init", "schedule"}
OF_GOALS = {"n_sampled_goal", "goal_selection_strategy"}
PRESETS = [name for name in presets() if "/" not in name and "weak" not in name]
"""Settings for the environments as registered."""
needs_zoo = pytest.mark.skipif(
    importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed (the extra zoo)"
)


def hyperparameters(name):
    """A file of configs/zoo/, by environment."""
    return yaml.safe_load((ROOT / "configs" / "zoo" / f"{name}.yml").read_text(encoding="utf-8"))


def of_preset(config):
    """The settings of a preset under the names of rl_zoo3."""
    settings = config.settings.model_dump()
    expected = {key: value for key, value in settings.items() if key not in OF_POLICY | OF_GOALS}
    if settings["schedule"] == "linear":
        expected["learning_rate"] = f"lin_{settings['learning_rate']}"
    expected |= {
        "policy": policy_name(config), "n_envs": config.num_envs, "n_timesteps": config.total_steps,
        "policy_kwargs": policy_kwargs(config),
    }  # fmt: skip
    if config.algo == "her":
        expected["replay_buffer_class"] = "HerReplayBuffer"
        expected["replay_buffer_kwargs"] = {key: settings[key] for key in sorted(OF_GOALS)}
    return expected


def as_read(given):
    """Settings of a file in the form of rl_zoo3: a schedule has a number, a policy's arguments are Python."""
    read = {**given, "policy_kwargs": eval(given["policy_kwargs"], {"nn": nn, "dict": dict})}
    if isinstance(given["learning_rate"], str):
        kind, number = given["learning_rate"].split("_")
        read["learning_rate"] = f"{kind}_{float(number)}"
    return read


def known(name):
    """Names of the arguments of an algorithm, its base class's among them."""
    kinds = CLASSES[name].__mro__
    return {argument for kind in kinds for argument in inspect.signature(kind.__init__).parameters}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("file", ["averaged", "plain"])
def test_hyperparameters_are_those_of_the_presets(preset, file):
    config = load(preset)
    base = "ppo" if config.algo == "ppo" else "sac"
    name = f"averaged_{base}" if file == "averaged" else base
    expected = of_preset(config)
    if file == "plain":
        own = known(f"averaged_{base}") - known(base)
        expected = {key: value for key, value in expected.items() if key not in own}
    given = as_read(hyperparameters(name)[config.env])
    assert list(given.keys() ^ expected.keys()) == []
    for key, value in expected.items():
        assert given[key] == value, key


@pytest.mark.parametrize("name", CLASSES)
def test_every_key_is_an_argument_of_the_algorithm_and_every_environment_has_a_preset(name):
    for given in hyperparameters(name).values():
        assert given.keys() - OF_ZOO - known(name) == set()
    kinds = ("ppo",) if "ppo" in name else ("sac", "her")
    assert hyperparameters(name).keys() == {c.env for c in map(load, PRESETS) if c.algo in kinds}


SMALL = {
    "ppo": ("averaged_ppo", PPO, "redundant_envs/RPRPReach-v0", 3000, {"n_envs": 64}),
    "sac": ("averaged_sac", SAC, "redundant_envs/RPRPReach-v0", 1000, {"n_envs": 16, "learning_starts": 200}),
}


def call(folder, name, env_id, *arguments):
    """redundant_envs_train.zoo on configs/zoo/, with its logs in a folder."""
    command = [sys.executable, "-m", "redundant_envs_train.zoo", "--algo", name, "--env", env_id]
    command += ["--num-threads", "1", "--conf-file", f"configs/zoo/{name}.yml", "--log-folder", str(folder)]
    return subprocess.run([*command, *arguments], check=False, capture_output=True, text=True, cwd=ROOT)


@needs_zoo
@pytest.mark.parametrize("algo", SMALL)
def test_rl_zoo3_learns_what_agents_train_learns_to_the_same_bits(algo, tmp_path):
    """The evaluations of rl_zoo3 during training change nothing, and it saves the average."""
    name, kind, env_id, steps, changed = SMALL[algo]
    given = [f"{key}:{value}" for key, value in {**changed, "n_timesteps": steps}.items()]
    done = call(tmp_path, name, env_id, "--seed", "3", "--eval-freq", "600", "--hyperparams", *given)
    assert done.returncode == 0, done.stderr
    (saved,) = tmp_path.glob("*/*/redundant_envs-*.zip")
    settings = {key: value for key, value in changed.items() if key != "n_envs"}
    config = checked(
        Config,
        {"config_version": 2, "env": env_id, "algo": algo, "seed": 3, "num_envs": changed["n_envs"],
         "total_steps": steps, "curve_episodes": 2, algo: settings},
    )  # fmt: skip
    train(config, tmp_path / "ours")
    theirs, ours = (kind.load(f, device="cpu") for f in (saved, tmp_path / "ours" / "policy.zip"))
    assert theirs.policy.state_dict().keys() == ours.policy.state_dict().keys()
    for key, weights in ours.policy.state_dict().items():
        assert torch.equal(theirs.policy.state_dict()[key], weights), key
    assert (saved.parent / "best_model.zip").exists()


@needs_zoo
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "10000"], "error: --seed is 10000; give one from 0 to 9999"),
        (
            ["--seed", "0", "--optimize-hyperparameters"],
            "error: --trained-agent and --optimize-hyperparameters",
        ),
    ],
)
def test_what_would_go_wrong_silently_is_refused(arguments, message, tmp_path):
    done = call(tmp_path, "averaged_sac", "redundant_envs/RPRPReach-v0", *arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert message in done.stderr
