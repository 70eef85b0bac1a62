"""Fixtures of the application: runs that all tests of one process share, of which a test that changes one
takes a copy; commands, and refused ones."""

import os
import re
import shutil
import signal
from pathlib import Path

import pytest
from run_folders import main, write_scene_file
from short_trainings import SMALL, kill

from redundant_envs.support import modules
from redundant_envs.support.disk import write_text
from redundant_envs_train import report
from redundant_envs_train.evidence import curves, outcomes


@pytest.fixture(autouse=True)
def short_clips(monkeypatch):
    """Reports of tests have no true clips, which take most of their time; that of ``home`` has."""
    monkeypatch.setattr(report, "clip", lambda path, *given, **more: path.write_bytes(b"clip"))


@pytest.fixture
def no_drawing(monkeypatch):
    """Pictures, which take most of the time of a report, are none; those of ``home`` are not."""
    for drawn in (curves, outcomes):
        monkeypatch.setattr(drawn, "save_figure", lambda figure, path, **options: write_text(path, "picture"))


@pytest.fixture(autouse=True)
def forgotten_imports():
    """Modules that a command imports by --import are those of its process."""
    yield
    modules.IMPORTED.clear()


@pytest.fixture
def call(capsys):
    """Run a command, of texts, numbers and paths, that ends with a status; returns its (out, err)."""

    def answer(*words, status=0):
        capsys.readouterr()
        found = main([str(word) for word in words])
        out, err = capsys.readouterr()
        assert found == status, err
        return out, err

    return answer


@pytest.fixture
def refused(call):
    """Run a command that ends with status 2 and one line on stderr; all parts are in it."""

    def check(words, *parts):
        _, error = call(*words, status=2)
        progress = r"[^:]+: (\d+ %|compiling )"  # and what a first call on a machine compiles
        told = [line for line in error.splitlines() if not re.match(progress, line)]
        assert len(told) == 1, error
        for part in parts:
            assert part in error
        return error

    return check


@pytest.fixture(scope="session")
def home(tmp_path_factory):
    """A folder with the scene mine.yaml, and a PPO run that was trained in it, evaluated and reported."""
    folder = tmp_path_factory.mktemp("home")
    write_scene_file(folder, 0.3)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(report, "CLIP_EPISODES", 1)
        assert main(["train", "rprp_reach_ppo", *SMALL, "env_kwargs.scene=mine.yaml", "--out", "run"]) == 0
    return folder


@pytest.fixture
def run(home, tmp_path, monkeypatch):
    """A copy of the run in another folder, from which commands are called; there is no mine.yaml."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return Path(shutil.copytree(home / "run", "moved"))


@pytest.fixture(scope="session")
def begun(tmp_path_factory):
    """A SAC training that was killed after its replay buffer was full."""
    folder = tmp_path_factory.mktemp("begun") / "run"
    kill(folder, "sac", checkpoint_seconds=1e-9)
    return folder


@pytest.fixture
def killed(begun, tmp_path):
    """A copy of it to damage or to continue."""
    return Path(shutil.copytree(begun, tmp_path / "killed"))


@pytest.fixture
def interrupts():
    """Ctrl-C raises KeyboardInterrupt here; a shell's background jobs ignore it."""
    outside = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda: os.kill(os.getpid(), signal.SIGINT)
    signal.signal(signal.SIGINT, outside)
