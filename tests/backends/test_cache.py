"""The folder of machine code: damage is found, files are never incomplete, and it is optional."""

import gc
import hashlib
import os
import shutil
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import Mock

import numpy as np
import pytest

from redundant_envs.__main__ import main
from redundant_envs.compiler.backends import cache
from redundant_envs.compiler.tracing.flow import Kernel, Program

unix = pytest.mark.skipif(sys.platform == "win32", reason="locks, owners and modes are those of Unix")


def small_program():
    """A kernel that doubles a number."""
    p = Kernel("double", {"x": "f64"})
    p.store(p["x"], 0, p.load(p["x"]) * 2.0)
    return Program([p])


KEY = cache.program_key(cache.identity(small_program()), 8)
NAME, LOCK = f"{KEY}{cache.SUFFIX}", f"{KEY}.lock"
ONCE, ALONE = "compiling a test (once on this machine)", "compiling a test (for this process alone)"


def double(key=KEY):
    """The kernel, from the cache, which works."""
    kernel, x = cache.kernels(key, ["double"], small_program, "a test")["double"], np.array([21.0])
    arguments = np.array([x.ctypes.data])
    kernel(arguments.ctypes.data)
    assert x[0] == 42.0
    return kernel


@pytest.fixture
def load(monkeypatch, capsys):
    """Get the kernel as another process would, with a folder: the warning, and what is told meanwhile."""

    def run(folder):
        monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))
        for name, empty in (("_kept", {}), ("_warned", set())):
            monkeypatch.setattr(cache, name, empty)
        capsys.readouterr()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            double()
        assert len(warned) <= 1
        return "".join(str(w.message) for w in warned), capsys.readouterr().err

    return run


@pytest.fixture
def folder(tmp_path, load):
    """A folder with one program; folders may be moved."""
    assert load(tmp_path / "first")[0] == ""
    return (tmp_path / "first").rename(tmp_path / "cache")


def test_what_is_kept_is_the_code_and_its_checksum_and_a_process_asks_once(folder, load):
    assert {p.name for p in folder.iterdir()} == {NAME, LOCK}
    data = (folder / NAME).read_bytes()
    assert data[:32] == hashlib.sha256(KEY.encode() + data[32:]).digest()
    assert load(folder) == ("", "")
    shutil.rmtree(folder)
    assert double() is double()
    assert not folder.exists()


DAMAGES = {
    "empty": lambda p: p.write_bytes(b""),
    "cut": lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]),
    "one byte more": lambda p: p.write_bytes(p.read_bytes() + b"\0"),
    "one byte": lambda p: p.write_bytes(p.read_bytes()[:-9] + b"?" + p.read_bytes()[-8:]),
    "a pipe": lambda p: (p.unlink(), os.mkfifo(p)),
    "a link to a good file": lambda p: p.symlink_to(p.rename(p.with_name("elsewhere"))),
    "writable by others": lambda p: p.chmod(0o622),
    "a broken link": lambda p: (p.unlink(), p.symlink_to(p.with_name("nowhere"))),
    "code of another program": lambda p: p.write_bytes(
        hashlib.sha256(b"0" * 40 + p.read_bytes()[32:]).digest() + p.read_bytes()[32:]
    ),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_found_told_once_and_compiled_anew(folder, load, damage):
    damage(folder / NAME)
    warned, told = load(folder)
    assert f"{folder / NAME} was damaged or not ours; it is made again" in warned
    assert told.count(ONCE) == 1
    assert load(folder) == ("", "")
    assert (folder / NAME).is_file()
    assert not (folder / NAME).is_symlink()


@pytest.mark.parametrize("place", [NAME, LOCK], ids=["code", "lock"])
def test_a_folder_in_the_place_of_a_file_stays_and_memory_serves(folder, load, place):
    (folder / NAME).unlink()
    (folder / place).unlink(missing_ok=True)
    (folder / place).mkdir()
    (folder / place / "mine").write_text("?")
    warned, told = load(folder)
    assert "kept in memory only" in warned
    assert place == LOCK or "directory" in warned
    assert told.count("compiling a test") == 1
    assert (folder / place / "mine").read_text() == "?"


@unix
def test_a_lock_held_elsewhere_is_waited_for_aloud_and_not_for_ever(folder, load, monkeypatch):
    import fcntl

    monkeypatch.setattr(cache, "SILENT_WAIT", 0.01)
    monkeypatch.setattr(cache, "LONGEST_WAIT", 0.05)
    (folder / NAME).unlink()
    with (folder / LOCK).open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        warned, told = load(folder)
    assert f"another process has held {folder / LOCK} for 0 s" in warned
    assert told.count("waiting for another process that makes a test (it has locked") == 1
    assert ALONE in told


def test_a_file_that_cannot_be_written_is_not_there_at_all(tmp_path, load, monkeypatch):
    with monkeypatch.context() as context:
        context.setattr(os, "replace", Mock(side_effect=OSError("no room left")))
        warned, told = load(tmp_path)
    assert "no room left" in warned
    assert f"set {cache.CACHE_VARIABLE}" in warned
    assert told.count("compiling a test") == 1
    assert [p.name for p in tmp_path.iterdir()] == [LOCK]
    assert load(tmp_path)[0] == ""


def test_threads_that_want_the_same_program_compile_it_once(folder, load, capsys):
    load(folder)
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda _: double("a" * 40), range(6)))
    assert all(kernel is found[0] for kernel in found)
    assert capsys.readouterr().err.count(ONCE) == 1


def test_a_process_keeps_the_machine_code_that_it_asked_for_last(folder, load, monkeypatch):
    load(folder)
    monkeypatch.setattr(cache, "KEPT_KERNELS", 2)
    used = double("a" * 40)
    for letter in "bcbd":
        double(letter * 40)
    gc.collect()
    assert [*cache._kept] == ["b" * 40, "d" * 40]
    x = np.array([21.0])
    used(np.array([x.ctypes.data]).ctypes.data)  # code in use stays, too
    assert x[0] == 42.0


def test_facts_are_kept_and_damaged_ones_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    found = Mock(return_value={"numbers": [0.1, 2, True]})
    for _ in range(2):
        assert cache.facts("f" * 40, found) == found.return_value
    assert found.call_count == 1
    DAMAGES["one byte"](tmp_path / f"{'f' * 40}{cache.FACTS}")
    with pytest.warns(UserWarning, match="damaged or not ours; it is made again"):
        assert cache.facts("f" * 40, found) == found.return_value
    cache.facts("f" * 40, found)
    assert found.call_count == 2


def test_the_files_used_last_are_kept_and_nothing_else_is_touched(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    own = ["a" * 40 + ".lock", "a" * 40 + ".code", "b" * 40 + ".code." + "1" * 16, "c" * 40 + ".facts"]
    others = ["notes.code", "x" * 40 + ".code", "a" * 39 + ".code", "0" * 40 + ".txt", "0" * 40, "tmp_a3b4"]
    for i, name in enumerate([*own, *others]):
        (tmp_path / name).write_bytes(bytes(150))
        os.utime(tmp_path / name, (i, i))
    for most, kept in ((300, own[2:]), (299, own[3:]), (1, [])):
        monkeypatch.setattr(cache, "KEPT_BYTES", most)
        cache._prune(tmp_path)
        assert {p.name for p in tmp_path.iterdir()} == {*others, *kept}


def test_a_command_shows_and_clears_the_folder(folder, monkeypatch, capsys):
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))
    (folder / "notes").write_text("mine")
    (folder / f"{NAME}.{'a' * 16}").write_text("half")
    assert main(["cache"]) == 0
    assert capsys.readouterr().out == f"{folder}: 2 files, 0.0 MB; at most 537 MB are kept\n"
    assert main(["cache", "--clear"]) == 0
    assert "2 files, 0.0 MB deleted" in capsys.readouterr().out
    assert [p.name for p in folder.iterdir()] == ["notes"]
    folder.chmod(0o777)
    assert main(["cache", "--clear"]) == 2
    assert "chmod go-w" in capsys.readouterr().err


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems use other folders")
@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"XDG_CACHE_HOME": "/xdg"}, "/xdg/redundant-envs"),
        ({"XDG_CACHE_HOME": "here", "HOME": "/me"}, "/me/.cache/redundant-envs"),  # as its standard says
        ({cache.CACHE_VARIABLE: "~/own", "HOME": "/me", "XDG_CACHE_HOME": "/xdg"}, "/me/own"),
        ({}, None),
        ({cache.CACHE_VARIABLE: "here", "HOME": "/me"}, None),
        ({cache.CACHE_VARIABLE: "~nobody_of_this_name/cache"}, None),
    ],
    ids=str,
)
def test_where_the_folder_is(tmp_path, monkeypatch, variables, expected):
    """Of a user whom the system does not know, too."""
    import pwd

    for name in ("HOME", "XDG_CACHE_HOME", cache.CACHE_VARIABLE):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    for unknown in ("getpwuid", "getpwnam"):
        monkeypatch.setattr(pwd, unknown, Mock(side_effect=KeyError))
    monkeypatch.setattr(cache, "_warned", set())
    monkeypatch.chdir(tmp_path)
    if expected:
        assert str(cache.cache_folder()) == expected
        return
    monkeypatch.setattr(cache, "_kept", {})
    with pytest.warns(UserWarning, match=f"not an absolute path.*set {cache.CACHE_VARIABLE}"):
        double("a" * 40)
    double("b" * 40)  # told once
    assert not list(tmp_path.iterdir())


@unix
@pytest.mark.parametrize("mode", [0o777, 0o720, 0o702, 0o755])
def test_a_folder_that_others_may_write_to_or_own_is_not_taken(folder, load, monkeypatch, mode):
    """Made first under a name where anybody may write, or that of a HOME which root has kept."""
    names, owner, others = sorted(folder.rglob("*")), folder.stat().st_uid, mode == 0o755
    folder.chmod(mode)
    with monkeypatch.context() as context:
        context.setattr(os, "geteuid", lambda: owner + others)
        warned, told = load(folder)
    assert (f"belongs to user {owner}" if others else "chmod go-w") in warned
    assert "kept in memory only" in warned
    assert told.count(ALONE) == 1
    assert sorted(folder.rglob("*")) == names
    folder.chmod(0o755)
    assert load(folder) == ("", "")


def of_another_user(status):
    return os.stat_result((*status[:4], os.geteuid() + 1, *status[5:10]))


@unix
def test_another_users_file_is_replaced(folder, load, monkeypatch):
    fstat, file = os.fstat, (folder / NAME).stat().st_ino
    monkeypatch.setattr(os, "fstat", lambda fd: of_another_user(s) if (s := fstat(fd)).st_ino == file else s)
    warned, told = load(folder)
    assert "not ours; it is made again" in warned
    assert told.count(ONCE) == 1


@unix
def test_what_is_made_is_closed_to_others(tmp_path, load):
    before = os.umask(0)
    try:
        load(tmp_path / "new")
    finally:
        os.umask(before)
    assert all(p.stat().st_mode & 0o77 == 0 for p in (tmp_path / "new", *(tmp_path / "new").iterdir()))
