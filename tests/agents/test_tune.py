"""Tuning: search spaces, continued studies, and several trials at a time with the results of one."""

import contextlib
import re

import pytest
import yaml
from run_folders import REFUSALS, csv_rows, says
from short_trainings import TINY

from redundant_envs.disk import alone
from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.presets import presets
from redundant_envs_train.rollout import SELECTION_SEED
from redundant_envs_train.run_folder import CHECKPOINT
from redundant_envs_train.training import watch
from redundant_envs_train.training.pool import Stopped
from redundant_envs_train.training.train import train

pytest.importorskip("optuna", reason="optuna is not installed; pip install '.[tune]'")

import optuna
from optuna.distributions import FloatDistribution, IntDistribution

from redundant_envs_train.tuning import study as studies
from redundant_envs_train.tuning.search import check_arguments, own_parameters, space_of, with_parameters
from redundant_envs_train.tuning.study import LEAST_AHEAD, tune
from redundant_envs_train.tuning.trials import STARTUP_TRIALS, SharedJudge, score
from redundant_envs_train.tuning.workers import Worker

pytestmark = pytest.mark.long

SMALL = [*TINY, "total_steps=2048", "curve_every=1024"]
CONFIG = load("rprp_reach_ppo", SMALL)
GAMMA = ["ppo.gamma=0.5..0.9"]


def rows(folder):
    """trials.csv without the seconds, which differ from run to run."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in csv_rows(folder / "trials.csv")]


def interrupted(*given, **more):
    raise KeyboardInterrupt


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
    picked = {"ppo.net_arch": "[32]", "ppo.activation": "tanh", "ppo.average": "0"}
    chosen = with_parameters(CONFIG, space, picked)
    assert (chosen.ppo.net_arch, chosen.ppo.activation, chosen.ppo.average) == ((32,), "tanh", 0.0)
    assert own_parameters(CONFIG, space) == {
        "ppo.net_arch": "[64, 64]", "ppo.activation": "silu", "ppo.average": "0.9"
    }  # fmt: skip


@pytest.mark.parametrize(("text", "word"), REFUSALS["search"])
def test_what_is_no_search_is_refused(text, word):
    with says(word):
        space_of(CONFIG, [text])


def test_a_setting_is_searched_once_where_it_has_no_value_and_trials_are_compared_at_equal_steps():
    assert "ppo.gamma" in space_of(CONFIG)
    assert "ppo.gamma" not in space_of(CONFIG, [], ["ppo.gamma=0.9"])
    tqc = load("baselines/rprp_reach_tqc", ["tqc.top_quantiles_to_drop_per_net=2"])
    many = "ppo.gamma=" + "|".join(str(k / 1000) for k in range(101))
    for check, arguments, word in (
        (space_of, (CONFIG, GAMMA, ["ppo.gamma=0.9"]), "has a value and is searched"),
        (space_of, (CONFIG, GAMMA * 2), "twice"), (space_of, (CONFIG, [many]), "2 to 100 values"),
        (space_of, (tqc, ["tqc.n_quantiles=1..2"]), "no value of tqc.n_quantiles "),
        (check_arguments, (load("baselines/rprp_reach_td3"), 2, 0, 1),
         "max_seconds is 90; trials are compared at equal steps: give max_seconds=null and total_steps"),
    ):  # fmt: skip
        with says(word):
            check(*arguments)


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


def test_a_study_of_trainings_leaves_the_evaluation_goals_alone(tmp_path, monkeypatch, call):
    goals, run_episodes = [], watch.run_episodes

    def recorded(env, act, episodes, seed, **kwargs):
        goals.append(seed)
        return run_episodes(env, act, episodes, seed, **kwargs)

    monkeypatch.setattr(watch, "run_episodes", recorded)
    search = ["--search", "ppo.learning_rate=1e-3..1e-2", "--search", "ppo.n_epochs=1|2"]
    page, _ = call("tune", "rprp_reach_ppo", *TINY, "--trials", 2, *search, "--out", tmp_path)
    assert "| trial | hold success | mean return | ppo.learning_rate | ppo.n_epochs |" in page
    found = rows(tmp_path)
    assert [row["state"] for row in found] == ["complete"] * 2
    assert found[0]["ppo.learning_rate"] != found[1]["ppo.learning_rate"]
    assert [(row["hold_success"], row["env_steps"]) for row in found] == [
        (str(float(points[-1][1])), points[-1][0]) for points in (curve(tmp_path, k) for k in range(2))
    ]
    assert set(goals) == {SELECTION_SEED}
    assert not list(tmp_path.glob("**/evaluation.json"))


@pytest.fixture(scope="module")
def one_by_one(tmp_path_factory):
    """A study of 24 trials, one at a time."""
    folder = tmp_path_factory.mktemp("one")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0)))
        tune(CONFIG, folder, 24, GAMMA)
    return folder


def test_the_best_of_a_study_is_a_configuration_of_its_own(one_by_one, by_gamma, tmp_path):
    assert not list(one_by_one.glob(f"*/{CHECKPOINT}"))  # nothing goes on with them
    best, page = load(one_by_one / "best.yaml"), (one_by_one / "tune.md").read_text()
    assert best.ppo.gamma == max(float(row["ppo.gamma"]) for row in rows(one_by_one))
    assert best.model_copy(update={"ppo": CONFIG.ppo}) == CONFIG
    assert "| ppo.gamma | 100 % |" in page
    assert f" | {100 * best.ppo.gamma:.1f} % | 1.0 | {best.ppo.gamma:.4g} |" in page
    few = tune(CONFIG, tmp_path, 5, GAMMA).read_text()
    assert "Importance" not in few  # with so few trials there is none to report


def test_a_trial_below_the_median_is_pruned(one_by_one):
    found = rows(one_by_one)
    assert all(row["state"] == "complete" for row in found[: STARTUP_TRIALS + LEAST_AHEAD])
    ends = {(row["state"], row["env_steps"]) for row in found}
    assert ends == {("complete", "2048"), ("pruned", "1024")}


@pytest.mark.usefixtures("by_gamma")
def test_no_trial_is_pruned_while_policies_hold_nothing_yet(tmp_path):
    tune(load("rprp_reach_ppo", [*SMALL, "total_steps=8192"]), tmp_path, 20, GAMMA)
    pruned = [row for row in rows(tmp_path) if row["state"] == "pruned"]
    assert {row["env_steps"] for row in pruned} == {"2048"}  # 1024 is less than a fifth


def test_a_training_without_end_and_refused_settings_are_named_and_the_study_goes_on(monkeypatch, tmp_path):
    """The first trial has the values of the configuration; of equal ones the first is the best."""
    breaks = {1: FloatingPointError("no number"), 2: RuntimeError("no end")}
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (0.5, 7.0), breaks))
    tune(CONFIG, tmp_path / "a", 4, ["ppo.gamma=0.5..0.99"])
    found = rows(tmp_path / "a")
    assert [row["state"] for row in found] == ["complete", "refused", "refused", "complete"]
    assert [row["message"] for row in found[1:3]] == ["no number", "no end"]
    own = [float(row["ppo.gamma"]) == CONFIG.ppo.gamma for row in found]
    assert own == [True, False, False, False]
    assert load(tmp_path / "a" / "best.yaml").ppo.gamma == CONFIG.ppo.gamma
    tune(CONFIG, tmp_path / "b", 6, ["ppo.batch_size=256|300"])
    by_size = {row["ppo.batch_size"]: row for row in rows(tmp_path / "b")}
    assert [by_size[size]["state"] for size in ("256", "300")] == ["complete", "refused"]
    assert by_size["300"]["message"].startswith("ppo.batch_size is 300; it must divide")
    with pytest.raises(ValueError, match=r"no value of ppo.batch_size 300\|301 .*batch_size is 301; it"):
        tune(CONFIG, tmp_path / "none", 2, ["ppo.batch_size=300|301"])


def test_a_pruned_training_ends_at_its_point(tmp_path):
    def stop(steps, hold, returned):
        raise EOFError

    with pytest.raises(EOFError):
        train(CONFIG, tmp_path / "run", on_point=stop)
    assert (tmp_path / "run" / "selection.csv").read_text().splitlines()[1].startswith("1024,")
    assert (tmp_path / "run" / "policy.zip").is_file()


def test_a_killed_study_goes_on_as_if_it_had_not_been(one_by_one, monkeypatch, tmp_path):
    breaks = {0: SystemExit(), 4: KeyboardInterrupt()}  # the first reports nothing, as after a kill
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (ppo.gamma, 1.0), breaks))
    with pytest.raises(SystemExit):
        tune(CONFIG, tmp_path, 6, GAMMA)
    with pytest.raises(Stopped, match="stopped after 3 of 6 trials; the same command goes on"):
        tune(CONFIG, tmp_path, 6, GAMMA)
    assert len(rows(tmp_path)) == 5
    assert (tmp_path / "best.yaml").is_file()  # what was found so far
    with (tmp_path / studies.JOURNAL).open("ab") as file:
        file.write(b'{"op_code": 5, "half')  # of a line, as after a power cut
    for trials in (6, 7):  # first the rest, and then more of them
        tune(CONFIG, tmp_path, trials, GAMMA)
        found = rows(tmp_path)
        assert [row["trial"] for row in found if row["state"] == "stopped"] == ["0", "4"]
        others = [row for row in found if row["state"] != "stopped"]
        assert [{**row, "trial": f"{k}"} for k, row in enumerate(others)] == rows(one_by_one)[:trials]
        assert load(tmp_path / "best.yaml").ppo.gamma == max(float(row["ppo.gamma"]) for row in others)


@pytest.mark.usefixtures("by_gamma")
def test_another_study_does_not_go_on_in_the_folder(tmp_path, monkeypatch):
    tune(CONFIG, tmp_path, 1, GAMMA)
    by_default, seed1 = (load("rprp_reach_ppo", [*SMALL, more]) for more in ("ppo.ent_coef=0", "seed=1"))
    for config, searches, seed, word in (
        (CONFIG, ["ppo.gamma=0.5..0.8"], 0, "--search ppo.gamma: '0.5..0.9'"),
        (CONFIG, [*GAMMA, "ppo.n_epochs=1..2"], 0, "--search ppo.n_epochs: None"),
        (CONFIG, GAMMA, 1, "--seed: 0"), (by_default, GAMMA, 0, "ppo.ent_coef: 0.01"),
        (seed1, GAMMA, 0, "with seed: 0, and this one has 1"),
    ):  # fmt: skip
        with says("holds a study with", word):
            tune(config, tmp_path, 2, searches, seed=seed)
    with says("processes is 5, and the study ", "begun for at most 4 at a time"):
        tune(CONFIG, tmp_path, 2, GAMMA, processes=5)
    monkeypatch.setattr(studies, "simulator_hash", lambda core: "another")
    with says("holds a study with simulator: ", " and this one has 'another'"):
        tune(CONFIG, tmp_path, 2, GAMMA)
    assert len(rows(tmp_path)) == 1


@pytest.mark.usefixtures("by_gamma")
def test_a_folder_that_is_no_study_is_refused(tmp_path):
    (tmp_path / "file").touch()
    folder = tmp_path / "study"
    tune(CONFIG, folder, 1, GAMMA)
    journal = folder / studies.JOURNAL
    text, count = re.subn(r'"values":\s*\[[\d.]+\]', '"values":[NaN]', journal.read_text())
    assert count == 1
    with alone(folder, "tunes"), says("another process tunes"):
        tune(CONFIG, folder, 2, GAMMA)
    for place, content, word in (
        (tmp_path / "file", "", "is a file"), (tmp_path, "", "holds other files and no study"),
        (folder, text, "is damaged"), (folder, '{"op_code": 0, "a"\n[]\n', "is damaged"),
    ):  # fmt: skip
        journal.write_text(content or journal.read_text())
        with says(word):
            tune(CONFIG, place, 2, GAMMA)


@pytest.mark.usefixtures("by_gamma")
@pytest.mark.parametrize("storage", ["sqlite:///{}/study.db", "{}/study.journal"])
def test_machines_share_a_study_in_a_storage(storage, tmp_path):
    place = storage.format(tmp_path)
    tune(CONFIG, tmp_path / "a", 2, GAMMA, storage=place)
    tune(CONFIG, tmp_path / "b", 3, GAMMA, storage=place)
    assert [sorted(p.name for p in (tmp_path / m).glob("trial?")) for m in "ab"] == [
        ["trial0", "trial1"], ["trial2"]
    ]  # fmt: skip
    found = rows(tmp_path / "b")
    assert found[:2] == rows(tmp_path / "a")
    assert [row["trial"] for row in found] == ["0", "1", "2"]
    assert load(tmp_path / "b" / "best.yaml").ppo.gamma == max(float(row["ppo.gamma"]) for row in found)
    with says("holds a study with", "--search ppo.gamma"):
        tune(CONFIG, tmp_path / "c", 4, ["ppo.gamma=0.5..0.8"], storage=place)
    with says("out is", "which holds other files and no study"):  # those of a study of its own
        tune(CONFIG, tmp_path / "own", 1, GAMMA)
        tune(CONFIG, tmp_path / "own", 2, GAMMA, storage=place)
    with says("which has trials of another storage"):
        tune(CONFIG, tmp_path / "a", 3, GAMMA, storage=f"{place}2")
    with says("processes is 2 beside a storage"):
        tune(CONFIG, tmp_path / "c", 4, GAMMA, processes=2, storage=place)


def test_a_study_does_not_replace_the_configuration_that_it_searches(tmp_path, refused):
    best = tmp_path / "best.yaml"
    best.write_text(yaml.safe_dump(CONFIG.to_dict()))
    refused(["tune", best, "--trials", "1", "--out", tmp_path], "best.yaml", "is what the command reads")
    assert [*tmp_path.iterdir()] == [best]


def test_of_machines_that_begin_a_study_at_once_one_tries_the_values_of_the_configuration(
    tmp_path, monkeypatch
):
    config = load("rprp_reach_ppo", [*SMALL, "ppo.gamma=0.7"])
    space = space_of(config, GAMMA, [])
    place = f"sqlite:///{tmp_path}/study.db"
    both = [studies._open(tmp_path / name, config, space, 0, 1, place) for name in "ab"]
    monkeypatch.setattr(optuna.Study, "get_trials", lambda *given, **more: [])  # neither knows of the other
    judges = [SharedJudge(study, config, space) for study in both]
    assert [judge.order for judge in judges] == [0, 1]
    assert [judge.trial.params["ppo.gamma"] == 0.7 for judge in judges] == [True, False]


@pytest.mark.usefixtures("by_gamma")
def test_a_stop_fails_the_own_trial_alone_and_a_storage_that_cannot_be_opened_is_told(tmp_path, monkeypatch):
    place = f"{tmp_path}/study.journal"
    tune(CONFIG, tmp_path / "a", 1, GAMMA, storage=place)
    study = optuna.load_study(
        study_name="tune", storage=studies.JournalStorage(studies.JournalFileBackend(place))
    )
    other = study.ask()
    other.set_user_attr("order", other.number)
    monkeypatch.setattr(studies, "train", interrupted)
    with pytest.raises(Stopped):
        tune(CONFIG, tmp_path / "b", 2, GAMMA, storage=place)
    assert [t.state.name for t in study.get_trials(deepcopy=False)] == ["COMPLETE", "RUNNING", "FAIL"]
    with says("sqlite:////nowhere/study.db"):
        tune(CONFIG, tmp_path / "c", 2, GAMMA, storage="sqlite:////nowhere/study.db")


@pytest.mark.usefixtures("by_gamma")
def test_a_storage_that_is_no_journal_keeps_its_content_and_half_a_line_is_cut_off(tmp_path):
    journal, notes, link = tmp_path / "study.journal", tmp_path / "notes", tmp_path / "link"
    tune(CONFIG, tmp_path / "a", 1, GAMMA, storage=str(journal))
    link.symlink_to(journal)
    whole = journal.read_bytes()
    for text in ("my notes", '{"a": 1}\n'):
        notes.write_text(text)
        for place in (notes, link):
            with says(f"storage is {place}, which is no journal"):
                tune(CONFIG, tmp_path / "a", 2, GAMMA, storage=str(place))
        assert (notes.read_text(), journal.read_bytes()) == (text, whole)
    journal.write_bytes(whole + whole[: len(whole) // 2].rpartition(b"\n")[2] + b'{"op_code": 5, "wor')
    tune(CONFIG, tmp_path / "a", 2, GAMMA, storage=str(journal))
    assert [row["trial"] for row in rows(tmp_path / "a")] == ["0", "1"]
    assert journal.read_bytes().startswith(whole)


# ---- several trials at a time ----------------------------------------------------------------------


def test_the_return_breaks_ties_and_nothing_else():
    returns = [-1e300, -80.0, -1e-9, 0.0, 1e-9, 78.5, 78.6, 1e6, 1e300, float("inf")]
    for hold in (0.0, 0.98):
        scores = [score(hold, returned, 500) for returned in returns]
        assert scores == sorted(set(scores))
        assert scores[-1] < score(hold + 1 / 500, -1e300, 500)
        for unknown in (float("nan"), None):
            assert score(hold, unknown, 500) < scores[0]


def test_among_trials_that_hold_nothing_the_return_decides(monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "train", fake_train(lambda ppo: (0.0, -((ppo.gamma - 0.7) ** 2))))
    page = tune(CONFIG, tmp_path, 24, GAMMA).read_text()
    found = rows(tmp_path)
    best = max(found, key=lambda row: float(row["return"]))
    assert load(tmp_path / "best.yaml").ppo.gamma == float(best["ppo.gamma"])
    assert abs(float(best["ppo.gamma"]) - 0.7) < 0.02  # the search follows it, too
    assert {"complete", "pruned"} == {row["state"] for row in found}
    assert f"| {best['trial']} | 0.0 % | " in page


@pytest.mark.long  # processes of torch take seconds to begin; below they are replaced
def test_two_processes_find_what_one_finds(tmp_path):
    search = ["ppo.learning_rate=1e-4..1e-1"]
    for processes in (1, 2):
        tune(CONFIG, tmp_path / str(processes), 3, search, processes=processes)
    one, two = tmp_path / "1", tmp_path / "2"
    assert rows(one) == rows(two)
    assert [curve(one, k) for k in range(3)] == [curve(two, k) for k in range(3)]
    assert (one / "best.yaml").read_bytes() == (two / "best.yaml").read_bytes()


class Pipe:
    """Connection to a simulated process: it reports points until they end or it is pruned."""

    def send(self, message):
        if isinstance(message, bool):
            self.pruned = message
            self.points = [] if message else self.points
        else:
            self.settings, self.pruned = checked(Config, message[0]).ppo, False
            self.points = [1024, 2048, 2048]


class Team:
    """Replaces processes; ``pick``, of orders, chooses which of the busy ones reports next."""

    def __init__(self, pick, stop_after=10**9):
        self.pick, self.left, self.most = pick, stop_after, 0

    @contextlib.contextmanager
    def workers(self, count, config):
        yield [Worker(None, Pipe()) for _ in range(count)]

    def news(self, team):
        busy = [worker for worker in team if worker.order is not None]
        self.most = max(self.most, len(busy))
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        worker = self.pick(busy, key=lambda worker: worker.order)
        if not worker.pipe.points:
            return [(worker, ("end", None if worker.pipe.pruned else ""))]
        return [(worker, ("point", (worker.pipe.points.pop(0), worker.pipe.settings.gamma, 1.0)))]

    def replace(self, monkeypatch):
        monkeypatch.setattr(studies, "workers", self.workers)
        monkeypatch.setattr(studies, "news", self.news)
        return self


@pytest.mark.parametrize(("pick", "processes"), [(max, 4), (min, 2)])  # the youngest, the oldest
def test_a_study_is_the_same_whichever_trial_ends_first(pick, processes, one_by_one, monkeypatch, tmp_path):
    team = Team(pick).replace(monkeypatch)
    tune(CONFIG, tmp_path, 24, GAMMA, processes=processes)
    assert team.most == processes
    assert rows(tmp_path) == rows(one_by_one)


@pytest.mark.usefixtures("by_gamma")
def test_a_study_of_several_goes_on_after_a_stop_as_if_there_had_been_none(one_by_one, monkeypatch, tmp_path):
    Team(max, stop_after=45).replace(monkeypatch)
    with pytest.raises(Stopped, match="the same command goes on"):
        tune(CONFIG, tmp_path, 24, GAMMA, processes=4)
    assert [row["state"] for row in rows(tmp_path)].count("stopped") == 1  # and later ones ended
    tune(CONFIG, tmp_path, 24, GAMMA)  # one at a time, from here on
    found, whole = (
        sorted((row["ppo.gamma"], row["state"]) for row in rows(folder) if row["state"] != "stopped")
        for folder in (tmp_path, one_by_one)
    )
    assert found == whole
    assert (tmp_path / "best.yaml").read_bytes() == (one_by_one / "best.yaml").read_bytes()


@pytest.mark.usefixtures("by_gamma")
def test_a_process_that_ends_is_named_and_the_study_goes_on(monkeypatch, tmp_path):
    class Dead:
        exitcode = -9

    def news(team):
        team[0].process = Dead
        return [(team[0], None)]

    Team(min).replace(monkeypatch)
    monkeypatch.setattr(studies, "news", news)
    with pytest.raises(ValueError, match=r"the process of trial 0 ended \(-9\); the same command goes on"):
        tune(CONFIG, tmp_path, 3, GAMMA, processes=2)
    tune(CONFIG, tmp_path, 3, GAMMA)
    assert [row["state"] for row in rows(tmp_path)] == ["stopped", "stopped", *["complete"] * 3]
