"""Several seeds in separate processes."""

import json
import os
import queue
import signal

import pytest
from published_runs import published_run
from rich.progress import Progress
from run_folders import assert_same_policy

from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.run_folder import CHECKPOINT
from redundant_envs_train.training import many
from redundant_envs_train.training.many import FILES, finish, is_finished
from redundant_envs_train.training.pool import follow, seeds_of
from redundant_envs_train.training.train import train

SMALL = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=1024", "curve_episodes=5",
    "evaluation_episodes=10", "env_kwargs.max_episode_steps=20",
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("0..3", [0, 1, 2, 3]),
        ("5", [5]),
        ("1, 4,7", [1, 4, 7]),
        ("0..1,9", [0, 1, 9]),
        ("98..101", [98, 99, 100, 101]),
        ("9999", [9999]),
    ],
)
def test_seeds_are_read_as_they_are_written(text, seeds):
    assert seeds_of(text) == seeds


@pytest.mark.parametrize(
    "text", ["", "a", "3..1", "9..3,3", "1,1", "0..2,1", "10000", "-1", "1..", "0..999999999", "1;2"]
)
def test_other_seeds_are_refused(text):
    with pytest.raises(ValueError, match="seeds is"):
        seeds_of(text)


def test_seeds_in_processes_are_the_runs_they_are_alone(tmp_path, capsys):
    out = tmp_path / "runs"
    command = ["train", "rprp_reach_ppo", *SMALL, "--seeds", "3,4", "--processes", "2", "--out", str(out)]
    assert main(command) == 0
    assert "| RPRPReach-v0 | PPO | 2 |" in capsys.readouterr().out
    train(load("rprp_reach_ppo", [*SMALL, "seed=4"]), tmp_path / "alone")
    assert_same_policy(tmp_path / "alone", out / "seed4")


@pytest.mark.parametrize(
    ("more", "word"),
    [(["--processes", "2"], "give --seeds"), (["--seeds", "1", "--processes", "0"], "processes is 0")],
)
def test_processes_are_checked_before_anything_begins(more, word, tmp_path, capsys):
    assert main(["train", "rprp_reach_ppo", *more, "--out", str(tmp_path / "out")]) == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_what_is_finished_stays_and_what_was_stopped_or_killed_early_does_not(tmp_path):
    folder, config = tmp_path / "seed3", load("rprp_reach_ppo", [*SMALL, "seed=3"])
    silent = Progress(disable=True)
    finish(config, folder, silent)
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    finish(config, folder, silent)
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before
    facts = json.loads((folder / "training.json").read_text())
    (folder / "training.json").write_text(json.dumps({**facts, "stopped": True, "env_steps": 5}))
    finish(config, folder, silent)
    assert json.loads((folder / "training.json").read_text())["env_steps"] == 1024
    (folder / "training.json").unlink()  # killed before its first checkpoint
    (folder / "report.md").unlink()
    finish(config, folder, silent)
    assert json.loads((folder / "training.json").read_text())["stopped"] is False
    assert (folder / "report.md").is_file()


def test_a_run_of_other_settings_or_a_failed_one_is_told_in_one_line(tmp_path, capsys):
    out = tmp_path / "runs"
    train(load("rprp_reach_ppo", [*SMALL, "seed=3"]), out / "seed3")
    command = ["train", "rprp_reach_ppo", *SMALL, "--seeds", "3", "--out", str(out)]
    assert main([*command, "ppo.gamma=0.5"]) == 2
    assert "another configuration" in capsys.readouterr().err
    assert main([*command, "seed=1"]) == 2
    assert "seed is given beside --seeds" in capsys.readouterr().err
    (tmp_path / "full" / "seed3").mkdir(parents=True)
    (tmp_path / "full" / "seed3" / "mine").touch()
    assert main([*command[:-1], str(tmp_path / "full")]) == 2
    assert "1 of 1 runs failed" in capsys.readouterr().err.splitlines()[-1]


def test_a_checkpoint_means_that_a_run_is_not_finished(tmp_path):
    published_run("rprp_reach_ppo/seed130", tmp_path / "run")
    assert is_finished(tmp_path / "run") is False  # no report
    for name in FILES:
        (tmp_path / "run" / name).touch()
    assert is_finished(tmp_path / "run")
    (tmp_path / "run" / CHECKPOINT).mkdir()
    (tmp_path / "run" / CHECKPOINT / "state.pt").touch()
    assert not is_finished(tmp_path / "run")


class Ended:
    """A process that ended by itself."""

    exitcode = -9

    def is_alive(self):
        return False


def test_a_run_whose_process_was_killed_is_named():
    news = queue.Queue()
    news.put(("seed0", 1.0, "holds 99.0 %", False))
    news.put(("seed1", 0.3, "", False))
    news.put(("seed2", 1.0, "no room", True))
    names = ["seed0", "seed1", "seed2"]
    with pytest.raises(
        ValueError, match=r"^2 of 3 runs .*: seed2: no room; seed1: its process ended \(-9\)$"
    ):
        follow(names, lambda stop: many._reports(names, [Ended()], news, stop))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no affinity of cores")
@pytest.mark.parametrize("core", [None, 0])
def test_a_worker_stays_on_its_core(core, monkeypatch):
    pinned = []
    monkeypatch.setattr(os, "sched_setaffinity", lambda pid, cores: pinned.append(cores))
    monkeypatch.setattr(signal, "signal", lambda *args: None)
    jobs = queue.Queue()
    jobs.put(None)
    many._work(jobs, queue.Queue(), core)
    assert pinned == ([] if core is None else [{core}])
