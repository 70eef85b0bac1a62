"""A training that is killed at any moment goes on to the same bits."""

import shutil
import zipfile

import numpy as np
import pytest
import torch

from agents.__main__ import main
from agents.config import Config, checked
from agents.policies import read_weights
from agents.training import checkpoint
from agents.training.train import resume, train
from agents.training.watch import Watch

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
    """A table of numbers, without the column that is a time."""
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


@pytest.mark.parametrize("case", list(SMALL))
@pytest.mark.parametrize("share", [0.3, 0.8])
def test_a_killed_training_goes_on_to_the_same_bits(case, share, tmp_path, monkeypatch):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(config(case, checkpoint_seconds=0), whole)
    assert not checkpoint.exists(whole)
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
    assert not checkpoint.exists(killed)


def test_the_same_seed_repeats_a_run_to_the_bit_and_another_does_not(tmp_path):
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        train(config("sac", checkpoint_seconds=0, seed=seed), tmp_path / name)
    a, b, c = (weights(tmp_path / name) for name in "abc")
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert not torch.equal(a["actor.mu.weight"], c["actor.mu.weight"])


@pytest.fixture
def killed(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        kill_at(2000, patch)
        with pytest.raises(Killed):
            train(config("sac"), tmp_path / "run")
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


def test_a_folder_with_a_checkpoint_is_not_begun_anew(killed, capsys):
    assert main(["train", str(killed / "config.yaml"), "--out", str(killed)]) == 2
    assert f"resume {killed}" in capsys.readouterr().err


def test_the_policy_file_is_the_average_without_anything_of_ours(tmp_path):
    train(config("her"), tmp_path / "run")
    with zipfile.ZipFile(tmp_path / "run" / "policy.zip") as archive:
        assert b"agents" not in archive.read("data")
        assert b"redundant_envs" not in archive.read("data")
