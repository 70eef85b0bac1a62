"""docs/examples/ and docs/other_libraries.md: the programs run, and agree with the project's evaluation."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import SAC

from redundant_envs_train.rollout import EVALUATION_SEED, run_episodes

ROOT = Path(__file__).parents[2]
PPO = ROOT / "docs" / "examples" / "cleanrl_ppo.py"
POLICY = ROOT / "policies" / "RPRPReach-v0-sac" / "policy.zip"
PAGE = ROOT / "docs" / "other_libraries.md"
RPRP = "redundant_envs/RPRPReach-v0"


@pytest.fixture(scope="module")
def ppo():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("cleanrl_ppo", PPO)
    module = importlib.util.module_from_spec(spec)
    sys.modules["cleanrl_ppo"] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules["cleanrl_ppo"]


@pytest.mark.long
def test_the_ppo_example_trains_evaluates_and_saves(tmp_path):
    small = ["--total-steps", "4096", "--num-envs", "32", "--batch-size", "256"]
    small += ["--evaluation-episodes", "10", "--save", str(tmp_path / "agent.pt")]
    command = [sys.executable, "-W", "error", str(PPO), *small]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    *progress, trained, holds = done.stdout.splitlines()
    assert progress[-1].split()[:2] == ["4096", "steps"]
    assert trained.startswith(f"trained {RPRP} with seed 0 in ")
    assert holds.endswith(" % of 10 frozen goals")
    weights = torch.load(tmp_path / "agent.pt", weights_only=True)
    assert all(torch.isfinite(w).all() for w in weights.values())


def test_the_ppo_example_counts_held_goals_as_the_evaluation_does(ppo):
    model = SAC.load(POLICY, device="cpu")

    def act(obs):
        # half of the effort: some goals are held, and some are not
        return 0.5 * model.predict(obs, deterministic=True)[0]

    class Agent:
        def mean(self, obs):
            return torch.from_numpy(act(obs.numpy()))

    found = ppo.evaluate(Agent(), ppo.Args(evaluation_episodes=40))
    assert 0.0 < found < 1.0
    assert found == run_episodes(RPRP, lambda obs, core, step: act(obs), 40, EVALUATION_SEED).hold.mean()


def test_advantages_of_the_ppo_example_are_discounted_returns_without_values(ppo):
    """With gae_lambda 1: up to the end of an episode, where a time limit leaves the last value."""
    args = ppo.Args(gamma=0.5, gae_lambda=1.0)
    rewards = torch.tensor([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [4.0, 4.0, 4.0]])
    values = torch.tensor([[10.0] * 3, [20.0] * 3, [40.0] * 3, [80.0] * 3])
    ended = torch.zeros(3, 3, dtype=torch.bool)
    ended[1, 1:] = True
    terminated = torch.zeros_like(ended)
    terminated[1, 2] = True
    returns = ppo.advantages_of(rewards, values, terminated, ended, args) + values[:-1]
    last = 4.0 + 0.5 * 80.0
    on, limit, end = 2.0 + 0.5 * last, 2.0 + 0.5 * 40.0, 2.0
    expected = [[1.0 + 0.5 * on, 1.0 + 0.5 * limit, 1.0 + 0.5 * end], [on, limit, end], [last] * 3]
    np.testing.assert_array_equal(returns.numpy(), np.array(expected, dtype=np.float32))


@pytest.mark.skipif(importlib.util.find_spec("torchrl") is None, reason="torchrl is not installed")
def test_the_program_for_torchrl_prints_what_its_comments_say():
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (program,) = (program for program in programs if "torchrl" in program)
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    shown = [line for line in done.stdout.splitlines() if line.startswith("torch.")]
    assert shown == ["torch.Size([100])", "torch.Size([64, 250]) torch.Size([128])", "torch.float64"]


def test_the_page_names_files_and_arguments_that_exist():
    text = PAGE.read_text(encoding="utf-8")
    for name in re.findall(r"(?:configs/zoo|docs/examples|agents/redundant_envs_train)/\w+\.\w+", text):
        assert (ROOT / name).exists(), name
    assert len(re.findall(r"configs/zoo/\w+\.yml", text)) >= 2
