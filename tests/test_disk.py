"""Files are complete or absent; a full disk is one message that names the file."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from redundant_envs.exports import files
from redundant_envs.scenes.scene import load_scene
from redundant_envs.support import disk
from redundant_envs.support.disk import DiskFull, alone, replacing, write_text
from redundant_envs.support.figures import new_figure, save_figure, write_clip
from redundant_envs.support.tables import write_rows

FRAMES = [np.zeros((16, 16, 3), np.uint8)] * 2


@pytest.fixture
def full(monkeypatch):
    """Nothing can be written: a file is begun, and then there is no space left."""
    plain = Path.open

    def fail(path, mode="r", *given, **more):
        found = plain(path, mode, *given, **more)
        if set(mode) & set("wa"):
            found.close()
            raise OSError(errno.ENOSPC, "No space left on device")
        return found

    monkeypatch.setattr(Path, "open", fail)
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: path.open("wb"))
    monkeypatch.setattr(Path, "write_text", lambda path, data, **more: path.open("w"))


WRITERS = {
    "a.csv": lambda path: write_rows([{"a": 1}], ["a"], path),
    "a.png": lambda path: save_figure(new_figure(1, 1), path),
    "a.gif": lambda path: write_clip(path, FRAMES, 25),
    "a.xml": lambda path: files.write(load_scene("rprp_reach"), "mjcf", path, approximate=True),
    "a.md": lambda path: write_text(path, "text"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_cannot_be_finished_is_not_there_and_the_old_one_is(name, tmp_path, full):
    with pytest.raises(DiskFull, match=rf"{name} cannot be written: the disk is full"):
        WRITERS[name](tmp_path / "new" / name)
    assert not [*(tmp_path / "new").iterdir()]
    (tmp_path / name).touch()
    with pytest.raises(DiskFull):
        WRITERS[name](tmp_path / name)
    assert [path.name for path in tmp_path.glob("*.*")] == [name]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no links without rights")
def test_nothing_is_written_through_a_link(tmp_path):
    write_text(tmp_path / "file", "old")
    names = ["link", "broken", ".new.part", ".new.part.txt", "new.txt.part"]
    for name in names:
        (tmp_path / name).symlink_to(tmp_path / ("nowhere" if name == "broken" else "file"))
    for name in names[:2]:
        with pytest.raises(FileExistsError, match=f"{name} is a link to .*; delete the link"):
            write_text(tmp_path / name, "new")
    write_text(tmp_path / "new.txt", "new")  # the names of its parts cannot be guessed
    assert (tmp_path / "file").read_text() == "old"
    assert {path.name for path in tmp_path.iterdir()} == {"file", "new.txt", *names}


def test_errors_of_libraries_on_a_full_disk_are_told_and_others_left_alone(tmp_path, monkeypatch):
    def fail():
        with replacing(tmp_path / "a.mp4") as part:
            part.write_bytes(b"begun")
            raise OSError("broken pipe")

    with pytest.raises(OSError, match="broken pipe"):
        fail()
    monkeypatch.setattr(disk, "free_bytes", lambda path: 100)
    with pytest.raises(DiskFull, match=r"a\.mp4"):
        fail()
    assert not [*tmp_path.iterdir()]


@pytest.mark.skipif(os.name == "nt", reason="Windows locks no folders")
def test_one_process_at_a_time_works_in_a_folder(tmp_path):
    code = "import sys, redundant_envs.support.disk as d\nwith d.alone(sys.argv[1], 'trains'): pass"
    command = [sys.executable, "-c", code, str(tmp_path)]
    with alone(tmp_path, "trains"):
        found = subprocess.run(command, capture_output=True, text=True)
        assert f"ValueError: another process trains in {tmp_path}; wait for its end" in found.stderr
    with alone(tmp_path, "trains"):
        assert not [*tmp_path.iterdir()]
    assert subprocess.run(command).returncode == 0
