"""Tuning: ties that the return breaks, and several trials at a time, with the results of one at a time."""

import contextlib

import pytest
from test_tune import CONFIG, GAMMA, by_gamma, curve, fake_train, rows  # noqa: F401 - by_gamma is a fixture

from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.training.pool import Stopped
from redundant_envs_train.tuning import study as studies
from redundant_envs_train.tuning.search import space_of
from redundant_envs_train.tuning.study import tune
from redundant_envs_train.tuning.trials import Judge, score
from redundant_envs_train.tuning.workers import Worker


def test_a_point_that_is_met_twice_is_one_point():
    optuna = pytest.importorskip("optuna")
    study = optuna.create_study(direction="maximize")
    one = Judge(study, CONFIG, space_of(CONFIG, GAMMA), 0, ahead=3, seed=0)
    for steps in (512, 1024, 1024, 2048):
        assert not one.add(steps, 0.5, 7.0)
    assert [steps for steps, *_ in one.points] == [512, 1024, 2048]


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
    """Replaces processes; ``pick`` chooses which of the busy ones reports next."""

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
        worker = self.pick(busy)
        if not worker.pipe.points:
            return [(worker, ("end", None if worker.pipe.pruned else ""))]
        return [(worker, ("point", (worker.pipe.points.pop(0), worker.pipe.settings.gamma, 1.0)))]

    def replace(self, monkeypatch):
        monkeypatch.setattr(studies, "workers", self.workers)
        monkeypatch.setattr(studies, "news", self.news)
        return self


def youngest(busy):
    return max(busy, key=lambda worker: worker.order)


def oldest(busy):
    return min(busy, key=lambda worker: worker.order)


@pytest.mark.usefixtures("by_gamma")
@pytest.mark.parametrize("processes", [2, 4])
@pytest.mark.parametrize("pick", [youngest, oldest])
def test_a_study_is_the_same_whichever_trial_ends_first(pick, processes, monkeypatch, tmp_path):
    tune(CONFIG, tmp_path / "one", 24, GAMMA)
    team = Team(pick).replace(monkeypatch)
    tune(CONFIG, tmp_path / "several", 24, GAMMA, processes=processes)
    assert team.most == processes
    assert rows(tmp_path / "several") == rows(tmp_path / "one")
    assert "pruned" in {row["state"] for row in rows(tmp_path / "one")}


@pytest.mark.usefixtures("by_gamma")
def test_a_study_of_several_goes_on_after_a_stop_as_if_there_had_been_none(monkeypatch, tmp_path):
    tune(CONFIG, tmp_path / "whole", 20, GAMMA)
    Team(youngest, stop_after=45).replace(monkeypatch)
    with pytest.raises(Stopped, match="the same command goes on"):
        tune(CONFIG, tmp_path / "stopped", 20, GAMMA, processes=4)
    assert [row["state"] for row in rows(tmp_path / "stopped")].count("stopped") == 1  # and later ones ended
    tune(CONFIG, tmp_path / "stopped", 20, GAMMA)  # one at a time, from here on
    found, whole = (
        sorted((row["ppo.gamma"], row["state"]) for row in rows(tmp_path / name) if row["state"] != "stopped")
        for name in ("stopped", "whole")
    )
    assert found == whole
    assert (tmp_path / "stopped/best.yaml").read_bytes() == (tmp_path / "whole/best.yaml").read_bytes()


@pytest.mark.usefixtures("by_gamma")
def test_more_at_a_time_than_a_study_was_begun_for_is_refused(tmp_path):
    tune(CONFIG, tmp_path, 1, GAMMA)
    with pytest.raises(ValueError, match=r"processes is 5, and the study .* begun for at most 4 at a time"):
        tune(CONFIG, tmp_path, 2, GAMMA, processes=5)


@pytest.mark.usefixtures("by_gamma")
def test_a_process_that_ends_is_named_and_the_study_goes_on(monkeypatch, tmp_path):
    class Dead:
        exitcode = -9

    def news(team):
        team[0].process = Dead
        return [(team[0], None)]

    Team(oldest).replace(monkeypatch)
    monkeypatch.setattr(studies, "news", news)
    with pytest.raises(ValueError, match=r"the process of trial 0 ended \(-9\); the same command goes on"):
        tune(CONFIG, tmp_path, 3, GAMMA, processes=2)
    tune(CONFIG, tmp_path, 3, GAMMA)
    assert [row["state"] for row in rows(tmp_path)] == ["stopped", "stopped", *["complete"] * 3]
