"""Programs of docs/examples/ and docs/other_libraries.md; configs/zoo/, and rl_zoo3 to the same bits."""

import importlib.util
import inspect
import re
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import torch
import yaml
from run_folders import ROOT, RPRP
from short_trainings import assert_same_policy
from stable_baselines3 import PPO, SAC
from torch import nn

from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.learners.build import policy_kwargs, policy_name
from redundant_envs_train.learners.ppo import AveragedPPO
from redundant_envs_train.learners.sac import AveragedSAC
from redundant_envs_train.presets import presets
from redundant_envs_train.training.train import train

pytestmark = pytest.mark.long

EXAMPLE = ROOT / "docs" / "examples" / "cleanrl_ppo.py"
PAGE = ROOT / "docs" / "other_libraries.md"


def python(*words):
    """Run Python with these arguments."""
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)


def without(package):
    """A mark for tests of a package that may not be installed."""
    missing = importlib.util.find_spec(package) is None
    return pytest.mark.skipif(missing, reason=f"{package} is not installed")


@pytest.fixture(scope="module")
def ppo():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("cleanrl_ppo", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["cleanrl_ppo"] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules["cleanrl_ppo"]


def test_the_ppo_example_trains_evaluates_and_saves(tmp_path):
    small = ["--total-steps", 4096, "--num-envs", 32, "--batch-size", 256, "--evaluation-episodes", 10]
    done = python("-W", "error", EXAMPLE, *small, "--save", tmp_path / "agent.pt")
    assert done.returncode == 0, done.stderr
    *progress, trained, holds = done.stdout.splitlines()
    assert progress[-1].split()[:2] == ["4096", "steps"]
    assert trained.startswith(f"trained {RPRP} with seed 0 in ")
    assert holds.endswith(" % of 10 frozen goals")
    weights = torch.load(tmp_path / "agent.pt", weights_only=True)
    assert all(torch.isfinite(w).all() for w in weights.values())


def test_advantages_of_the_ppo_example_are_discounted_returns_without_values(ppo):
    """With gae_lambda 1: up to the end of an episode, where a time limit leaves the last value."""
    args = ppo.Args(gamma=0.5, gae_lambda=1.0)
    rewards = torch.tensor([[1.0] * 3, [2.0] * 3, [4.0] * 3])
    values = torch.tensor([[10.0] * 3, [20.0] * 3, [40.0] * 3, [80.0] * 3])
    ended, terminated = torch.zeros(3, 3, dtype=torch.bool), torch.zeros(3, 3, dtype=torch.bool)
    ended[1, 1:] = terminated[1, 2] = True
    returns = ppo.advantages_of(rewards, values, terminated, ended, args) + values[:-1]
    last = 4.0 + 0.5 * 80.0
    on, limit, end = 2.0 + 0.5 * last, 2.0 + 0.5 * 40.0, 2.0
    expected = [[1.0 + 0.5 * on, 1.0 + 0.5 * limit, 1.0 + 0.5 * end], [on, limit, end], [last] * 3]
    np.testing.assert_array_equal(returns.numpy(), np.array(expected, dtype=np.float32))


PROGRAMS = {  # of the page: the library, the package that it needs, and how its output ends
    "torchrl": ("torchrl", "torch.Size([100])\ntorch.Size([64, 250]) torch.Size([128])\ntorch.float64"),
    "rllib": ("tree", ""),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=without(package)) for name, (package, _) in PROGRAMS.items()]
)
def test_a_program_of_the_page_runs(name):
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (program,) = (program for program in programs if name in program)
    done = python("-c", program)
    assert done.returncode == 0, done.stderr
    assert done.stdout.rstrip().endswith(PROGRAMS[name][1])


STEPS = {
    "skrl": """
        from skrl.envs.wrappers.torch import wrap_env
        env = wrap_env(gym.make_vec(ID, num_envs=64))
        env.reset()
        shapes = [x.shape[0] for x in env.step(torch.zeros(64, 4))[:4]]
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
    (row,) = (
        line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.lower().startswith(f"| {name}")
    )
    assert row.count("|") == 4


CLASSES = {"averaged_ppo": AveragedPPO, "averaged_sac": AveragedSAC, "ppo": PPO, "sac": SAC}
OF_POLICY = {"net_arch", "log_std_init", "schedule"}
OF_GOALS = {"n_sampled_goal", "goal_selection_strategy"}
PRESETS = [name for name in presets() if "/" not in name and "weak" not in name]
"""Settings for the environments as registered."""


def of_preset(config):
    """The settings of a preset under the names of rl_zoo3."""
    settings = config.settings.model_dump()
    expected = {key: value for key, value in settings.items() if key not in OF_POLICY | OF_GOALS}
    if settings["schedule"] == "linear":
        expected["learning_rate"] = f"lin_{settings['learning_rate']}"
    if config.algo == "her":
        expected["replay_buffer_class"] = "HerReplayBuffer"
        expected["replay_buffer_kwargs"] = {key: settings[key] for key in sorted(OF_GOALS)}
    return expected | {
        "policy": policy_name(config), "n_envs": config.num_envs, "n_timesteps": config.total_steps,
        "policy_kwargs": policy_kwargs(config),
    }  # fmt: skip


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


@pytest.mark.parametrize("name", CLASSES)
def test_hyperparameters_are_those_of_the_presets(name):
    averaged = "averaged_ppo" if "ppo" in name else "averaged_sac"
    own = known(averaged) - known(name)  # none, or what stable-baselines3 does not have
    algos = ("ppo",) if "ppo" in name else ("sac", "her")
    given = yaml.safe_load((ROOT / "configs" / "zoo" / f"{name}.yml").read_text(encoding="utf-8"))
    assert {env: as_read(settings) for env, settings in given.items()} == {
        config.env: {key: value for key, value in of_preset(config).items() if key not in own}
        for config in map(load, PRESETS)
        if config.algo in algos
    }


def zoo(folder, name, *arguments):
    """docs/examples/rl_zoo.py on configs/zoo/, with its logs in a folder."""
    given = ["--num-threads", 1, "--conf-file", f"configs/zoo/{name}.yml", "--log-folder", folder]
    return python("docs/examples/rl_zoo.py", "--algo", name, "--env", RPRP, *given, *arguments)


@without("rl_zoo3")
@pytest.mark.parametrize(
    ("algo", "envs", "steps", "changed"), [("ppo", 64, 3000, {}), ("sac", 16, 1000, {"learning_starts": 200})]
)
def test_rl_zoo3_learns_what_agents_train_learns_to_the_same_bits(algo, envs, steps, changed, tmp_path):
    """The evaluations of rl_zoo3 during training change nothing, it saves the average, and it plays it."""
    given = [f"{key}:{value}" for key, value in {**changed, "n_envs": envs, "n_timesteps": steps}.items()]
    done = zoo(tmp_path, f"averaged_{algo}", "--seed", 3, "--eval-freq", 600, "--hyperparams", *given)
    assert done.returncode == 0, done.stderr
    (saved,) = tmp_path.glob("*/*/redundant_envs-*.zip")
    config = checked(
        Config,
        {"config_version": 2, "env": RPRP, "algo": algo, "seed": 3, "num_envs": envs,
         "total_steps": steps, "curve_episodes": 2, algo: changed},
    )  # fmt: skip
    train(config, tmp_path / "ours")
    assert (saved.parent / "best_model.zip").exists()
    CLASSES[algo].load(saved, device="cpu")  # stable-baselines3 alone takes it
    words = ["--algo", f"averaged_{algo}", "--env", RPRP, "-f", tmp_path, "--no-render", "-n", 200]
    done = python("docs/examples/rl_zoo.py", "enjoy", *words)
    assert done.returncode == 0, done.stderr
    assert "Success rate: " in done.stdout
    saved.rename(saved.parent / "policy.zip")
    assert_same_policy(saved.parent, tmp_path / "ours")


@without("rl_zoo3")
def test_a_search_of_rl_zoo3_completes_trials_with_the_file_for_it(tmp_path):
    given = ["--conf-file", "configs/zoo/ppo_optimize.yml", "--log-folder", tmp_path, "--num-threads", 1]
    search = ["-optimize", "--n-trials", 1, "-n", 600, "--seed", 0]
    done = python("docs/examples/rl_zoo.py", "--algo", "ppo", "--env", RPRP, *given, *search)
    assert done.returncode == 0, done.stderr
    assert "Trial 0 finished" in done.stdout + done.stderr
    done = zoo(tmp_path, "averaged_sac", "--seed", 0, "--optimize-hyperparameters")
    assert done.returncode == 1  # what would go wrong silently is refused
    assert "--trained-agent and --optimize" in done.stderr.splitlines()[-1]
