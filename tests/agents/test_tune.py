"""Tuning: search spaces, and studies of trainings that go on where they stood."""

import math

import pytest
from run_folders import REFUSALS, csv_rows, says
from short_trainings import TINY

from redundant_envs_train.config import load
from redundant_envs_train.config.files import presets
from redundant_envs_train.config.search import own_values, space_of, with_values
from redundant_envs_train.rollout import SELECTION_SEED
from redundant_envs_train.run_folder import CHECKPOINT
from redundant_envs_train.training import train, watch
from redundant_envs_train.training.pool import Stopped

pytest.importorskip("optuna", reason="optuna is not installed; pip install '.[tune]'")

from redundant_envs_train.tune import STARTUP, tune

pytestmark = pytest.mark.long

SMALL = [*TINY, "total_steps=2048", "curve_every=1024"]
CONFIG = load("rprp_reach_ppo", SMALL)
GAMMA = ["ppo.gamma=0.5..0.9"]


def rows(folder):
    """trials.csv without the seconds, which differ from run to run."""
    return csv_rows(folder / "trials.csv", "seconds")


@pytest.mark.parametrize(
    ("text", "kind", "low", "high", "log"),
    [
        ("ppo.learning_rate=1e-3..1e-2", float, 1e-3, 1e-2, True), ("ppo.n_epochs=1..20", int, 1, 20, True),
        (" ppo.log_std_init = -2 .. 1 ", float, -2.0, 1.0, False),
    ],
)  # fmt: skip
def test_a_range_has_the_kind_of_its_setting(text, kind, low, high, log):
    (found,) = space_of(CONFIG, [text]).values()
    assert found == {"low": low, "high": high, "log": log}
    assert type(found["low"]) is type(found["high"]) is kind


def test_a_choice_has_values_of_its_setting():
    space = space_of(CONFIG, ["ppo.net_arch=[64,64]|[32]", "ppo.activation=silu|tanh", "ppo.average=0|0.9"])
    picked = {"ppo.net_arch": "[32]", "ppo.activation": "tanh", "ppo.average": "0.0"}
    assert all(picked[key] in within["choices"] for key, within in space.items())
    chosen = with_values(CONFIG, picked).ppo
    assert (chosen.net_arch, chosen.activation, chosen.average) == ((32,), "tanh", 0.0)
    for name in presets():  # the first trial has the preset's own values, which the default search contains
        assert own_values(load(name), space_of(load(name))).keys() == space_of(load(name)).keys()


@pytest.mark.parametrize(("text", "word"), REFUSALS["search"])
def test_what_is_no_search_is_refused(text, word):
    with says(word):
        space_of(CONFIG, [text])


def test_a_setting_is_searched_once_where_it_has_no_value_and_trials_are_compared_at_equal_steps(tmp_path):
    assert "ppo.gamma" in space_of(CONFIG)
    assert "ppo.gamma" not in space_of(CONFIG, [], ["ppo.gamma=0.9"])
    for searches, overrides in ((GAMMA, ["ppo.gamma=0.9"]), (GAMMA * 2, [])):
        with says("ppo.gamma has a value or another search"):
            space_of(CONFIG, searches, overrides)
    with says("max_seconds is 90; trials take equal steps: give null"):
        tune(load("baselines/rprp_reach_td3"), tmp_path, 2)


def fake_train(score, breaks=()):
    """A training whose curve is one ``score`` of its settings, (hold, return).

    ``breaks``: what trials raise.
    """
    raised = dict(breaks)

    def training(config, folder, progress, on_point):
        (folder / CHECKPOINT).mkdir(parents=True)
        (folder / "config.yaml").touch()
        error = raised.pop(int(folder.name.removeprefix("trial")), None)
        if error is not None:
            raise error
        for steps in range(1024, config.total_steps + 1, 1024):
            on_point(steps, *score(config.ppo))

    return training


@pytest.fixture
def by_gamma(monkeypatch):
    """Trainings that hold gamma of their goals."""
    monkeypatch.setattr(train, "train", fake_train(lambda ppo: (ppo.gamma, 1.0)))


def test_processes_search_a_study_together_and_leave_the_evaluation_goals_alone(tmp_path, monkeypatch, call):
    goals, run_episodes = [], watch.run_episodes

    def recorded(env, act, episodes, seed, **kwargs):
        goals.append(seed)
        return run_episodes(env, act, episodes, seed, **kwargs)

    monkeypatch.setattr(watch, "run_episodes", recorded)
    search = ["--search", "ppo.learning_rate=1e-3..1e-2", "--search", "ppo.n_epochs=1|2", "--out", tmp_path]
    call("tune", "rprp_reach_ppo", *TINY, "--trials", 2, *search)
    page, _ = call("tune", "rprp_reach_ppo", *TINY, "--trials", 5, *search, "--processes", 2)
    assert "| trial | hold_success | return | env_steps | ppo" in page
    found = rows(tmp_path)
    assert [row["state"] for row in found] == ["complete"] * 5
    assert len({row["ppo.learning_rate"] for row in found}) == 5
    for row in found:
        last = (tmp_path / f"trial{row['trial']}" / "selection.csv").read_text().split()[-1].split(",")
        assert [row["env_steps"], float(row["hold_success"])] == [last[0], float(last[2])]
    assert set(goals) == {SELECTION_SEED}
    assert not [*tmp_path.glob("**/evaluation.json"), *tmp_path.glob(f"*/{CHECKPOINT}")]


@pytest.mark.usefixtures("by_gamma")
def test_a_trial_below_the_median_is_pruned_but_not_while_policies_hold_nothing_yet(tmp_path):
    """The first trial has the configuration's own value; the best one is a configuration of its own."""
    config = load("rprp_reach_ppo", [*SMALL, "total_steps=8192", "ppo.gamma=0.7"])
    page = tune(config, tmp_path, 24, GAMMA).read_text()
    found, best = rows(tmp_path), load(tmp_path / "best.yaml")
    assert found[0]["ppo.gamma"] == "0.7"
    assert all(row["state"] == "complete" for row in found[:STARTUP])
    assert {(row["state"], row["env_steps"]) for row in found} == {("complete", "8192"), ("pruned", "2048")}
    assert best.ppo.gamma == max(float(row["ppo.gamma"]) for row in found)
    assert best.model_copy(update={"ppo": config.ppo}) == config
    assert page.count("| 8192 |") == 10


def test_a_training_without_end_and_refused_settings_are_named_and_the_study_goes_on(monkeypatch, tmp_path):
    breaks = {1: FloatingPointError("no number"), 2: RuntimeError("no end")}
    monkeypatch.setattr(train, "train", fake_train(lambda ppo: (0.5, 7.0), breaks))
    tune(CONFIG, tmp_path / "a", 4, ["ppo.gamma=0.5..0.99"])
    found = rows(tmp_path / "a")
    assert [row["state"] for row in found] == ["complete", "pruned", "pruned", "complete"]
    assert [row["message"] for row in found[1:3]] == ["no number", "no end"]
    with says("no trial of", "completed: ppo.batch_size is 30", "it must divide"):
        tune(CONFIG, tmp_path / "none", 2, ["ppo.batch_size=300|301"])


def test_a_stopped_or_killed_study_goes_on_where_it_stood(monkeypatch, tmp_path):
    breaks = {2: SystemExit(), 4: KeyboardInterrupt()}
    monkeypatch.setattr(train, "train", fake_train(lambda ppo: (ppo.gamma, 1.0), breaks))
    with pytest.raises(SystemExit):
        tune(CONFIG, tmp_path, 6, GAMMA)
    with pytest.raises(Stopped, match="stopped after 3 of 6 trials; the same command goes on"):
        tune(CONFIG, tmp_path, 6, GAMMA)
    for trials in (6, 7):  # first the rest, and then more of them
        tune(CONFIG, tmp_path, trials, GAMMA)
        states = [row["state"] for row in rows(tmp_path)]
        assert (states[2], states[4]) == ("running", "fail")
        assert len(states) == trials + 2
    assert len({row["ppo.gamma"] for row in rows(tmp_path)}) == 9  # none is drawn again


@pytest.mark.usefixtures("by_gamma")
def test_another_study_does_not_go_on_in_the_folder(tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    for config, searches, seed in (
        (CONFIG, ["ppo.gamma=0.5..0.8"], 0), (CONFIG, GAMMA, 1),
        (load("rprp_reach_ppo", [*SMALL, "ppo.ent_coef=0"]), GAMMA, 0),
    ):  # fmt: skip
        with says("holds a study with "):
            tune(config, tmp_path, 2, searches, seed=seed)
    for text in ("my notes\n", '{"op_code": 0, "a"\n[]\n'):
        (tmp_path / "study.journal").write_text(text)
        with says("study.journal cannot be used"):
            tune(CONFIG, tmp_path, 2, GAMMA)
        assert (tmp_path / "study.journal").read_text() == text


@pytest.mark.usefixtures("by_gamma")
@pytest.mark.parametrize("storage", ["sqlite:///{}/study.db", "{}/study.journal"])
def test_machines_share_a_study_in_a_storage(storage, tmp_path):
    place = storage.format(tmp_path)
    tune(CONFIG, tmp_path / "a", 2, GAMMA, storage=place)
    tune(CONFIG, tmp_path / "b", 3, GAMMA, storage=place)
    trials = [sorted(path.name for path in (tmp_path / name).glob("trial?")) for name in "ab"]
    assert trials == [["trial0", "trial1"], ["trial2"]]
    assert rows(tmp_path / "b")[:2] == rows(tmp_path / "a")
    with says("sqlite:////nowhere/study.db cannot be used"):
        tune(CONFIG, tmp_path / "c", 2, GAMMA, storage="sqlite:////nowhere/study.db")


def test_among_trials_that_hold_nothing_or_do_not_tell_the_return_decides(monkeypatch, tmp_path):
    for hold in (0.0, math.nan):
        monkeypatch.setattr(train, "train", fake_train(lambda ppo: (hold, -((ppo.gamma - 0.7) ** 2))))  # noqa: B023
        page = tune(CONFIG, tmp_path / str(hold), 24, GAMMA).read_text()
        best = max(rows(tmp_path / str(hold)), key=lambda row: float(row["return"]))
        assert load(tmp_path / str(hold) / "best.yaml").ppo.gamma == float(best["ppo.gamma"])
        assert abs(float(best["ppo.gamma"]) - 0.7) < 0.02  # the search follows it, too
        assert ("tells no success" in page) == math.isnan(hold)
