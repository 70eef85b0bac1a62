"""Hold success over the strength of the motors: rows, files and the figure, without any training."""

import copy

import numpy as np
import pytest
from run_folders import ROOT, change, says, write_run

from redundant_envs.control.holding import effort_limits, holding_load
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scenes.scene import load_scene, scene_data
from redundant_envs_train.config import load
from redundant_envs_train.rollout import EVALUATION_SEED
from studies import strength
from studies.strength import ARMS, EXPERT, HOLDABLE, LIGHTEST, learner_rows, weakened

pytestmark = pytest.mark.long

PRESETS = {"4R": "four_r_reach_ppo", "RPRP": "rprp_reach_sac"}


@pytest.mark.parametrize("arm", ARMS)
def test_only_effort_limits_are_weakened_and_the_goals_stay_those_of_the_evaluation(arm):
    env_id, scene = ARMS[arm]
    data, own = weakened(scene, 0.3), copy.deepcopy(scene_data(scene))
    np.testing.assert_allclose(effort_limits(load_scene(data)), 0.3 * effort_limits(load_scene(scene)))
    weak = make_sb3(env_id, 5, scene=data)
    weak.seed(EVALUATION_SEED)
    weak.reset()
    np.testing.assert_array_equal(strength.frozen_goals(arm, 5), weak.core.goals())
    for effect in (*data["effects"], *own["effects"]):
        effect.pop("limits", None)
    assert data == own
    assert load_scene(scene.replace("reach", "weak")) == load_scene(weakened(scene, 0.5))
    with says("EffortLimits.limits", "None"):
        weakened("four_r_free", 0.5)


def test_computed_torque_needs_strong_motors():
    rows = strength.expert_rows("RPRP", (1.0, 0.3), 41)  # of 41 out of 41 the interval ends below 1
    held = {(row.factor, row.who): row.hold_success for row in rows}
    assert list(held) == [(factor, who) for factor in (1.0, 0.3) for who in (HOLDABLE, EXPERT, LIGHTEST)]
    assert held[1.0, HOLDABLE] == held[1.0, EXPERT] == 1.0
    assert held[0.3, EXPERT] + 0.1 < held[0.3, HOLDABLE] < 1.0
    assert held[0.3, EXPERT] < held[0.3, LIGHTEST] < held[0.3, HOLDABLE]
    weak = load_scene(weakened("rprp_reach", 0.3))  # whose limits alone say what it holds, within 2 % of 1 m
    assert held[0.3, HOLDABLE] == (holding_load(weak, strength.frozen_goals("RPRP", 41), 0.02) <= 1.0).mean()


def run_folder(path, arm="4R", seed=0, hold=0.5, **env_kwargs):
    """A run folder after an evaluation."""
    config = load(PRESETS[arm]).to_dict() | {"env_kwargs": env_kwargs}
    facts = {"hold_success": hold, "interval": [hold - 0.05, hold + 0.05], "touch_success": hold + 0.1}
    env, algo, _ = (config.pop(name) for name in ("env", "algo", "seed"))
    return write_run(path, seed, env, algo, settings=config, episodes=100, **facts)


def test_only_finished_runs_of_one_setting_and_of_the_reach_task_are_joined(tmp_path):
    first, third, stopped = (run_folder(tmp_path / name, "4R", k) for k, name in enumerate("abc"))
    (stopped / "training.json").write_text('{"stopped": true, "env_steps": 1, "train_seconds": 1.0}')
    change(third / "config.yaml", total_steps=1000)
    heavier = weakened("four_r_reach", 0.5)
    heavier["robot"]["masses"][0] = 0.6
    (row,) = learner_rows([run_folder(tmp_path / "d", "RPRP", 0, 0.7, scene="rprp_weak")])
    assert (row.arm, row.factor, row.who, row.hold_success) == ("RPRP", 0.5, "SAC", 0.7)
    results = ROOT / "docs" / "results"
    for folders, *words in (
        ([first, third], "has other settings than other runs; give runs of one setting"),
        ([stopped], "c is a training that was stopped"),
        ([run_folder(tmp_path / "f", max_episode_steps=50)], "f: env_kwargs has 'max_episode_steps'"),
        ([run_folder(tmp_path / "g", scene=heavier)], "g: its scene has ", "differs in something else"),
        ([results / "runs.jsonl/rprp_goal_reach_her/seed110"], "is of redundant_envs/RPRPGoalReach-v0; give"),
        ([results / "baselines.jsonl/rprp_reach_td3/seed0"], "is a run of TD3; give"),
    ):  # fmt: skip
        with says(*words):
            learner_rows(folders)


def test_the_study_without_training_writes_rows_figure_and_table(tmp_path, monkeypatch, call, refused):
    command = ["study", "strength", "--seeds", "none", "--factors", "1", "--out", tmp_path, "--episodes"]
    monkeypatch.setattr(strength, "goal_loads", lambda arm, goals: np.zeros(len(goals)))
    table, _ = call(*command, 2)
    assert "| 4R | 1 | 100.0 % | 100.0 % | 100.0 % |" in table
    assert (tmp_path / "strength.png").stat().st_size > 10_000
    rows = strength.read_rows(tmp_path / "strength.csv")
    assert {(row.arm, row.factor) for row in rows} == {(arm, 1.0) for arm in ARMS}
    asked = []
    monkeypatch.setattr(strength, "expert_rows", lambda *given: asked.append(given) or rows)
    call(*command, 2)
    refused([*command[:-1], "--runs", "nothing"], "nothing/config.yaml")
    assert not asked  # what is finished stays, and mistakes come first
    call(*command, 3)
    assert [episodes for *_, episodes in asked] == [3, 3]  # of other goals it does not


def test_up_to_half_strength_presets_are_those_of_the_weak_scenes():
    for name, ((arm, factor, _), config) in strength.trainings((0.6, 0.5, 0.4), [0]).items():
        scene = ARMS[arm][1] if factor > 0.5 else ARMS[arm][1].replace("reach", "weak")
        own = {"env_kwargs": {"scene": weakened(ARMS[arm][1], factor)}}
        assert config.to_dict() == load(f"{scene}_{config.algo}").to_dict() | own, name


def test_learners_that_are_given_are_not_trained_again(tmp_path, monkeypatch):
    trained = {}

    def train_many(configs, folder, processes):
        trained.update(configs)
        for name, config in configs.items():
            run_folder(folder / name, "4R", config.seed, 0.2 + 0.2 * config.seed, **config.env_kwargs)

    monkeypatch.setattr(strength, "train_many", train_many)
    monkeypatch.setattr(strength, "TRAINED", ("ppo",))
    monkeypatch.setattr(strength, "ARMS", {"4R": ARMS["4R"]})
    own = [strength.Row("4R", 1.0, who, 0.9, 0.88, 0.93, 0.95, 0, 1000) for who in (HOLDABLE, EXPERT)]
    monkeypatch.setattr(strength, "expert_rows", lambda *given: own)
    given = [run_folder(tmp_path / "strong", "4R", 7, 0.9)]
    strength.run_study((1.0, 0.5), [0, 1], 2, given, None, tmp_path / "study")
    assert [*trained] == ["4r_ppo_0.5_seed0", "4r_ppo_0.5_seed1"]
    preset = load("four_r_reach_ppo", ["seed=1"]).to_dict()
    weak = preset | {"env_kwargs": {"scene": weakened("four_r_reach", 0.5)}}
    assert trained["4r_ppo_0.5_seed1"].to_dict() == weak
    rows = [row for row in strength.read_rows(tmp_path / "study/strength.csv") if row.who == "PPO"]
    weak, strong = sorted(rows, key=lambda row: row.factor)
    assert [(row.arm, row.factor, row.seeds, row.episodes) for row in (weak, strong)] == [
        ("4R", 0.5, 2, 100), ("4R", 1.0, 1, 100)
    ]  # fmt: skip
    found = (weak.hold_success, weak.low, weak.high, weak.touch_success, strong.hold_success)
    assert found == pytest.approx((0.3, 0.15, 0.45, 0.4, 0.9))
