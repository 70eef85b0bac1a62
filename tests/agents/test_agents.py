"""Configurations, statistics, and one small run from YAML to report."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from redundant_envs_train.__main__ import main
from redundant_envs_train.config import (
    ALGORITHMS,
    MOST_EPISODES,
    MOST_SEEDS,
    SEEDS_PER_RUN,
    Config,
    first_environment_seed,
    load,
)
from redundant_envs_train.config.fields import limits
from redundant_envs_train.config.files import complete, help_of_keys, keys
from redundant_envs_train.config.run import KEPT_FOR_GOALS
from redundant_envs_train.presets import presets
from redundant_envs_train.report import evaluate, summary
from redundant_envs_train.rollout import EVALUATION_SEED, SELECTION_SEED, STUDY_SEED
from redundant_envs_train.statistics import wilson

CONFIG = "configs/training/rprp_reach_ppo.yaml"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["sed=3"], ["sed", "valid:", "seed"]),
        (["ppo.gama=0.9"], ["ppo.gama", "ppo.gamma"]),
        (["seed=1.5"], ["seed", "1.5", "whole"]),
        (["seed=20000"], ["seed", "20000", "from 0 to 9999"]),
        (["algo=dqn"], ["algo", "dqn", "ppo"]),
        (["ppo.batch_size=1000"], ["ppo.batch_size", "1000", "16384"]),
        (["ppo.learning_rate=fast"], ["ppo.learning_rate", "fast"]),
        (["seed"], ["seed", "key=value"]),
        (["num_envs=0"], ["num_envs", "0"]),
        (["num_envs=20480"], ["num_envs", "20480", "10000"]),
        (["env=nope"], ["env", "nope", "RPRPReach-v0"]),
        (["ppo.batch_size=0"], ["ppo.batch_size", "0", "from 2 to 1e+08"]),
        (["ppo=3"], ["ppo", "3", "mapping"]),
        (["ppo.gamma=5"], ["ppo.gamma is 5.0; give a number from 0 to 1"]),
        (["ppo.net_arch=[]"], ["ppo.net_arch has 0 entries; give at least 1"]),
        (["ppo.net_arch=64"], ["ppo.net_arch is 64; give a list"]),
        (["ppo.activation=gelu"], ["ppo.activation is 'gelu'; choose 'silu', 'tanh' or 'relu'"]),
        (["ppo.schedule=cosine"], ["ppo.schedule is 'cosine'", "'constant'"]),
        (["sac.gamma=0.9"], ["sac has settings, and algo is ppo", "a preset of sac"]),
        (["algo=sac", "sac.ent_coef=-1"], ["sac.ent_coef is -1; give a number from 0 to 100, or auto"]),
        (["algo=sac", "sac.ent_coef=automatic"], ["sac.ent_coef", "from 0 to 100, or auto"]),
        (["algo=sac", "sac.average=1"], ["sac.average is 1", "from 0 to 0.999999999"]),
        (["algo=sac", "total_steps=20000"], ["total_steps is 20000; sac begins to learn after 20000"]),
        (["telemetry=[csv,csv]"], ["telemetry is ['csv', 'csv']; name each one once"]),
        (["telemetry=csv"], ["telemetry is 'csv'; give a list, such as [tensorboard]"]),
        (["algo=her"], ["env is redundant_envs/RPRPReach-v0; her needs a goal environment", "GoalReach-v0"]),
        (
            ["algo=her", "env=redundant_envs/RPRPGoalReach-v0", "her.learning_starts=1000"],
            ["her.learning_starts is 1000; with 512 environments give at least 51200"],
        ),
        (["seed=true"], ["seed is True; give a whole number from 0 to 9999"]),
        (["config_version=1"], ["config_version is 1; this program reads 2", "averag", "config_version: 2"]),
        (["config_version=3"], ["config_version is 3; this program reads 2"]),
        (["telemetry=[carrier pigeons]"], ["telemetry[0] is 'carrier pigeons'", "'wandb'"]),
        (["checkpoint_seconds=-1"], ["checkpoint_seconds is -1", "from 0 to"]),
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
        (
            ["algo=sac", "sac.net_arch=[9007199254740992]"],
            ["sac.net_arch[0] is 9007199254740992", "from 1 to 2048"],
        ),
        (["ppo.net_arch=[1, 1, 1, 1, 1, 1, 1, 1, 1]"], ["ppo.net_arch has 9 entries", "at most 8"]),
        (["ppo.n_steps=9007199254740992"], ["ppo.n_steps is 9007199254740992", "from 1 to"]),
        (["ppo.n_steps=1000000"], ["ppo.n_steps is 1000000", "512 environments", "at most 195312"]),
        (
            ["algo=sac", "sac.buffer_size=9007199254740992"],
            ["sac.buffer_size is 9007199254740992", "from 1 to"],
        ),
        (["ppo.batch_size=1"], ["ppo.batch_size is 1;", "from 2 to"]),
        (["ppo.gamma=.nan"], ["ppo.gamma is nan", "from 0 to 1"]),
        (["ppo.learning_rate=.inf"], ["ppo.learning_rate is inf", "from 1e-12 to 1"]),
        (["ppo.log_std_init=1e6"], ["ppo.log_std_init is 1000000.0", "from -20 to 5"]),
        (["torch_threads=9007199254740992"], ["torch_threads is 9007199254740992", "from 1 to 1024"]),
        (["ppo.clip_range=-1"], ["ppo.clip_range is -1", "from"]),
        (["algo=sac", "sac.gradient_steps=-7"], ["sac.gradient_steps is -7", "from 1 to 10000"]),
        (["algo=sac", "sac.learning_starts=-1"], ["sac.learning_starts is -1", "from 0 to"]),
        (["max_seconds=.nan"], ["max_seconds is nan", "finite"]),
        (["max_seconds=0"], ["max_seconds is 0", "more than 0"]),
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


def test_every_number_of_a_configuration_has_a_range_and_every_key_a_help():
    for name, field in keys():
        assert field.description, name
        kind = str(field.annotation)
        if kind in ("<class 'int'>", "<class 'float'>"):
            low, high = limits(field)
            assert None not in (low, high), name
            assert low < high, name
    words = help_of_keys()
    assert "ppo.gamma: discount per control step (default 0.97, 0 to 1)" in words
    assert "sac.schedule: learning rate: constant, or linear to 0 at total_steps" in words


def test_keys_are_completed_and_so_are_their_choices():
    assert complete("ppo.ga") == ["ppo.gamma=", "ppo.gae_lambda="]
    assert complete("ppo.activation=") == [f"ppo.activation={name}" for name in ("silu", "tanh", "relu")]
    assert complete("nothing=") == []


def test_the_schema_describes_what_is_read(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    gamma = schema["$defs"]["PPOSettings"]["properties"]["gamma"]
    assert (gamma["minimum"], gamma["maximum"]) == (0, 1)
    assert set(schema["properties"]) == set(Config.model_fields)


def test_a_configuration_of_an_older_version_says_what_changed(tmp_path):
    path = tmp_path / "old.yaml"
    path.write_text("env: redundant_envs/RPRPReach-v0\nalgo: ppo\n")
    with pytest.raises(ValueError, match=r"config_version is missing.*average of the last weights.*tanh"):
        load(path)


def test_overrides_reach_their_place():
    config = load(CONFIG, ["seed=3", "ppo.learning_rate=1e-3", "ppo.net_arch=[32, 32]"])
    assert (config.seed, config.ppo.learning_rate, config.ppo.net_arch) == (3, 1e-3, (32, 32))


@pytest.mark.parametrize("name", presets())
def test_shipped_configurations_load_and_are_named_by_what_they_are(name):
    config = load(name)
    arm = {"RPRP": "rprp", "FourR": "four_r"}["RPRP" if "RPRP" in config.env else "FourR"]
    task = "goal_reach" if "Goal" in config.env else "reach"
    if "scene" in config.env_kwargs:
        assert config.env_kwargs == {"scene": f"{arm}_weak"}
        task = "weak"
    assert name.split("/")[-1] == f"{arm}_{task}_{config.algo}"
    if "/" not in name:  # baselines are given the same seconds instead
        assert config.max_seconds is None  # presets end by steps
    assert config.algo in ALGORITHMS


def test_one_weight_of_smooth_actions_counts_at_the_goal_too():
    """As in configurations of before there were two."""

    def weights(*overrides):
        her = load("four_r_goal_reach_her", overrides).settings
        return her.smoothness, her.smoothness_at_goal

    assert weights() == (0.05, 0.6)
    assert weights("her.smoothness=0.3") == (0.3, 0.3)
    assert weights("her.smoothness_at_goal=0.3") == (0.05, 0.3)
    assert weights("her.smoothness=0.2", "her.smoothness_at_goal=1") == (0.2, 1.0)


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
        pytest.param([
            "algo=sac", "num_envs=16", "total_steps=600", "sac.learning_starts=200",
            "sac.gradient_steps=1", "sac.batch_size=64",
        ], marks=pytest.mark.long),
    ],
)  # fmt: skip
def test_a_run_explains_itself(tmp_path, overrides, capsys):
    folder = tmp_path / "run"
    small = ["curve_every=2000", "curve_episodes=10", "evaluation_episodes=20", "seed=1"]
    assert main(["train", CONFIG, *overrides, "--out", str(folder), *small]) == 0
    result = json.loads((folder / "evaluation.json").read_text())
    promised = {
        "env", "algo", "seed", "episodes", "hold_success", "interval", "touch_success",
        "expert_hold_success", "env_steps", "train_seconds", "versions", "machine", "date",
        "time_to_hold", "effort", "smoothness", "expert_time_to_hold", "expert_effort", "expert_smoothness",
    }  # fmt: skip
    assert promised <= set(result)
    assert result["episodes"] == 20
    assert result["expert_hold_success"] == 1.0
    for name in ("config.yaml", "scene.yaml", "policy.zip", "monitor.csv", "clip.gif", "report.md"):
        assert (folder / name).stat().st_size > 0
    assert len(list((folder / "plots").glob("*.png"))) == 2
    assert "The learner loses to computed torque." in (folder / "report.md").read_text()
    assert "95 % interval" in capsys.readouterr().out
    again = load(folder / "config.yaml")
    assert yaml.safe_load((folder / "config.yaml").read_text()) == again.to_dict()
    before = np.loadtxt(folder / "episodes.csv", delimiter=",", skiprows=1)
    assert main(["evaluate", str(folder), "--overwrite"]) == 0
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
    assert main(command) == 2
    assert capsys.readouterr().err


def test_restless_are_the_goals_at_which_the_tip_ended_without_holding_them(tmp_path):
    folder = Path(shutil.copytree(Path(__file__).parents[2] / "policies/RPRPReach-v0-td3", tmp_path / "run"))
    config = load(folder / "config.yaml", ["evaluation_episodes=100"])
    (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
    result, episodes = evaluate(folder)
    _, hold, _, distance, *_ = episodes.T
    missed_there = ((hold == 0) & (distance <= 0.02)).sum()
    assert 0 < missed_there < (hold == 0).sum() < 100
    assert result["restless"] == missed_there
    assert f"at {missed_there} of them the tip was there at the end" in summary(result)


def test_no_two_runs_share_a_seed_of_an_environment_and_none_has_one_of_the_evaluations():
    first = [first_environment_seed(seed) for seed in range(MOST_SEEDS + 1)]
    assert (np.diff(first) >= SEEDS_PER_RUN).all()
    taken = {(at, at + MOST_EPISODES) for at in (EVALUATION_SEED, SELECTION_SEED, STUDY_SEED)}
    low, high = KEPT_FOR_GOALS
    assert all(low <= begin and end <= high for begin, end in taken)
    assert not any(low - SEEDS_PER_RUN < seed < high for seed in first)
