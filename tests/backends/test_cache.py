"""The folder of machine code: damage is found, files are never incomplete, and it is optional."""

import gc
import hashlib
import os
import shutil
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock
from weakref import WeakValueDictionary

import numpy as np
import pytest

from redundant_envs.__main__ import main
from redundant_envs.compiler.backends import cache
from redundant_envs.compiler.tracing.flow import Kernel, Program


def small_program():
    """A kernel that doubles a number."""
    p = Kernel("double", {"x": "f64"})
    p.store(p["x"], 0, p.load(p["x"]) * 2.0)
    return Program([p])


KEY = cache.program_key(cache.identity(small_program()), 8)
NAME, LOCK = f"{KEY}{cache.SUFFIX}", f"{KEY}.lock"


def double():
    """The kernel, from the cache."""
    return cache.kernels(KEY, ["double"], small_program, "a test")["double"]


def load(folder, monkeypatch):
    """Run the kernel as another process would get it; returns the result and the messages."""
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))
    monkeypatch.setattr(cache, "_kept", {})
    monkeypatch.setattr(cache, "_engines", {})
    monkeypatch.setattr(cache, "_warned", set())
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        kernel = double()
    x = np.array([21.0])
    kernel(np.array([x.ctypes.data]).ctypes.data)
    assert x[0] == 42.0
    return [str(w.message) for w in told]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with one program."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert load(folder, monkeypatch) == []
    return folder


@pytest.fixture
def folder(whole, tmp_path, capsys):
    """A folder of the user's choice; folders may be moved."""
    shutil.copytree(whole, tmp_path / "cache")
    capsys.readouterr()
    return tmp_path / "cache"


def compilations(capsys):
    return capsys.readouterr().err.count("compiling a test")


def test_what_is_kept_is_the_code_and_its_checksum_and_a_process_asks_once(folder, monkeypatch, capsys):
    assert sorted(p.name for p in folder.iterdir()) == sorted([NAME, LOCK])
    data = (folder / NAME).read_bytes()
    assert data[:32] == hashlib.sha256(KEY.encode() + data[32:]).digest()
    assert load(folder, monkeypatch) == []
    assert compilations(capsys) == 0
    shutil.rmtree(folder)
    assert double() is double()
    assert not folder.exists()


DAMAGES = {
    "empty": lambda p: p.write_bytes(b""),
    "cut": lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]),
    "one byte more": lambda p: p.write_bytes(p.read_bytes() + b"\0"),
    "zeroed": lambda p: p.write_bytes(bytes(p.stat().st_size)),
    "one byte": lambda p: p.write_bytes(p.read_bytes()[:-9] + b"?" + p.read_bytes()[-8:]),
    "foreign": lambda p: p.write_text("notes of mine"),
    "a pipe": lambda p: (p.unlink(), os.mkfifo(p)),
    "a link to a good file": lambda p: p.symlink_to(p.rename(p.with_name("elsewhere"))),
    "writable by others": lambda p: p.chmod(0o622),
    "a broken link": lambda p: (p.unlink(), p.symlink_to(p.with_name("nowhere"))),
    "code of another program": lambda p: p.write_bytes(
        hashlib.sha256(b"0" * 40 + p.read_bytes()[32:]).digest() + p.read_bytes()[32:]
    ),
}  # fmt: skip


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_found_told_once_and_compiled_anew(folder, damage, monkeypatch, capsys):
    damage(folder / NAME)
    (told,) = load(folder, monkeypatch)
    assert str(folder / NAME) in told
    assert "damaged or not ours; it is compiled again" in told
    assert compilations(capsys) == 1
    assert load(folder, monkeypatch) == []
    assert compilations(capsys) == 0
    assert (folder / NAME).is_file()
    assert not (folder / NAME).is_symlink()


@pytest.mark.parametrize("place", [NAME, LOCK], ids=["code", "lock"])
def test_a_folder_in_the_place_of_a_file_stays_and_memory_serves(folder, place, monkeypatch, capsys):
    (folder / NAME).unlink()
    (folder / place).unlink(missing_ok=True)
    (folder / place).mkdir()
    (folder / place / "mine").write_text("?")
    (told,) = load(folder, monkeypatch)
    assert "kept in memory only" in told
    assert place == LOCK or "is a folder" in told
    assert compilations(capsys) == 1
    assert (folder / place / "mine").read_text() == "?"


unix = pytest.mark.skipif(sys.platform == "win32", reason="locks, owners and modes are those of Unix")


@pytest.fixture
def held(folder):
    """The lock of the program is held elsewhere, and the program is not there."""
    import fcntl

    (folder / NAME).unlink()
    with (folder / LOCK).open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


@unix
def test_a_lock_held_elsewhere_is_waited_for_aloud_and_not_for_ever(folder, held, monkeypatch, capsys):
    monkeypatch.setattr(cache, "SILENT_WAIT", 0.01)
    monkeypatch.setattr(cache, "LONGEST_WAIT", 0.05)
    (told,) = load(folder, monkeypatch)
    assert f"another process has held {folder / LOCK} for 0 s" in told
    err = capsys.readouterr().err
    assert err.count("waiting for another process that makes a test (it has locked") == 1
    assert "compiling a test (for this process alone)" in err


@unix
def test_ctrl_c_ends_the_wait_for_a_lock(folder, held, monkeypatch, capsys):
    monkeypatch.setattr(time, "sleep", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        load(folder, monkeypatch)
    assert compilations(capsys) == 0


def test_a_file_that_cannot_be_written_is_not_there_at_all(tmp_path, monkeypatch, capsys):
    with monkeypatch.context() as context:
        context.setattr(os, "replace", Mock(side_effect=OSError("no room left")))
        (told,) = load(tmp_path, context)
    assert "no room left" in told
    assert f"set {cache.CACHE_VARIABLE}" in told
    assert [p.name for p in tmp_path.iterdir()] == [LOCK]
    assert compilations(capsys) == 1
    assert load(tmp_path, monkeypatch) == []


def test_threads_that_want_the_same_program_compile_it_once(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setattr(cache, "_kept", {})
    monkeypatch.setattr(cache, "_engines", {})
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda _: double(), range(6)))
    assert all(kernel is found[0] for kernel in found)
    assert compilations(capsys) == 1


def test_machine_code_stays_as_long_as_it_is_used_and_that_asked_for_last(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    for name, empty in (("_kept", {}), ("_engines", WeakValueDictionary()), ("KEPT_KERNELS", 2)):
        monkeypatch.setattr(cache, name, empty)

    def asked(letter):
        return cache.kernels(letter * 40, ["double"], small_program, "a test")["double"]

    used = asked("a")
    for letter in "bcbd":
        asked(letter)
    gc.collect()
    assert [*cache._kept] == ["b" * 40, "d" * 40]
    assert {*cache._engines} == {letter * 40 for letter in "abd"}
    x = np.array([21.0])
    used(np.array([x.ctypes.data]).ctypes.data)
    assert x[0] == 42.0
    shutil.rmtree(tmp_path)
    asked("a")  # from memory
    assert compilations(capsys) == 4
    assert not tmp_path.exists()


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
    own = [f"{c * 40}.{kind}" for c, kind in zip("abcd", ("code", "facts", "facts", "code"), strict=True)]
    others = ["notes.code", "x" * 40 + ".code", "a" * 39 + ".code", "0" * 40 + ".txt", "0" * 40, "tmp_a3b4"]
    for i, name in enumerate([*own, *others]):
        for path in (tmp_path / name, (tmp_path / name).with_suffix(".lock")):
            path.write_bytes(bytes(150) if path.name in own else b"")
            os.utime(path, (i, i))
    left = {p.name for p in tmp_path.iterdir()}
    for most, names in ((300, own[:2]), (1, own[:3])):  # the one that was used last is kept
        monkeypatch.setattr(cache, "KEPT_BYTES", most)
        with cache.opened() as folder:
            cache._prune(folder)
        gone = {file for name in names for file in (name, f"{name[:40]}.lock")}
        assert {p.name for p in tmp_path.iterdir()} == left - gone


def test_what_a_killed_process_left_unfinished_is_deleted_when_it_is_old(folder, monkeypatch):
    old, young = (folder / f"{NAME}.{letter * 16}" for letter in "ab")
    for path in (old, young):
        path.write_bytes(b"half")
    os.utime(old, (0, 0))
    os.utime(folder / NAME, (0, 0))
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))
    cache.facts("f" * 40, dict)
    assert not old.exists()
    assert young.exists()
    assert (folder / NAME).exists()


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


@pytest.fixture
def homeless(monkeypatch):
    """No HOME, and a user unknown to the system."""
    import pwd

    for name in ("HOME", "XDG_CACHE_HOME", cache.CACHE_VARIABLE):
        monkeypatch.delenv(name, raising=False)

    monkeypatch.setattr(pwd, "getpwuid", Mock(side_effect=KeyError))
    monkeypatch.setattr(pwd, "getpwnam", Mock(side_effect=KeyError))
    monkeypatch.setattr(cache, "_warned", set())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems use other folders")
@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"XDG_CACHE_HOME": "/xdg"}, "/xdg/redundant-envs"),
        ({"XDG_CACHE_HOME": "here", "HOME": "/me"}, "/me/.cache/redundant-envs"),  # as its standard says
        ({cache.CACHE_VARIABLE: "~/own", "HOME": "/me", "XDG_CACHE_HOME": "/xdg"}, "/me/own"),
        ({}, None),
        ({"HOME": "", cache.CACHE_VARIABLE: "~/own"}, None),
        ({cache.CACHE_VARIABLE: "here", "HOME": "/me"}, None),
        ({cache.CACHE_VARIABLE: "~nobody_of_this_name/cache"}, None),
    ],
    ids=str,
)
def test_where_the_folder_is(homeless, tmp_path, monkeypatch, variables, expected):
    monkeypatch.chdir(tmp_path)
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value)
    if expected:
        assert str(cache.cache_folder()) == expected
        return
    with pytest.warns(UserWarning, match=f"not an absolute path.*set {cache.CACHE_VARIABLE}"):
        cache.facts("a" * 40, dict)
    cache.facts("a" * 40, dict)  # told once
    assert not list(tmp_path.iterdir())


def refused(folder, monkeypatch, capsys):
    """Nothing is taken from the folder or put there; returns the one message."""
    names = sorted(folder.rglob("*"))
    (told,) = load(folder, monkeypatch)
    assert "kept in memory only" in told
    assert capsys.readouterr().err.count("compiling a test (for this process alone)") == 1
    assert sorted(folder.rglob("*")) == names
    return told


@unix
@pytest.mark.parametrize("mode", [0o777, 0o720, 0o702])
def test_a_folder_that_others_may_write_to_is_not_taken(folder, monkeypatch, capsys, mode):
    folder.chmod(mode)
    assert "chmod go-w" in refused(folder, monkeypatch, capsys)
    assert cache.facts("f" * 40, lambda: {"planted": False}) == {"planted": False}
    folder.chmod(0o755)
    assert load(folder, monkeypatch) == []
    assert compilations(capsys) == 0


@unix
def test_another_users_folder_is_not_taken(folder, monkeypatch, capsys):
    """Made first under a name where anybody may write, or that of a HOME which root has kept."""
    monkeypatch.setattr(os, "geteuid", lambda: 1 + folder.stat().st_uid)
    assert f"belongs to user {folder.stat().st_uid}" in refused(folder, monkeypatch, capsys)


def of_another_user(status):
    return os.stat_result((*status[:4], os.geteuid() + 1, *status[5:10]))


@unix
def test_another_users_file_is_replaced(folder, monkeypatch, capsys):
    fstat, file = os.fstat, (folder / NAME).stat().st_ino
    monkeypatch.setattr(os, "fstat", lambda fd: of_another_user(s) if (s := fstat(fd)).st_ino == file else s)
    (told,) = load(folder, monkeypatch)
    assert "not ours; it is compiled again" in told
    assert compilations(capsys) == 1


@unix
def test_another_users_link_is_not_followed(folder, monkeypatch, capsys):
    """Neither as the folder nor on the way to it, also behind one of the user's own."""
    parent, lstat = folder.parent, Path.lstat
    link, behind = parent / "link", parent / "behind"
    link.symlink_to(folder)
    behind.symlink_to(f"../{parent.name}/link")
    (parent / "through").symlink_to(parent)
    (folder / "redundant-envs").mkdir()
    ways = (link, link / "redundant-envs", behind, behind / "redundant-envs", parent / "through" / "behind")
    with monkeypatch.context() as context:
        context.setattr(Path, "lstat", lambda p: of_another_user(lstat(p)) if p == link else lstat(p))
        for way in ways:
            assert "link of user" in refused(way, context, capsys)
        assert "link of user" in load(behind / "new" / "redundant-envs", context)[0]
    assert not (folder / "new").exists()  # nor made
    assert load(parent / "through" / "behind", monkeypatch) == []  # all of them are one's own


@unix
def test_what_is_made_is_closed_to_others(tmp_path, monkeypatch):
    before = os.umask(0)
    try:
        load(tmp_path / "new", monkeypatch)
    finally:
        os.umask(before)
    assert all(p.stat().st_mode & 0o77 == 0 for p in (tmp_path / "new", *(tmp_path / "new").iterdir()))
