"""A training that is stopped, and run folders that are incomplete or damaged."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from run_folders import write_run

from redundant_envs_train.__main__ import main

ROOT = Path(__file__).parents[2]
SMALL = [
    "num_envs=64",
    "ppo.n_steps=16",
    "ppo.batch_size=512",
    "curve_episodes=10",
    "evaluation_episodes=20",
    "env_kwargs.max_episode_steps=20",
]
ENDLESS = ["total_steps=1000000000"]


def wait_for(holds, process, seconds=120.0):
    """Poll until a condition holds; the process must not end before."""
    end = time.monotonic() + seconds
    while not holds():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.05)


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.is_file() else []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process")
@pytest.mark.parametrize(
    ("number", "every"), [(signal.SIGTERM, 2000), pytest.param(signal.SIGINT, 10**9, marks=pytest.mark.long)]
)
def test_a_stopped_training_leaves_a_run(number, every, tmp_path, capsys):
    folder = tmp_path / "run"
    command = [
        sys.executable,
        "-m",
        "agents",
        "train",
        "rprp_reach_ppo",
        "--out",
        str(folder),
        *SMALL,
        *ENDLESS,
    ]
    with subprocess.Popen(
        [*command, f"curve_every={every}"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            # Once episodes are over, the training has begun.
            wait_for(lambda: len(lines(folder / "monitor.csv")) > 10, process)
            if every == 2000:
                wait_for((folder / "policy.zip").is_file, process)
            process.send_signal(number)
            _, error = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    (message,) = error.splitlines()
    assert "stopped after" in message
    assert f"Go on with: python -m agents resume {folder}" in message
    assert json.loads((folder / "training.json").read_text())["stopped"] is True
    head, *rows = lines(folder / "selection.csv")
    assert head == "env_steps,seconds,hold_success,touch_success,return"
    assert bool(rows) == (every == 2000)
    assert len({line.count(",") for line in lines(folder / "monitor.csv")[1:]}) == 1
    assert not list(folder.glob("*.part"))
    capsys.readouterr()
    assert main(["report", str(folder)]) == 0
    assert main(["play", str(folder), "--clip", str(tmp_path / "a.gif"), "--episodes", "1"]) == 0
    result = json.loads((folder / "evaluation.json").read_text())
    assert result["env_steps"] == json.loads((folder / "training.json").read_text())["env_steps"] > 0
    assert ("![learning_curve]" in (folder / "report.md").read_text()) == (every == 2000)
    assert main(["table", str(folder)]) == 2  # half a training is no result
    assert "was stopped" in capsys.readouterr().err


def test_a_second_request_interrupts_at_once():
    from redundant_envs_train.training.pool import stop_request

    outside = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        with stop_request() as stop:
            os.kill(os.getpid(), signal.SIGINT)
            assert stop.is_set()
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, outside)


def test_ctrl_c_elsewhere_is_one_line(monkeypatch, capsys):
    from redundant_envs import __main__ as library
    from redundant_envs_train.evidence import table

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(table, "table", interrupted)
    assert main(["table", "anything"]) == 130
    monkeypatch.setattr(library, "list_names", interrupted)
    assert library.main(["list"]) == 130
    assert capsys.readouterr().err.splitlines() == ["stopped", "redundant_envs: stopped"]


# ---- incomplete run folders ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small finished run."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    few = ["total_steps=4096", "curve_every=2000"]
    assert main(["train", "rprp_reach_ppo", *SMALL, *few, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def run(finished, tmp_path):
    """A copy of it to damage."""
    shutil.copytree(finished, tmp_path / "run")
    return tmp_path / "run"


READERS = ("evaluate", "report", "table", "play", "study stops")


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("kind", ["nothing", "empty", "file"])
def test_what_is_no_run_folder_is_named(command, kind, tmp_path, capsys):
    place = tmp_path / "place"
    if kind == "empty":
        place.mkdir()
    if kind == "file":
        place.write_text("text")
    clip = ["--clip", str(tmp_path / "a.gif")] if command == "play" else []
    assert main([*command.split(), str(place), *clip]) == 2
    error = capsys.readouterr().err
    assert str(place) in error
    assert "run folder" in error


CUT = "half of it"
DAMAGES = {
    # file, what is done to it, command that reads it, command that the message names
    "no policy": ("policy.zip", None, ("evaluate", "report", "play", "study stops"), "train"),
    "half a policy": ("policy.zip", CUT, ("evaluate", "report", "play", "study stops"), ""),
    "no configuration": ("config.yaml", None, ("evaluate", "report", "play", "study stops"), "train"),
    "no evaluation": ("evaluation.json", None, ("table",), "evaluate"),
    "half an evaluation": ("evaluation.json", CUT, ("table", "report"), "evaluate"),
    "a list for an evaluation": ("evaluation.json", "[1, 2]", ("table", "report"), "evaluate"),
    "an evaluation of texts": ("evaluation.json", '{"env": 3}', ("table", "report"), "evaluate"),
    "nested evaluation": ("evaluation.json", "[" * 100_000, ("table", "report"), "evaluate"),
    "half of the episodes": ("episodes.csv", CUT, ("report",), "evaluate"),
    "no selections": ("selection.csv", None, ("report",), "train"),
    "half a selection": ("selection.csv", "env_steps,seconds\n1,2,3,4\n1,2", ("report",), "train"),
    "selections of another kind": ("selection.csv", "a,b\n1,2\n", ("report",), "train"),
    "half of the facts": ("training.json", CUT, ("evaluate",), "train"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_missing_or_damaged_file_is_named_with_the_command_that_makes_it(damage, run, tmp_path, capsys):
    name, change, commands, remedy = DAMAGES[damage]
    path = run / name
    if change is None:
        path.unlink()
    elif change is CUT:
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2 - 1])
    else:
        path.write_text(change)
    for command in commands:
        clip = ["--clip", str(tmp_path / "a.gif")] if command == "play" else []
        anew = ["--overwrite"] if command == "report" else []
        assert main([*command.split(), str(run), *clip, *anew]) == 2
        error = capsys.readouterr().err
        assert name in error
        assert f"python -m agents {remedy}" in error or not remedy
        assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("env", "a\nb"), ("env", "x" * 100_000), ("env", []), ("algo", "p\n| p"), ("algo", "x" * 100_000),
        ("algo", {}), ("episodes", -1), ("episodes", 0), ("episodes", 10.5), ("episodes", True),
        ("episodes", 10**400), ("seed", -1), ("seed", 10**400), ("hold_success", 1.01),
        ("hold_success", -0.1),
        ("touch_success", 10**400), ("expert_hold_success", 2), ("median_distance", -1),
        ("median_distance", 10**400), ("expert_median_distance", 10**400), ("interval", [0.5, 10**400]),
        ("interval", [0.5, 1.5]), ("interval", [0.6, 0.5]), ("interval", [0.5]), ("env_steps", 10**400),
        ("env_steps", -5), ("train_seconds", 10**400), ("versions", {"torch": "a\nb"}),
        ("versions", {"torch": "x" * 100_000}), ("versions", []), ("machine", "a\nb"), ("machine", 3),
        ("date", "x" * 100_000), ("effort", -1), ("expert_time_to_hold", "soon"), ("mean_return", None),
    ],
)  # fmt: skip
def test_a_value_that_no_evaluation_has_is_refused_by_file_and_field(field, value, tmp_path, capsys):
    path = write_run(tmp_path / "run") / "evaluation.json"
    data = json.loads(path.read_text())
    assert main(["table", str(path.parent)]) == 0
    path.write_text(json.dumps({**data, field: value}))
    capsys.readouterr()
    assert main(["table", str(path.parent)]) == 2
    error = capsys.readouterr().err
    assert f"{path} has " in error
    assert f"as {field!r}; make it again" in error
    assert len(error.splitlines()) == 1
    assert len(error) < 1000


def test_a_report_evaluates_a_run_that_has_no_evaluation(run):
    before = json.loads((run / "evaluation.json").read_text())
    (run / "evaluation.json").unlink()
    (run / "episodes.csv").unlink()
    (run / "report.md").unlink()
    assert main(["report", str(run)]) == 0
    assert json.loads((run / "evaluation.json").read_text()) == before


def test_the_table_takes_runs_whose_training_is_unknown(run, capsys):
    (run / "training.json").unlink()
    assert main(["evaluate", str(run), "--overwrite"]) == 0
    capsys.readouterr()
    assert main(["table", str(run)]) == 0
    assert "| - | - | - |" in capsys.readouterr().out  # steps, seconds, steps per second


def test_a_run_is_not_written_over_a_file(tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    for out in (tmp_path / "taken", tmp_path / "taken" / "run"):
        assert main(["train", "rprp_reach_ppo", *SMALL, "--out", str(out)]) == 2
        assert "taken" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_place_for_results_that_cannot_be_is_told_before_anything_begins(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for out, word in ((tmp_path / "file", "is a file"), (tmp_path / "file" / "x", "is below the file")):
        for command in (
            ["train", "rprp_reach_ppo"],
            ["train", "rprp_reach_ppo", "--seeds", "0..1"],
            ["study", "strength", "--seeds", "none"],
        ):
            assert main([*command, "--out", str(out)]) == 2
            err = capsys.readouterr().err
            assert err.startswith(f"error: out is {out}, which {word}")
            assert err.count("\n") == 1


def test_a_command_can_be_pasted_although_its_folder_has_a_space(tmp_path, capsys):
    folder = write_run(tmp_path / "my run")
    (folder / "evaluation.json").unlink()
    assert main(["table", str(folder)]) == 2
    assert f"python -m agents evaluate '{folder}' --overwrite" in capsys.readouterr().err


def test_a_curve_of_other_columns_is_damaged(tmp_path, capsys):
    folder = write_run(tmp_path / "run")
    (folder / "selection.csv").write_text("a,b\n")
    assert main(["table", str(folder)]) == 2
    assert "its columns are 'a,b' instead of env_steps,seconds" in capsys.readouterr().err


def test_a_table_is_written_as_csv_only(tmp_path, capsys):
    folder = write_run(tmp_path / "run")
    assert main(["table", str(folder), "--out", str(tmp_path / "a.txt")]) == 2
    assert "a.txt; end its name in .csv" in capsys.readouterr().err
    assert main(["table", str(folder), "--out", str(tmp_path / "new" / "a.csv")]) == 0
    assert (tmp_path / "new" / "a.csv").is_file()
