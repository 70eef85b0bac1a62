"""Configurations of a training: what is read and what is refused; mistakes on the command line."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from run_folders import POLICIES, REFUSALS, ROOT, says
from short_trainings import small_config

from redundant_envs.effects.hooks import snake_case
from redundant_envs.envs.registration import IDS, SCENES
from redundant_envs_train.commands import name_of
from redundant_envs_train.config import MAX_EPISODES, MAX_SEEDS, Config, load
from redundant_envs_train.config.fields import limits
from redundant_envs_train.config.files import keys, presets
from redundant_envs_train.config.run import KEPT_FOR_GOALS, SEEDS_PER_RUN, first_environment_seed
from redundant_envs_train.rollout import EVALUATION_SEED, SELECTION_SEED, STUDY_SEED

CONFIG = "configs/training/rprp_reach_ppo.yaml"


@pytest.mark.parametrize("case", REFUSALS["configuration"], ids=lambda case: " ".join(case["given"])[:60])
def test_bad_overrides_name_the_key_and_the_valid_ones(case):
    with says(*case["says"]):
        load(CONFIG, case["given"])


LEARNERS = [(algo, key) for algo, settings in REFUSALS["learners"].items() for key in settings]


@pytest.mark.parametrize(("algo", "key"), LEARNERS)
def test_bad_settings_of_a_learner_are_refused_by_name(algo, key):
    with pytest.raises(ValueError, match=rf"^{algo}\.{key}"):
        small_config(algo, **{algo: {key: REFUSALS["learners"][algo][key]}})


def test_one_weight_of_smoothness_counts_everywhere():
    for given, expected in (({}, (0.05, 0.6)), ({"smoothness": 0.2}, (0.2, 0.2)),
                            ({"smoothness": 0.2, "smoothness_at_goal": 0.3}, (0.2, 0.3))):  # fmt: skip
        found = small_config("her", her={"learning_starts": 1600, "buffer_size": 4000} | given).settings
        assert (found.smoothness, found.smoothness_at_goal) == expected


def test_every_number_of_a_configuration_has_a_range_and_every_key_a_help(call):
    for name, field in keys():
        assert field.description, name
        if field.annotation in (int, float):
            low, high = limits(field)
            assert low < high, name
    page = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    assert call("schema", "--markdown")[0] == page, "make it again: python -m agents schema --markdown"
    assert set(json.loads(call("schema")[0])["properties"]) == set(Config.model_fields)


def test_a_run_is_named_after_its_preset_its_file_or_what_it_trains(tmp_path):
    def name(given, *overrides):
        return name_of(str(given), load(given, overrides))

    assert name("env=FourRReach-v0", "algo=sac") == "FourRReach-v0_sac"
    assert name("rprp_reach_ppo") == "rprp_reach_ppo"
    assert name(POLICIES / "RPRPReach-v0-ppo" / "config.yaml") == "RPRPReach-v0_ppo"
    assert name(shutil.copy(CONFIG, tmp_path / "mine.yaml")) == "mine"
    (tmp_path / "wrong.yaml").write_text("config_version: 2\nenv: RPRPReach-v0\nsed: 1\n")
    with says("wrong.yaml, line 3: sed is unknown"):  # a mistake of the file, although there are overrides
        load(tmp_path / "wrong.yaml", ["seed=3"])


@pytest.mark.parametrize("name", presets())
def test_shipped_configurations_load_and_are_named_by_what_they_are(name):
    config = load(name)
    arm, task = IDS[config.env]
    arm = SCENES[arm].removesuffix("_reach")
    weak, ends = ({"scene": f"{arm}_weak"}, {"terminate_on_touch": True})
    task = "weak" if config.env_kwargs == weak else snake_case(task)
    assert name.split("/")[-1] == f"{arm}_{task}_{config.algo}"
    stands_still = name == "two_r_reach_around_sac"  # with an end at a touch
    assert config.env_kwargs == (
        weak if task == "weak" else ends if "around" in task and not stands_still else {}
    )
    # baselines are given the same seconds; a linear rate would be cut off before its end
    assert config.max_seconds == (90.0 if "/" in name else None)
    assert "/" not in name or config.settings.schedule == "constant"


def test_no_two_runs_share_a_seed_of_an_environment_and_none_has_one_of_the_evaluations():
    first = [first_environment_seed(seed) for seed in range(MAX_SEEDS + 1)]
    assert (np.diff(first) >= SEEDS_PER_RUN).all()
    taken = {(at, at + MAX_EPISODES) for at in (EVALUATION_SEED, SELECTION_SEED, STUDY_SEED)}
    assert EVALUATION_SEED + MAX_EPISODES <= SELECTION_SEED <= STUDY_SEED - MAX_EPISODES
    low, high = KEPT_FOR_GOALS
    assert all(low <= begin and end <= high for begin, end in taken)
    assert not any(low - SEEDS_PER_RUN < seed < high for seed in first)


@pytest.mark.quick("train rprp_reach_ppo sed=1", "evaluate nope")
@pytest.mark.parametrize("words", REFUSALS["commands"])
def test_a_mistake_is_one_line_and_status_2(words, refused, monkeypatch):
    monkeypatch.chdir(ROOT)
    refused(words.split(), REFUSALS["commands"][words])


@pytest.mark.long
@pytest.mark.parametrize("words", ["train nope", "train rprp_reach_ppo sed=1"])
def test_a_mistake_is_told_before_anything_large_is_imported(words):
    command = [sys.executable, "-X", "importtime", "-m", "agents", *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert done.returncode == 2
    assert imported & {"torch", "stable_baselines3", "onnx", "pydantic"} == {"pydantic"}
