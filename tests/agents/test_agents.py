"""Configurations, statistics, and one small run from YAML to report."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from agents.__main__ import main
from agents.config import RANGES, Config, PPOSettings, SACSettings, load
from agents.statistics import wilson

CONFIG = "configs/training/rprp_reach_ppo.yaml"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["sed=3"], ["sed", "valid:", "seed"]),
        (["ppo.gama=0.9"], ["ppo.gama", "ppo.gamma"]),
        (["seed=1.5"], ["seed", "1.5", "whole"]),
        (["seed=200"], ["seed", "200", "from 0 to 99"]),
        (["algo=dqn"], ["algo", "dqn", "ppo"]),
        (["ppo.batch_size=1000"], ["ppo.batch_size", "1000", "16384"]),
        (["ppo.learning_rate=fast"], ["ppo.learning_rate", "fast"]),
        (["seed"], ["seed", "key=value"]),
        (["num_envs=0"], ["num_envs", "0"]),
        (["num_envs=20480"], ["num_envs", "20480", "10000"]),
        (["env=nope"], ["env", "nope", "RPRPReach-v0"]),
        (["ppo.batch_size=0"], ["ppo.batch_size", "0", "from 2 to 1e+08"]),
        (["ppo=3"], ["ppo", "3", "mapping"]),
        (["total_steps=.inf"], ["total_steps", "inf", "whole"]),
        (["max_seconds=-1"], ["max_seconds", "-1"]),
        (["env_kwargs.num_envs=3"], ["env_kwargs", "'num_envs'", "max_episode_steps"]),
        (["env_kwargs.env_id=x"], ["env_kwargs", "'env_id'", "accuracy"]),
        (["env_kwargs.render_mode=human"], ["env_kwargs", "'render_mode'", "accuracy"]),
        (["env_kwargs={1: 2}"], ["env_kwargs", "key 1;", "accuracy"]),
        *(
            ([f"env_kwargs.max_episode_steps={value}"], ["env_kwargs.max_episode_steps is", "whole number"])
            for value in (".inf", ".nan", "[1]", "abc", "-1", "0", "1.5", "null", "9" * 90)
        ),
        (["ppo.net_arch=[-1]"], ["ppo.net_arch[0] is -1", "from 1 to 2048"]),
        (["ppo.net_arch=[64, 0]"], ["ppo.net_arch[1] is 0", "from 1 to 2048"]),
        (["sac.net_arch=[9007199254740992]"], ["sac.net_arch[0] is 9007199254740992", "from 1 to 2048"]),
        (["ppo.net_arch=[1, 1, 1, 1, 1, 1, 1, 1, 1]"], ["ppo.net_arch has 9 layers", "at most 8"]),
        (["ppo.n_steps=9007199254740992"], ["ppo.n_steps is 9007199254740992", "from 1 to"]),
        (["ppo.n_steps=1000000"], ["ppo.n_steps is 1000000", "512 environments", "at most 195312"]),
        (["sac.buffer_size=9007199254740992"], ["sac.buffer_size is 9007199254740992", "from 1 to"]),
        (["ppo.batch_size=1"], ["ppo.batch_size is 1;", "from 2 to"]),
        (["ppo.gamma=.nan"], ["ppo.gamma is nan", "from 0 to 1"]),
        (["ppo.learning_rate=.inf"], ["ppo.learning_rate is inf", "to 1"]),
        (["ppo.log_std_init=1e6"], ["ppo.log_std_init is 1000000.0", "from -20 to 5"]),
        (["torch_threads=9007199254740992"], ["torch_threads is 9007199254740992", "from 1 to 1024"]),
        (["ppo.clip_range=-1"], ["ppo.clip_range is -1", "from"]),
        (["sac.gradient_steps=-7"], ["sac.gradient_steps is -7", "from 1 to 10000"]),
        (["sac.learning_starts=-1"], ["sac.learning_starts is -1", "from 0 to"]),
        (["max_seconds=.nan"], ["max_seconds is nan", "at least"]),
    ],
)
def test_bad_overrides_name_the_key_and_the_valid_ones(overrides, words):
    with pytest.raises(ValueError) as error:
        load(CONFIG, overrides)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("episodes", ["0", "-3"])
@pytest.mark.parametrize("clip", [["--clip", "x.gif"], []])
def test_playing_no_episodes_is_refused(episodes, clip, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["play", "RPRPReach-v0", *clip, "--episodes", episodes]) == 2
    assert f"episodes is {episodes}; give at least 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_every_number_of_a_configuration_has_a_range():
    for where, kind in (("", Config), ("ppo.", PPOSettings), ("sac.", SACSettings)):
        numbers = {f.name for f in dataclasses.fields(kind) if f.type in ("int", "float")}
        assert set(RANGES[where]) == numbers


def test_overrides_reach_their_place():
    config = load(CONFIG, ["seed=3", "ppo.learning_rate=1e-3", "ppo.net_arch=[32, 32]"])
    assert (config.seed, config.ppo.learning_rate, config.ppo.net_arch) == (3, 1e-3, (32, 32))


@pytest.mark.parametrize("arm", ["rprp", "four_r"])
@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_shipped_configurations_load(arm, algo):
    assert load(f"configs/training/{arm}_reach_{algo}.yaml").algo == algo


def test_a_missing_configuration_lists_what_there_is():
    with pytest.raises(ValueError, match="rprp_reach_ppo"):
        load("configs/training/nothing.yaml")


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [  # Newcombe 1998, table I: Wilson's score method without continuity correction
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_interval(successes, trials, low, high):
    assert wilson(successes, trials) == pytest.approx((low, high), abs=6e-5)


def test_wilson_refuses_nonsense():
    with pytest.raises(ValueError, match="5 of 3"):
        wilson(5, 3)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(
    "overrides",
    [
        ["num_envs=64", "ppo.n_steps=16", "ppo.batch_size=512", "total_steps=4096"],
        [
            "algo=sac", "num_envs=16", "total_steps=600", "sac.learning_starts=200",
            "sac.gradient_steps=1", "sac.batch_size=64",
        ],
    ],
)  # fmt: skip
def test_a_run_explains_itself(tmp_path, overrides, capsys):
    folder = tmp_path / "run"
    small = ["selection_every=2000", "selection_episodes=10", "evaluation_episodes=20", "seed=1"]
    assert main(["train", CONFIG, *overrides, "--out", str(folder), *small]) == 0
    result = json.loads((folder / "evaluation.json").read_text())
    promised = {
        "env", "algo", "seed", "episodes", "hold_success", "interval", "touch_success",
        "expert_hold_success", "env_steps", "train_seconds", "versions",
    }  # fmt: skip
    assert promised <= set(result)
    assert result["episodes"] == 20
    assert result["expert_hold_success"] == 1.0
    for name in ("config.yaml", "scene.py", "policy.zip", "monitor.csv", "clip.gif", "report.md"):
        assert (folder / name).stat().st_size > 0
    assert len(list((folder / "plots").glob("*.png"))) == 2
    assert "The learner loses to the expert." in (folder / "report.md").read_text()
    assert "95 % interval" in capsys.readouterr().out
    again = load(folder / "config.yaml")
    assert yaml.safe_load((folder / "config.yaml").read_text()) == again.to_dict()
    before = np.loadtxt(folder / "episodes.csv", delimiter=",", skiprows=1)
    assert main(["evaluate", str(folder)]) == 0
    np.testing.assert_array_equal(np.loadtxt(folder / "episodes.csv", delimiter=",", skiprows=1), before)
    assert main(["play", str(folder), "--clip", str(folder / "again.gif"), "--episodes", "1"]) == 0
    assert (folder / "again.gif").stat().st_size > 10_000
    assert main(["train", CONFIG, "--out", str(folder)]) == 2


@pytest.mark.parametrize("actions", ["zero", "random", "expert"])
@pytest.mark.filterwarnings("ignore:.*HumanRendering wrapper")
def test_play_works_without_a_policy(actions, tmp_path, capsys):
    clip = tmp_path / "play.gif"
    command = ["play", "FourRReach-v0", "--actions", actions, "--episodes", "1"]
    assert main([*command, "--clip", str(clip)]) == 0
    assert clip.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (["play", "Nothing-v0"], "RPRPReach-v0"),
        (["report", "configs"], "config.yaml"),
        (["train", "nothing.yaml"], "nothing.yaml"),
    ],
)
def test_mistakes_end_with_a_message(command, word, capsys):
    assert main(command) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize("command", [["report", "runs/x", "seed=3"], ["train", CONFIG, "--outt", "x"]])
def test_unknown_arguments_are_refused(command, capsys):
    with pytest.raises(SystemExit):
        main(command)
    assert "unrecognized arguments" in capsys.readouterr().err
