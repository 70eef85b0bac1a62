"""A training that is killed at any moment continues to the same bits."""

import itertools
import json
import os
import shutil
import signal
import sys
import zipfile

import numpy as np
import pytest
import torch
import yaml

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import Config, checked
from redundant_envs_train.learners.networks import Adam
from redundant_envs_train.policies import read_weights
from redundant_envs_train.run_folder import find_checkpoint
from redundant_envs_train.training import checkpoint
from redundant_envs_train.training.train import resume, train
from redundant_envs_train.training.watch import Watch

SMALL = {
    "ppo": {"num_envs": 32, "total_steps": 4096, "ppo": {"n_steps": 16, "batch_size": 256}},
    # the buffer is smaller than the run, so that its oldest rows are overwritten
    "sac": {
        "num_envs": 16,
        "total_steps": 4000,
        "sac": {"learning_starts": 400, "buffer_size": 2400, "gradient_steps": 1, "batch_size": 32},
    },
    "auto": {
        "num_envs": 16,
        "total_steps": 3000,
        "sac": {
            "learning_starts": 400,
            "ent_coef": "auto",
            "gradient_steps": 1,
            "batch_size": 32,
            "schedule": "linear",
        },
    },
    "her": {
        "num_envs": 16,
        "total_steps": 4800,
        "her": {"learning_starts": 1600, "buffer_size": 3200, "gradient_steps": 1, "batch_size": 32},
    },
}


class Killed(Exception):
    """The process ends here."""


def config(case, **more):
    algo = "sac" if case == "auto" else case
    kind = "GoalReach" if algo == "her" else "Reach"
    return checked(
        Config,
        {"config_version": 2, "env": f"redundant_envs/RPRP{kind}-v0", "algo": algo, "seed": 4,
         "curve_every": 1000, "curve_episodes": 5, "evaluation_episodes": 5, "checkpoint_seconds": 1e-9,
         "telemetry": [], **SMALL[case], **more},
    )  # fmt: skip


def weights(folder):
    return read_weights(folder / "policy.zip", "silu")[0]


def table(folder, name, without):
    """A table of numbers, without the column of times."""
    return [
        [cell for k, cell in enumerate(line.split(",")) if k != without]
        for line in (folder / name).read_text().splitlines()
        if not line.startswith("#")
    ]


def kill_at(steps, monkeypatch):
    plain = Watch._on_step

    def on_step(self):
        if self.num_timesteps >= steps:
            raise Killed
        return plain(self)

    monkeypatch.setattr(Watch, "_on_step", on_step)


@pytest.mark.parametrize(
    ("case", "share"),
    [
        ("ppo", 0.3),
        pytest.param("sac", 0.8, marks=pytest.mark.long),
        pytest.param("auto", 0.3, marks=pytest.mark.long),
        pytest.param("her", 0.8, marks=pytest.mark.long),
    ],
)
def test_a_killed_training_goes_on_to_the_same_bits(case, share, tmp_path, monkeypatch):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(config(case, checkpoint_seconds=0), whole)
    assert not find_checkpoint(whole)
    with monkeypatch.context() as patch:
        kill_at(share * SMALL[case]["total_steps"], patch)
        with pytest.raises(Killed):
            train(config(case), killed)
    np.random.rand()  # what happened in between does not matter
    torch.rand(3)
    facts = resume(killed)
    assert facts["env_steps"] >= SMALL[case]["total_steps"]
    expected, found = weights(whole), weights(killed)
    assert expected.keys() == found.keys()
    for name, tensor in expected.items():
        assert torch.equal(tensor, found[name]), name
    assert table(whole, "selection.csv", 1) == table(killed, "selection.csv", 1)
    assert table(whole, "monitor.csv", 2) == table(killed, "monitor.csv", 2)
    assert not find_checkpoint(killed)


def test_the_same_seed_repeats_a_run_to_the_bit_and_another_does_not(tmp_path):
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        train(config("sac", checkpoint_seconds=0, seed=seed), tmp_path / name)
    a, b, c = (weights(tmp_path / name) for name in "abc")
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert not torch.equal(a["actor.mu.weight"], c["actor.mu.weight"])


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A training of SAC that was killed half-way."""
    folder = tmp_path_factory.mktemp("begun") / "run"
    with pytest.MonkeyPatch.context() as patch:
        kill_at(2000, patch)
        with pytest.raises(Killed):
            train(config("sac"), folder)
    return folder


@pytest.fixture
def killed(begun, tmp_path):
    """A copy of it to damage or to continue."""
    shutil.copytree(begun, tmp_path / "run")
    return tmp_path / "run"


def test_a_kill_while_a_checkpoint_is_written_leaves_the_one_before(killed):
    (killed / "checkpoint.part").mkdir()
    (killed / "checkpoint.part" / "state.pt").write_bytes(b"half")
    (killed / "checkpoint").rename(killed / "checkpoint.old")  # between two renamings
    assert resume(killed)["env_steps"] == 4000


def test_a_damaged_checkpoint_is_refused_and_runs_no_code(killed, capsys):
    state = killed / "checkpoint" / "state.pt"
    whole = state.read_bytes()
    state.write_bytes(whole[: len(whole) // 2])
    assert main(["resume", str(killed)]) == 2
    assert "damaged" in capsys.readouterr().err

    class Evil:
        def __reduce__(self):
            return (shutil.rmtree, (str(killed),))

    torch.save({"dict": [("progress", Evil())]}, state)
    assert main(["resume", str(killed)]) == 2
    assert state.is_file()


def test_a_run_without_a_checkpoint_says_so(tmp_path, capsys):
    train(config("ppo"), tmp_path / "run")
    assert main(["resume", str(tmp_path / "run")]) == 2
    assert "is finished and has no checkpoint; look at it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"seed": 7}, "seed: 4, and config.yaml has 7"),
        ({"sac": {"gamma": 0.5}}, "sac.gamma: 0.9, and config.yaml has 0.5"),
        ({"total_steps": 9000}, "total_steps: 4000"),
        ({"sac": {"activation": "relu"}}, "sac.activation"),
    ],
)
def test_a_checkpoint_of_another_configuration_is_refused(change, word, killed, capsys):
    path = killed / "config.yaml"
    data = yaml.safe_load(path.read_text())
    for name, value in change.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    path.write_text(yaml.safe_dump(data))
    assert main(["resume", str(killed)]) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("counters", "num_timesteps"), "x"), (("counters", "num_timesteps"), -5),
        (("monitor", "episode_returns"), "x"), (("last", "_last_obs"), [1, 2]),
        (("learner", "adams", "actor", "steps"), -1), (("learner", "networks"), {}),
        (("progress", "seconds"), "x"), (("tables", "monitor.csv"), 10**9), (("tables", "monitor.csv"), -1),
        (("run", "simulator"), "another"),
    ],
)  # fmt: skip
def test_a_checkpoint_with_other_values_is_refused_in_one_line(place, value, killed, capsys):
    path = killed / "checkpoint" / "state.pt"
    state = checkpoint.unplain(torch.load(path, weights_only=True))
    inner = state
    for name in place[:-1]:
        inner = inner[name]
    inner[place[-1]] = value
    torch.save(checkpoint.plain(state), path)
    sizes = [(killed / name).stat().st_size for name in checkpoint.TABLES]
    assert main(["resume", str(killed)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert [(killed / name).stat().st_size for name in checkpoint.TABLES] == sizes


def test_networks_that_are_not_finite_and_compressed_files_are_refused(killed, capsys):
    path = killed / "checkpoint" / "state.pt"
    whole = path.read_bytes()
    state = checkpoint.unplain(torch.load(path, weights_only=True))
    state["learner"]["networks"]["actor"][0] = float("nan")
    torch.save(checkpoint.plain(state), path)
    assert main(["resume", str(killed)]) == 2
    assert "not finite" in capsys.readouterr().err
    path.write_bytes(whole)
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name, data in parts.items():
            new.writestr(name, data)
    assert main(["resume", str(killed)]) == 2
    assert "compressed" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no links without rights")
def test_a_table_that_is_a_link_is_not_written_through(killed, tmp_path, capsys):
    victim = tmp_path / "victim"
    victim.write_text("mine" * 1000)
    (killed / "monitor.csv").unlink()
    (killed / "monitor.csv").symlink_to(victim)
    assert main(["resume", str(killed)]) == 2
    assert victim.read_text() == "mine" * 1000


def test_times_of_episodes_go_on_after_a_break(killed):
    before = table(killed, "monitor.csv", None)[1:]
    resume(killed)
    times = [float(row[2]) for row in table(killed, "monitor.csv", None)[1:]]
    assert len(times) > len(before)
    assert times == sorted(times)


def test_seeds_of_runs_have_goals_of_their_own(tmp_path, monkeypatch):
    goals = []

    def look(self):
        goals.append(self.monitor.venv.goal.copy())

    monkeypatch.setattr(Watch, "_on_training_start", look)
    for seed, first in ((0, 0), (1, 10_000), (100, 10_000_000)):
        train(config("ppo", seed=seed, total_steps=512), tmp_path / f"{seed}")
        env = make_sb3("RPRPReach-v0", 32)
        env.seed(first)
        env.reset()
        np.testing.assert_array_equal(goals[-1], env.goal)
    seeds = [{tuple(goal) for goal in one.tolist()} for one in goals]
    assert all(not one & other for one, other in itertools.combinations(seeds, 2))


@pytest.mark.parametrize("case", ["ppo", pytest.param("auto", marks=pytest.mark.long)])
def test_a_falling_rate_ends_at_zero_and_not_below(case, tmp_path, monkeypatch):
    rates = []
    step = Adam.step
    monkeypatch.setattr(Adam, "step", lambda self, rate: (rates.append(rate), step(self, rate))[1])
    train(config(case, total_steps=SMALL[case]["total_steps"] + 7), tmp_path / "run")
    assert rates[0] > rates[-1] >= 0.0


def test_a_request_in_the_last_rollout_comes_too_late(tmp_path, monkeypatch):
    plain = Watch.point

    def point(self):
        if self.num_timesteps >= 4096:
            os.kill(os.getpid(), signal.SIGTERM)
        plain(self)

    monkeypatch.setattr(Watch, "point", point)
    assert train(config("ppo"), tmp_path / "run")["env_steps"] == 4096
    assert json.loads((tmp_path / "run" / "training.json").read_text())["stopped"] is False
    assert not find_checkpoint(tmp_path / "run")


def test_a_folder_with_a_checkpoint_is_not_begun_anew(killed, capsys):
    assert main(["train", str(killed / "config.yaml"), "--out", str(killed)]) == 2
    assert f"resume {killed}" in capsys.readouterr().err


def test_the_policy_file_is_the_average_without_anything_of_ours(tmp_path):
    train(config("her"), tmp_path / "run")
    with zipfile.ZipFile(tmp_path / "run" / "policy.zip") as archive:
        assert b"redundant_envs" not in archive.read("data")
