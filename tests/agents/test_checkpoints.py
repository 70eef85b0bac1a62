"""A training that is killed at any moment continues to the same bits."""

import contextlib
import errno
import io
import json
import os
import shutil
import struct
import sys
import zipfile
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from run_folders import POLICIES, TUNES, Evil, change, csv_rows, kept, members, write_members
from short_trainings import CASES, REPLAY, assert_same_policy, kill, small_config
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.support.disk import DiskFull, alone
from redundant_envs_train import command
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import SELECTION_SEED, policy_act, run_episodes
from redundant_envs_train.run_folder import find_checkpoint
from redundant_envs_train.training import checkpoint
from redundant_envs_train.training.pool import Stopped
from redundant_envs_train.training.train import resume, train
from redundant_envs_train.training.watch import Watch

LONG = pytest.mark.long


@contextlib.contextmanager
def changed_state(folder):
    """The state of a checkpoint, which is written again."""
    path = folder / "checkpoint" / "state.pt"
    state = checkpoint.unplain(torch.load(path, weights_only=True))
    yield state
    torch.save(checkpoint.plain(state), path)


@pytest.mark.quick("ppo")
@pytest.mark.parametrize("case", [c if c in ("ppo", "sac") else pytest.param(c, marks=LONG) for c in CASES])
def test_a_killed_training_goes_on_to_the_same_bits(case, begun, tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(small_config(case), whole)
    if case == "sac":
        shutil.copytree(begun, killed)
    else:
        kill(killed, case, {"her": 3800}.get(case, 1900), checkpoint_seconds=1e-9)
    with changed_state(killed) as state:
        state["elapsed"] += 1000.0
    np.random.rand()  # what happened in between does not matter
    torch.rand(3)
    assert resume(killed)["env_steps"] >= small_config(case).total_steps
    assert_same_policy(whole, killed)
    for name, seconds in (("selection.csv", "seconds"), ("monitor.csv", "t")):
        assert csv_rows(whole / name, seconds) == csv_rows(killed / name, seconds)
    times = [float(row["t"]) for row in csv_rows(killed / "monitor.csv")]
    assert times == sorted(times)
    assert times[-1] > 1000.0
    assert not find_checkpoint(killed)


@pytest.mark.parametrize("points", [4, None])
def test_the_policy_of_the_best_point_is_kept_also_when_a_training_is_stopped(points, tmp_path, monkeypatch):
    config, point = small_config("best"), Watch.point

    def stop_after(self):
        point(self)
        if len(csv_rows(self.table)) == points:
            self.stop.set()

    monkeypatch.setattr(Watch, "point", stop_after)
    with pytest.raises(Stopped) if points else contextlib.nullcontext():
        train(config, tmp_path)
    returned = [float(row["return"]) for row in csv_rows(tmp_path / "selection.csv")]
    act = policy_act(load_policy(tmp_path, config))
    again = run_episodes(config.env, act, config.curve_episodes, SELECTION_SEED, **config.env_kwargs)
    assert points in (None, len(returned))
    assert returned[-1] < max(returned) == pytest.approx(again.returns.mean(), abs=1e-4)


@pytest.mark.parametrize("stagger", [True, False])
def test_first_episodes_of_a_staggered_training_alone_are_of_different_lengths(stagger, tmp_path):
    train(small_config("ppo", stagger=stagger), tmp_path)
    lengths = [int(row["l"]) for row in csv_rows(tmp_path / "monitor.csv")]
    first, later = lengths[:16], lengths[16:]
    assert (len({*first}) > 8) == stagger
    assert max(first) <= 40
    assert {*later} == {40}


def test_points_of_the_log_stand_where_they_were_measured_also_after_a_kill(tmp_path):
    """The last one comes between the last checkpoint and the kill, at 1856 steps, and is measured again."""
    log = {"curve_every": 370, "telemetry": ["tensorboard", "csv"]}
    kill(tmp_path, "ppo", checkpoint_seconds=1e-9, **log)
    measured = csv_rows(tmp_path / "selection.csv")
    resume(tmp_path)
    rows = csv_rows(tmp_path / "selection.csv")
    assert [row["env_steps"] for row in measured] == ["384", "752", "1120", "1488", "1856"]
    log = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    points = [(str(p.step), f"{p.value:.4f}") for p in log.Scalars("curve/return")]
    assert points == [(row["env_steps"], row["return"]) for row in rows]
    assert csv_rows(tmp_path / "progress_2.csv")[0]["time/total_timesteps"] == "1856"


def test_a_training_that_was_killed_before_its_first_checkpoint_begins_again(tmp_path, capsys, refused):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(small_config("ppo"), whole)
    kill(killed, "ppo", checkpoint_seconds=600)
    (killed / "notes.txt").write_text("of the user")
    with alone(killed, "trains"):
        refused(["resume", killed], f"another process trains in {killed}; wait for its end")
    resume(killed)
    before = killed / "stopped_1"
    told = f"{killed} was stopped without a checkpoint, and begins again; what it had is in {before}"
    assert told in capsys.readouterr().err
    assert {"policy.zip", "selection.csv", "monitor.csv"} <= {path.name for path in before.iterdir()}
    assert (killed / "notes.txt").is_file()
    assert_same_policy(whole, killed)


def test_what_is_no_stopped_training_does_not_begin_again(tmp_path, refused):
    shutil.copytree(POLICIES / "RPRPReach-v0-ppo", tmp_path / "exported")
    kill(tmp_path / "without", "ppo", checkpoint_seconds=0)
    with alone(tmp_path / "without", "trains"), pytest.raises(ValueError, match="another process trains in"):
        resume(tmp_path / "without")  # which is not judged while it may still be training
    before = kept(tmp_path)
    refused(["resume", tmp_path / "exported"], "is an exported policy", "has no checkpoint")
    refused(["resume", tmp_path / "without"], "was killed, or lacks its training.json, and has no checkpoint")
    assert kept(tmp_path) == before


def test_a_kill_while_a_checkpoint_is_written_leaves_the_one_before(killed, monkeypatch, refused):
    replace = os.replace

    def replace_or_die(source, target):
        if source.name == checkpoint.PART:
            raise SystemExit  # between two renamings
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replace_or_die)
        with pytest.raises(SystemExit):
            resume(killed)
    assert find_checkpoint(killed).name == "checkpoint.old"
    refused(["train", killed / "config.yaml", "--out", killed], command("resume", killed))
    assert resume(killed)["env_steps"] == 2400


def test_a_checkpoint_in_which_readers_find_different_members_is_refused(killed, refused):
    """They look for the directory of a zip file at its offset, or before its end."""
    archives = []
    for number in (1.0, 2.0):
        memory = io.BytesIO()
        torch.save(checkpoint.plain({"x": torch.full((3,), number)}), memory)
        with zipfile.ZipFile(memory) as archive:
            count, start = len(archive.namelist()), archive.start_dir
        whole = memory.getvalue()
        archives.append((whole[:start], whole[start : whole.index(zipfile.stringEndArchive64)]))
    (first, its_directory), (second, directory) = archives
    assert len(first) == len(second)  # zipfile corrects the places of members: it finds those of the second
    data = b"".join([first, its_directory, second, directory])
    end = (zipfile.stringEndArchive, 0, 0, count, count, len(directory), len(first), 0)
    path = killed / "checkpoint" / "state.pt"
    path.write_bytes(data + struct.pack(zipfile.structEndArchive, *end))
    assert checkpoint.unplain(torch.load(path))["x"].tolist() == [1.0] * 3
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
    refused(["resume", killed], "state.pt has something between its members and their directory")


def test_a_damaged_checkpoint_is_refused_and_runs_no_code(killed, tmp_path, refused):
    state = killed / "checkpoint" / "state.pt"
    whole = state.read_bytes()
    state.write_bytes(whole[: len(whole) // 2])
    refused(["resume", killed], "damaged")
    state.write_bytes(whole)
    write_members(state, members(state))
    refused(["resume", killed], "compressed")
    torch.save({"dict": [("progress", Evil(tmp_path / "made"))]}, state)
    refused(["resume", killed])
    assert not (tmp_path / "made").exists()


@pytest.mark.quick("counters.num_timesteps-x")
@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("counters.num_timesteps", "x"), ("counters.num_timesteps", -5), ("counters.num_timesteps", True),
        ("counters._current_progress_remaining", float("inf")), ("monitor.episode_returns", "x"),
        ("monitor.episode_returns", np.full(16, np.nan, np.float32)), ("learner.networks", [1]),
        ("last._last_obs", [1, 2]), ("learner.networks", {}), ("progress.seconds", "x"),
        ("tables.monitor.csv", 10**9), ("run.simulator", "another"),
    ],
)  # fmt: skip
def test_a_checkpoint_with_other_values_is_refused_and_nothing_is_changed(place, value, killed, refused):
    first, name = place.split(".", 1)
    with changed_state(killed) as state:
        state[first][name] = value
    tables = [(killed / name).read_bytes() for name in checkpoint.TABLES]
    refused(["resume", killed], "checkpoint is damaged or of another run")
    assert [(killed / name).read_bytes() for name in checkpoint.TABLES] == tables


def test_a_checkpoint_of_another_configuration_is_refused(killed, refused):
    refused(["resume", change(killed / "config.yaml", seed=7)], "seed: 4, and config.yaml has 7")
    settings = {**REPLAY, "gamma": 0.5}
    refused(["resume", change(killed / "config.yaml", seed=4, sac=settings)], "sac.gamma: 0.9, and")


def test_seeds_of_runs_have_goals_of_their_own(tmp_path, monkeypatch):
    goals = []
    monkeypatch.setattr(Watch, "_on_training_start", lambda self: goals.append(self.monitor.venv.goal.copy()))
    for seed, first in ((0, 0), (1, 10_000)):
        train(small_config("ppo", seed=seed, total_steps=512), tmp_path / f"{seed}")
        env = make_sb3("RPRPReach-v0", 16)
        env.seed(first)
        env.reset()
        np.testing.assert_array_equal(goals[-1], env.goal)
    assert not set(map(tuple, goals[0].tolist())) & set(map(tuple, goals[1].tolist()))


def test_a_log_that_leaves_the_folder_is_asked_for_by_the_command(killed, tmp_path, refused, monkeypatch):
    calls = []
    names = ("start_run", "log_dict", "log_metrics", "end_run")
    client = {name: lambda *given, name=name, **more: calls.append(name) for name in names}
    monkeypatch.setitem(sys.modules, "mlflow", SimpleNamespace(**client))
    config = change(killed / "config.yaml", telemetry=["csv", "mlflow"]) / "config.yaml"
    others = [["tune", config]] if TUNES else []
    for words in (["resume", killed], ["train", config, "--out", tmp_path / "a"], *others):
        refused(words, "add telemetry=[csv,mlflow], or telemetry=[tensorboard]")
    refused(["resume", killed, "telemetry=[csv]", "seed=3"], "only checkpoint_seconds and telemetry")
    assert calls == []
    resume(killed, overrides=["telemetry=[mlflow]"])
    assert {"start_run", "end_run"} <= set(calls)


FULL = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))


def onto_full_device(data, file):
    """torch tells that something is wrong, and not what."""
    device = open("/dev/full", "wb")  # noqa: SIM115 - its end raises again
    try:
        torch.save(data, device)
    finally:
        with contextlib.suppress(OSError):
            device.close()


NO_DEVICE = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no full device")


@pytest.mark.parametrize(
    ("file", "place", "fail"),
    [
        (".", "stable_baselines3.common.monitor.ResultsWriter.write_row", FULL),
        ("checkpoint", "redundant_envs_train.training.checkpoint.plain", FULL),
        pytest.param(
            "checkpoint", "redundant_envs_train.training.checkpoint.torch",
            Mock(wraps=torch, save=onto_full_device), marks=NO_DEVICE,
        ),
    ],
    ids=["monitor", "checkpoint", "torch"],
)  # fmt: skip
def test_a_training_on_a_disk_that_fills_keeps_its_policy_and_goes_on_when_there_is_room(
    file, place, fail, tmp_path, monkeypatch
):
    with monkeypatch.context() as patch:
        patch.setattr(place, fail)
        with pytest.raises(DiskFull) as error:
            train(small_config("ppo", checkpoint_seconds=1e-9), tmp_path)
    assert str(error.value).startswith(f"{tmp_path / file} cannot be written: the disk is full")
    assert str(error.value).endswith(f"of 2048 steps the policy is kept in {tmp_path / 'policy.zip'}")
    assert not [*tmp_path.glob("*.part")]
    assert json.loads((tmp_path / "training.json").read_text())["stopped"]
    assert resume(tmp_path)["env_steps"] == 2048
