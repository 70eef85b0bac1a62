"""The example of PPO in docs/examples/; configs/zoo/, and rl_zoo3 to the same bits."""

import importlib.util
import re
import subprocess
import sys
import textwrap

import pytest
import yaml
from run_folders import ROOT, RPRP
from short_trainings import assert_same_policy, small_config
from stable_baselines3 import PPO, SAC
from torch import nn

from redundant_envs_train.config import load
from redundant_envs_train.config.files import presets
from redundant_envs_train.learners.build import policy_kwargs, policy_name
from redundant_envs_train.learners.ppo import AveragedPPO
from redundant_envs_train.learners.sac import AveragedSAC
from redundant_envs_train.training.train import train

pytestmark = pytest.mark.long

PAGE = ROOT / "docs" / "other_libraries.md"


def python(*words):
    """Run Python with these arguments."""
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)


def without(package):
    """A mark for tests of a package that may not be installed."""
    return pytest.mark.skipif(importlib.util.find_spec(package) is None, reason=f"{package} is not installed")


CLASSES = {"averaged_ppo": AveragedPPO, "averaged_sac": AveragedSAC, "ppo": PPO, "sac": SAC}
OF_GOALS = {"n_sampled_goal", "goal_selection_strategy"}
PRESETS = [name for name in presets() if "/" not in name and "weak" not in name]
"""Settings for the environments as registered."""


def of_preset(config):
    """The settings of a preset under the names of rl_zoo3."""
    expected = config.settings.model_dump(exclude={"net_arch", "log_std_init", "schedule"} | OF_GOALS)
    if config.algo == "her":
        goals = config.settings.model_dump(include=OF_GOALS)
        expected |= {"replay_buffer_class": "HerReplayBuffer", "replay_buffer_kwargs": goals}
    return expected | {
        "policy": policy_name(config), "n_envs": config.num_envs, "n_timesteps": config.total_steps,
        "policy_kwargs": policy_kwargs(config),
    }  # fmt: skip


# RLlib needs tree, and Ray alone does not
@pytest.mark.parametrize(("name", "package"), [("torchrl", "torchrl"), ("rllib", "tree")])
def test_a_program_of_the_page_runs(name, package):
    pytest.importorskip(package)
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (program,) = (program for program in programs if name in program)
    done = python("-c", program)
    assert done.returncode == 0, done.stderr
    if name == "torchrl":  # what its comments say
        shown = [line for line in done.stdout.splitlines() if line.startswith("torch.")]
        assert shown == ["torch.Size([100])", "torch.Size([64, 250]) torch.Size([128])", "torch.float64"]
    else:
        assert int(float(done.stdout.splitlines()[-1])) >= 2048  # steps


STEPS = {
    "skrl": """
        from skrl.envs.wrappers.torch import wrap_env
        env = wrap_env(gym.make_vec(ID, num_envs=64))
        env.reset()
        shapes = [x.shape[0] for x in env.step(torch.zeros(64, 4))[:4]]
        """,
    "array_api_compat": """
        from gymnasium.wrappers.vector import ArrayConversion
        env = ArrayConversion(redundant_envs.make_torch(ID, 64, device="cpu"), env_xp=torch, target_xp=np)
        assert type(env.reset(seed=0)[0]) is np.ndarray
        shapes = [x.shape[0] for x in env.step(np.zeros((64, 4), np.float32))[:4]]
        """,
    "sbx": """
        import sbx
        model = sbx.PPO("MlpPolicy", redundant_envs.make_sb3(ID, 64), n_steps=16)
        model.learn(1024)
        shapes = [model.num_timesteps // 16]
        """,
    "tianshou": """
        from tianshou.env import DummyVectorEnv
        env = DummyVectorEnv([lambda: gym.make(ID)] * 64)
        env.reset()
        shapes = [len(x) for x in env.step(np.zeros((64, 4), np.float32))]
        """,
    "d3rlpy": """
        import d3rlpy
        model, log = d3rlpy.algos.SACConfig().create(), d3rlpy.logging.NoopAdapterFactory()
        model.fit_online(gym.make(ID), n_steps=64, n_steps_per_epoch=64, logger_adapter=log)
        shapes = [64]
        """,
    "pufferlib": """
        from pufferlib.emulation import GymnasiumPufferEnv
        env = GymnasiumPufferEnv(env_creator=lambda: gym.make(ID))
        env.reset(seed=0)
        shapes = [64 * np.isfinite(env.step(np.zeros(4, np.float32))[1])]
        """,
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=without(name)) for name in STEPS])
def test_a_row_of_the_page_takes_steps(name):
    head = "import gymnasium as gym, numpy as np, redundant_envs, torch"
    program = f"{head}\nID = {RPRP!r}\n{textwrap.dedent(STEPS[name])}\nassert set(shapes) == {{64}}, shapes"
    done = python("-c", program)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", CLASSES)
def test_hyperparameters_are_those_of_the_presets(name):
    algos = ("ppo",) if "ppo" in name else ("sac", "her")
    configs = (config for config in map(load, PRESETS) if config.env.endswith("Reach-v0"))
    presets_of = {config.env: config for config in configs if config.algo in algos}
    given = yaml.safe_load((ROOT / "configs" / "zoo" / f"{name}.yml").read_text(encoding="utf-8"))
    assert given.keys() == presets_of.keys()
    for env, found in given.items():
        config = presets_of[env]
        expected = of_preset(config)
        rate = f"{found['learning_rate']}"  # of a schedule: lin_ and the number
        assert float(rate.removeprefix("lin_")) == expected["learning_rate"]
        assert rate.startswith("lin_") == (config.settings.schedule == "linear")
        found = {**found, "policy_kwargs": eval(found["policy_kwargs"], {"nn": nn, "dict": dict})}
        found["learning_rate"] = expected["learning_rate"]
        beyond = expected.keys() - found.keys()  # what stable-baselines3 does not have
        assert {key: expected[key] for key in found} == found
        assert not beyond or "averaged" not in name


@without("rl_zoo3")
@pytest.mark.parametrize(
    ("algo", "envs", "steps", "changed"), [("ppo", 64, 3000, {}), ("sac", 16, 1000, {"learning_starts": 200})]
)
def test_rl_zoo3_learns_what_agents_train_learns_to_the_same_bits(algo, envs, steps, changed, tmp_path):
    """The evaluations of rl_zoo3 during training change nothing, it saves the average, and it plays it."""
    given = [f"{key}:{value}" for key, value in {**changed, "n_envs": envs, "n_timesteps": steps}.items()]
    name = f"averaged_{algo}"
    words = ["--algo", name, "--env", RPRP, "--num-threads", 1, "--conf-file", f"configs/zoo/{name}.yml"]
    words += ["--log-folder", tmp_path, "--seed", 3, "--eval-freq", 600, "--hyperparams", *given]
    done = python("docs/examples/rl_zoo.py", *words)
    assert done.returncode == 0, done.stderr
    (saved,) = tmp_path.glob("*/*/redundant_envs-*.zip")
    size = {"num_envs": envs, "total_steps": steps, "curve_every": 400_000, "env_kwargs": {}}
    train(small_config(algo, seed=3, **size, **{algo: changed}), tmp_path / "ours")
    assert (saved.parent / "best_model.zip").exists()
    CLASSES[algo].load(saved, device="cpu")  # stable-baselines3 alone takes it
    words = ["--algo", name, "--env", RPRP, "-f", tmp_path, "--no-render", "-n", 200]
    done = python("docs/examples/rl_zoo.py", "enjoy", *words)
    assert done.returncode == 0, done.stderr
    assert "Success rate: " in done.stdout
    saved.rename(saved.parent / "policy.zip")
    assert_same_policy(saved.parent, tmp_path / "ours")
