"""Tuning: search spaces, and continued studies."""

import csv
import re

import pytest
import yaml

from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.presets import presets
from redundant_envs_train.rollout import SELECTION_SEED
from redundant_envs_train.run_folder import CHECKPOINT
from redundant_envs_train.training import watch
from redundant_envs_train.training.pool import Stopped

pytest.importorskip("optuna", reason="optuna is not installed; pip install 'redundant-envs[tune]'")

from optuna.distributions import FloatDistribution, IntDistribution

from redundant_envs_train.tuning import study as studies
from redundant_envs_train.tuning.search import own_parameters, space_of, with_parameters
from redundant_envs_train.tuning.study import LEAST_AHEAD, tune
from redundant_envs_train.tuning.trials import STARTUP_TRIALS

SMALL = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=2048", "curve_every=1024",
    "curve_episodes=5", "evaluation_episodes=10", "telemetry=[]",
]  # fmt: skip
CONFIG = load("rprp_reach_ppo", SMALL)
GAMMA = ["ppo.gamma=0.5..0.9"]


def rows(folder):
    """trials.csv without the seconds, which differ from run to run."""
    with (folder / "trials.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def curve(folder, trial):
    """The learning curve of a trial without the seconds."""
    lines = (folder / f"trial{trial}" / "selection.csv").read_text().splitlines()[1:]
    return [(steps, *rates) for steps, _, *rates in (line.split(",") for line in lines)]


# ---- search spaces -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ppo.learning_rate=1e-3..1e-2", FloatDistribution(1e-3, 1e-2, log=True)),
        (" ppo.gamma = .5 .. 0.9 ", FloatDistribution(0.5, 0.9)),
        ("ppo.n_epochs=1..20", IntDistribution(1, 20, log=True)),
        ("ppo.log_std_init=-2..1", FloatDistribution(-2.0, 1.0)),
    ],
)
def test_a_range_has_the_kind_of_its_setting(text, expected):
    ((_, found),) = space_of(CONFIG, [text]).items()
    assert found == expected


def test_a_choice_has_values_of_its_setting():
    space = space_of(CONFIG, ["ppo.net_arch=[64, 64]|[32]", "ppo.activation=silu|tanh", "ppo.average=0|0.9"])
    chosen = with_parameters(
        CONFIG, space, {"ppo.net_arch": "[32]", "ppo.activation": "tanh", "ppo.average": "0"}
    )
    assert (chosen.ppo.net_arch, chosen.ppo.activation, chosen.ppo.average) == ((32,), "tanh", 0.0)
    assert own_parameters(CONFIG, space) == {
        "ppo.net_arch": "[64, 64]", "ppo.activation": "silu", "ppo.average": "0.9"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "write key=low..high"),
        ("ppo.gamma", "write key=low..high"),
        ("ppo.gamma=", "write low..high, or 2 to 100 values"),
        ("ppo.gamma=0.9", "write low..high, or 2 to 100 values"),
        ("ppo.gamma=0.9..0.5", "write the lower number first"),
        ("ppo.gamma=0.9..0.9", "write the lower number first"),
        ("ppo.gamma=0.9..1.5", "ppo.gamma is 1.5; give a number from 0 to 1"),
        ("ppo.gamma=nan..1", "write low..high"),
        ("ppo.gamma=1e999..1e9999", "ppo.gamma is inf; give a number from 0 to 1"),
        ("ppo.gamma=0..1..2", "write low..high"),
        ("ppo.gamma=0.9|0.9", "'0.9' twice"),
        ("ppo.gamma=0.9|a", "ppo.gamma is 'a'; give a number"),
        ("ppo.gamma=0.9|", "ppo.gamma is None; give a number"),
        ("ppo.gamma=" + "|".join(str(k / 1000) for k in range(101)), "2 to 100 values"),
        ("ppo.n_epochs=1.5..3", "ppo.n_epochs is 1.5; give a whole number"),
        ("ppo.activation=silu|!!python/object:os.system", "the value"),
        ("ppo.activation=1..2", "ppo.activation is 1.0; choose"),
        ("ppo.net_arch=1..2", "ppo.net_arch"),
        ("ppo.gama=0..1", "search key 'ppo.gama' is unknown; valid: ppo.n_steps"),
        ("sac.gamma=0..1", "search key 'sac.gamma' is unknown; valid: ppo.n_steps"),
        ("gamma=0..1", "unknown"),
        ("seed=0..9", "unknown"),
        ("ppo.__class__=0..1", "unknown"),
        ("ppo.gamma=" + "9" * 100_000 + "..1", "ppo.gamma"),
    ],
)
def test_what_is_no_search_is_refused(text, word):
    with pytest.raises(ValueError, match=r".") as error:
        space_of(CONFIG, [text])
    assert word in str(error.value)
    assert len(str(error.value)) < 1000


def test_a_setting_is_searched_once_and_not_where_it_has_a_value():
    assert "ppo.gamma" in space_of(CONFIG)
    assert "ppo.gamma" not in space_of(CONFIG, [], ["ppo.gamma=0.9"])
    with pytest.raises(ValueError, match="has a value and is searched"):
        space_of(CONFIG, GAMMA, ["ppo.gamma=0.9"])
    with pytest.raises(ValueError, match="twice"):
        space_of(CONFIG, GAMMA * 2)
    tqc = load("baselines/rprp_reach_tqc", ["tqc.top_quantiles_to_drop_per_net=2"])
    with pytest.raises(ValueError, match=r"no value of tqc.n_quantiles .* give at most"):
        space_of(tqc, ["tqc.n_quantiles=1..2"])


@pytest.mark.parametrize("name", presets())
def test_the_default_search_has_the_values_of_every_preset(name):
    config = load(name)
    space = space_of(config)
    assert own_parameters(config, space).keys() == space.keys()


# ---- studies -------------------------------------------------------------------------------------


def fake_train(score, breaks=()):
    """A training whose curve is one ``score`` of its settings, (hold, return).

    ``breaks``: what trials raise.
    """
    raised = dict(breaks)

    def train(config, folder, progress, on_point):
        (folder / CHECKPOINT).mkdir(parents=True)
        error = raised.pop(int(folder.name.removeprefix("trial")), None)
        if error is not None:
            raise error
        for steps in (1024, 2048, 2048):
            on_point(steps, *score(config.ppo))

    return train


@pytest.fixture
def by_gamma(monkeypatch):
    """Trainings that hold gamma of their goals."""
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0)))


def test_a_study_is_reproducible_and_leaves_the_evaluation_goals_alone(tmp_path, monkeypatch, capsys):
    goals, run_episodes = [], watch.run_episodes

    def recorded(env, act, episodes, seed, **kwargs):
        goals.append(seed)
        return run_episodes(env, act, episodes, seed, **kwargs)

    monkeypatch.setattr(watch, "run_episodes", recorded)
    search = ["--search", "ppo.learning_rate=1e-3..1e-2", "--search", "ppo.n_epochs=1|2"]
    for name in ("a", "b"):
        command = ["tune", "rprp_reach_ppo", *SMALL, "--trials", "3", *search, "--out", str(tmp_path / name)]
        assert main(command) == 0
    assert (
        "| trial | hold success | mean return | ppo.learning_rate | ppo.n_epochs |" in capsys.readouterr().out
    )
    a, b = (rows(tmp_path / name) for name in ("a", "b"))
    assert a == b
    assert [row["state"] for row in a] == ["complete"] * 3
    assert len({row["ppo.learning_rate"] for row in a}) == 3
    assert [curve(tmp_path / "a", k) for k in range(3)] == [curve(tmp_path / "b", k) for k in range(3)]
    assert set(goals) == {SELECTION_SEED}
    assert not list(tmp_path.glob("**/evaluation.json"))
    assert (tmp_path / "a" / "best.yaml").read_bytes() == (tmp_path / "b" / "best.yaml").read_bytes()


def test_the_best_of_a_study_is_a_configuration_of_its_own(by_gamma, tmp_path):
    page = tune(CONFIG, tmp_path / "study", 16, GAMMA).read_text()
    found = rows(tmp_path / "study")
    assert not list((tmp_path / "study").glob(f"*/{CHECKPOINT}"))  # nothing goes on with them
    best = load(tmp_path / "study" / "best.yaml")
    assert best.ppo.gamma == max(float(row["ppo.gamma"]) for row in found)
    assert best.model_copy(update={"ppo": CONFIG.ppo}) == CONFIG
    assert "| ppo.gamma | 100 % |" in page
    assert f" | {100 * best.ppo.gamma:.1f} % | 1.0 | {best.ppo.gamma:.4g} |" in page
    few = tune(CONFIG, tmp_path / "few", 5, GAMMA).read_text()
    assert "Importance" not in few  # with so few trials there is none to report


def test_of_equal_trials_the_first_is_the_best(monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (0.5, 7.0)))
    tune(CONFIG, tmp_path, 3, GAMMA)
    assert load(tmp_path / "best.yaml").ppo.gamma == float(rows(tmp_path)[0]["ppo.gamma"])


def test_no_trial_is_pruned_while_policies_hold_nothing_yet(monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0)))
    tune(load("rprp_reach_ppo", [*SMALL, "total_steps=8192"]), tmp_path, 20, GAMMA)
    pruned = [row for row in rows(tmp_path) if row["state"] == "pruned"]
    assert {row["env_steps"] for row in pruned} == {"2048"}  # 1024 is less than a fifth


@pytest.mark.parametrize("error", [FloatingPointError("no number"), RuntimeError("no number")])
def test_a_training_without_end_is_named_and_the_study_goes_on(error, monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0), {1: error}))
    tune(CONFIG, tmp_path, 3, GAMMA)
    assert [row["state"] for row in rows(tmp_path)] == ["complete", "refused", "complete"]
    assert rows(tmp_path)[1]["message"] == "no number"


def test_the_first_trial_has_the_values_of_the_configuration(by_gamma, tmp_path):
    tune(CONFIG, tmp_path, 2, ["ppo.gamma=0.5..0.99"])
    assert [float(row["ppo.gamma"]) == CONFIG.ppo.gamma for row in rows(tmp_path)] == [True, False]


def test_a_trial_below_the_median_is_pruned(monkeypatch, tmp_path):
    steps, train = [], fake_train(lambda ppo: (ppo.gamma, 1.0))

    def recorded(config, folder, progress, on_point):
        def point(step, hold, returned):
            steps.append((folder.name, step))
            on_point(step, hold, returned)

        train(config, folder, progress, point)

    monkeypatch.setattr(studies, "train", recorded)
    tune(CONFIG, tmp_path, 20, GAMMA)
    found = rows(tmp_path)
    assert {"complete", "pruned"} == {row["state"] for row in found}
    assert all(row["state"] == "complete" for row in found[: STARTUP_TRIALS + LEAST_AHEAD])
    for row in found:
        expected = [1024] if row["state"] == "pruned" else [1024, 2048, 2048]
        assert [step for name, step in steps if name == f"trial{row['trial']}"] == expected


def test_a_pruned_training_ends_at_its_point(tmp_path):
    from redundant_envs_train.training.train import train

    class Enough(Exception):
        pass

    def stop(steps, hold, returned):
        raise Enough

    with pytest.raises(Enough):
        train(CONFIG, tmp_path / "run", on_point=stop)
    assert (tmp_path / "run" / "selection.csv").read_text().splitlines()[1].startswith("1024,")
    assert (tmp_path / "run" / "policy.zip").is_file()


def test_trials_are_not_compared_at_equal_seconds(tmp_path):
    config = load("baselines/rprp_reach_td3")
    with pytest.raises(ValueError, match=r"max_seconds is 90; .* give max_seconds=null and total_steps"):
        tune(config, tmp_path / "out", 2)
    assert not (tmp_path / "out").exists()


def test_refused_settings_are_named_and_the_study_goes_on(by_gamma, tmp_path):
    tune(CONFIG, tmp_path, 6, ["ppo.batch_size=256|300"])
    found = {row["ppo.batch_size"]: row for row in rows(tmp_path)}
    assert found["256"]["state"] == "complete"
    assert found["300"]["state"] == "refused"
    assert found["300"]["message"].startswith("ppo.batch_size is 300; it must divide")
    with pytest.raises(
        ValueError, match=r"no value of ppo.batch_size 300\|301 .*: ppo.batch_size is 301; it"
    ):
        tune(CONFIG, tmp_path / "none", 2, ["ppo.batch_size=300|301"])


def test_a_killed_study_goes_on_as_if_it_had_not_been(by_gamma, monkeypatch, tmp_path):
    tune(CONFIG, tmp_path / "whole", 6, GAMMA)
    killed = tmp_path / "killed"
    breaks = {0: SystemExit(), 4: KeyboardInterrupt()}  # the first reports nothing, as after a kill
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0), breaks))
    with pytest.raises(SystemExit):
        tune(CONFIG, killed, 6, GAMMA)
    with pytest.raises(Stopped, match="stopped after 3 of 6 trials; the same command goes on"):
        tune(CONFIG, killed, 6, GAMMA)
    assert len(rows(killed)) == 5
    assert (killed / "best.yaml").is_file()  # what was found so far
    with (killed / studies.JOURNAL).open("ab") as file:
        file.write(b'{"op_code": 5, "half')  # of a line, as after a power cut
    tune(CONFIG, killed, 6, GAMMA)
    found = rows(killed)
    assert [row["trial"] for row in found if row["state"] == "stopped"] == ["0", "4"]
    others = [row for row in found if row["state"] != "stopped"]
    expected = rows(tmp_path / "whole")
    assert [{**row, "trial": k} for k, row in enumerate(others)] == [
        {**row, "trial": k} for k, row in enumerate(expected)
    ]
    assert (killed / "best.yaml").read_bytes() == (tmp_path / "whole" / "best.yaml").read_bytes()
    tune(CONFIG, killed, 7, GAMMA)  # more of them
    assert len(rows(killed)) == 9


@pytest.mark.parametrize(
    ("config", "searches", "seed", "word"),
    [
        (CONFIG, ["ppo.gamma=0.5..0.8"], 0, "--search ppo.gamma: '0.5..0.9'"),
        (CONFIG, [*GAMMA, "ppo.n_epochs=1..2"], 0, "--search ppo.n_epochs: None"),
        (CONFIG, GAMMA, 1, "--seed: 0"),
        (load("rprp_reach_ppo", [*SMALL, "ppo.ent_coef=0"]), GAMMA, 0, "ppo.ent_coef: 0.01"),
        (load("rprp_reach_ppo", [*SMALL, "seed=1"]), GAMMA, 0, "with seed: 0, and this one has 1"),
    ],
)
def test_another_study_does_not_go_on_in_the_folder(by_gamma, config, searches, seed, word, tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    with pytest.raises(ValueError, match="holds a study with") as error:
        tune(config, tmp_path, 2, searches, seed=seed)
    assert word in str(error.value)
    assert len(rows(tmp_path)) == 1


def test_a_study_does_not_go_on_with_another_simulator(by_gamma, monkeypatch, tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    monkeypatch.setattr(studies, "simulator_hash", lambda core: "another")
    with pytest.raises(ValueError, match=r"holds a study with simulator: .* and this one has 'another'"):
        tune(CONFIG, tmp_path, 2, GAMMA)


def test_a_folder_that_is_no_study_is_refused(by_gamma, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="is a file"):
        tune(CONFIG, tmp_path / "file", 1, GAMMA)
    with pytest.raises(ValueError, match="holds other files and no study"):
        tune(CONFIG, tmp_path, 1, GAMMA)
    tune(CONFIG, tmp_path / "study", 1, GAMMA)
    with studies._alone(tmp_path / "study"), pytest.raises(ValueError, match="another process tunes"):
        tune(CONFIG, tmp_path / "study", 2, GAMMA)
    (tmp_path / "study" / studies.JOURNAL).write_text('{"op_code": 0, "a"\n[]\n')
    with pytest.raises(ValueError, match="is damaged"):
        tune(CONFIG, tmp_path / "study", 2, GAMMA)


@pytest.mark.parametrize(("trials", "seed", "word"), [(0, 0, "trials is 0"), (1, -1, "seed is -1")])
def test_numbers_of_a_study_are_checked_before_anything_begins(trials, seed, word, tmp_path, capsys):
    command = ["tune", "rprp_reach_ppo", "--trials", str(trials), "--seed", str(seed)]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_best_yaml_is_plain(by_gamma, tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    assert yaml.safe_load((tmp_path / "best.yaml").read_text())["algo"] == "ppo"


def test_a_hold_success_that_is_none_is_damage(by_gamma, tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    journal = tmp_path / studies.JOURNAL
    text, count = re.subn(r'"values":\s*\[[\d.]+\]', '"values":[NaN]', journal.read_text())
    assert count == 1
    journal.write_text(text)
    with pytest.raises(ValueError, match="is damaged"):
        tune(CONFIG, tmp_path, 2, GAMMA)
