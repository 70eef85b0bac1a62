"""Cache of machine code, and of facts about programs: in this process, and in a folder of the user."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import platform
import re
import stat
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from redundant_envs.backends import llvm
from redundant_envs.tracing.flow import Program
from redundant_envs.tracing.listing import lines

CACHE_VARIABLE = "REDUNDANT_ENVS_CACHE"
KEPT_PROGRAMS = 1000
"""Number of files of each kind that the folder keeps; the least recently used ones are deleted."""
SUFFIX, FACTS = ".code", ".facts"
OWN_FILE = re.compile(r"[0-9a-f]{40}\.(code|facts|lock)")
"""Names of files that this module makes; it deletes no others."""
DIGEST = 32
"""Length in bytes of the checksum at the beginning of a file."""

_kept: dict[str, dict[str, llvm.Entry]] = {}
_lock = threading.RLock()
if hasattr(os, "register_at_fork"):
    # A fork waits until no thread compiles: its child would never see that thread's locks released.
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
_warned: set[str] = set()


def kernels(
    key: str, names: Sequence[str], program: Callable[[], Program], what: str
) -> dict[str, llvm.Entry]:
    """The kernels of a program in machine code, by name; ``what`` is compiled, says a message.

    Its key is computed before compilation, which changes its graphs.
    """

    def compiled() -> bytes:
        start, told = time.perf_counter(), f"redundant-envs: compiling {what} (once on this machine) ..."
        print(told, file=sys.stderr, end="", flush=True)
        code = llvm.object_code(program())
        print(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
        return code

    with _lock:
        if key not in _kept:
            _kept[key] = llvm.load(_content(f"{key}{SUFFIX}", compiled), names)
        return _kept[key]


def facts(name: str, found: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Facts of plain JSON data under a name of 40 hexadecimal digits; "" keeps nothing."""
    if not name:
        return found()
    return json.loads(_content(f"{name}{FACTS}", lambda: json.dumps(found()).encode()))  # type: ignore[no-any-return]


def identity(program: Program) -> str:
    """A digest of a program: equal for equal ones, on every machine."""
    return hashlib.sha256("\n".join(lines(program)).encode()).hexdigest()


def program_key(program: str, lanes: int) -> str:
    """Name of a program's machine code: from its identity, the lanes of a block that it computes, the
    compiler and the processor."""
    text = "\0".join((program, str(lanes), platform.machine(), *llvm.facts(), *_sources()))
    return hashlib.sha256(text.encode()).hexdigest()[:40]


@functools.cache
def _sources() -> list[str]:
    """The source of the compiler: our own passes and emitters."""
    own = Path(__file__).parent
    files = sorted([*own.glob("llvm*.py"), own / "processors.py", *own.parent.glob("tracing/**/*.py")])
    return [p.read_text(encoding="utf-8") for p in files]


class Folder(NamedTuple):
    """A folder that only this user may write to. Its files are opened relative to the descriptor, so that
    nobody can put another folder in its place."""

    path: Path
    descriptor: int | None
    """None on Windows, which has no such calls, and whose cache folder is closed to other users."""

    def at(self, name: str) -> str:
        """What to call a file by, beside ``dir_fd``."""
        return str(self.path / name) if self.descriptor is None else name

    def open(self, name: str, flags: int) -> int:
        """Descriptor of a file of this user; OSError for anything else, such as a link or a pipe."""
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        file = os.open(self.at(name), flags, 0o600, dir_fd=self.descriptor)
        try:
            status = os.fstat(file)
            if not stat.S_ISREG(status.st_mode):
                raise OSError(f"{self.path / name} is not a file")
            _check_own(self.path / name, status)
        except BaseException:
            os.close(file)
            raise
        return file

    def delete(self, name: str) -> None:
        """Delete a file; another process may have done so."""
        with contextlib.suppress(OSError):
            os.unlink(self.at(name), dir_fd=self.descriptor)


def _check_own(path: Path, status: os.stat_result) -> None:
    """OSError for a folder or a file that another user could have put machine code into."""
    if sys.platform == "win32":
        return
    if status.st_uid != os.geteuid():
        raise OSError(f"{path} belongs to user {status.st_uid}, but this process to user {os.geteuid()}")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise OSError(f"others may write to {path}; forbid it with chmod go-w")


@contextlib.contextmanager
def opened() -> Iterator[Folder]:
    """The folder of :func:`cache_folder`, made if it is missing; OSError if it is not this user's alone."""
    path = cache_folder()
    if not path.is_absolute():  # or there is no home directory for "~"
        raise OSError("it is not an absolute path")
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform == "win32":
        yield Folder(path, None)
        return
    for place in (path, *path.parents):
        status = place.lstat()
        if stat.S_ISLNK(status.st_mode) and status.st_uid not in (0, os.geteuid()):
            raise OSError(f"{place} is a link of user {status.st_uid}, who can have it lead anywhere")
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _check_own(path, os.fstat(descriptor))
        yield Folder(path, descriptor)
    finally:
        os.close(descriptor)


def cache_folder() -> Path:
    """Where machine code is kept."""
    return Path(os.path.expanduser(os.environ.get(CACHE_VARIABLE) or _usual_folder()))


def _usual_folder() -> str:
    """The system's folder for caches, and ours in it. A relative XDG_CACHE_HOME is ignored, as its standard
    says."""
    usual = {"win32": os.environ.get("LOCALAPPDATA", ""), "darwin": "~/Library/Caches"}
    home = usual.get(sys.platform, os.environ.get("XDG_CACHE_HOME", ""))
    return f"{home if home.startswith('~/') or os.path.isabs(home) else '~/.cache'}/redundant-envs"


def _content(name: str, make: Callable[[], bytes]) -> bytes:
    """The content of a file of the folder; made if it is missing."""
    made = functools.cache(make)  # called again if it cannot be kept on disk
    try:
        with opened() as folder:
            return _content_in(folder, name, made)
    except OSError as error:  # another user's folder, no file lock, no space left
        _warn_of_memory_only(cache_folder(), error)
    return made()


def _content_in(folder: Folder, name: str, made: Callable[[], bytes]) -> bytes:
    """The content of a file; made if it is missing or incomplete."""
    if data := _used(folder, name):  # files appear whole: no need to wait for a process that makes the same
        return data
    path = folder.path / name
    with _file_lock(folder, f"{path.stem}.lock"):
        if data := _used(folder, name):
            return data
        damaged, data = os.path.lexists(path), made()
        if path.is_dir() and not path.is_symlink():
            raise OSError(f"{path} is a folder")
        _write_whole(folder, name, _checksum(name, data) + data)
        _prune(folder, path.suffix)
    if damaged:
        what, again = ("compiled simulator", "compiled") if path.suffix == SUFFIX else ("record", "made")
        warnings.warn(f"the {what} {path} was damaged or not ours; it is {again} again", stacklevel=2)
    return data


def _used(folder: Folder, name: str) -> bytes:
    """The content of a file, and nothing if it is not this user's or its checksum is wrong; this counts as a
    use of the file.

    The checksum detects accidents. Nobody else may write to the folder.
    """
    data = b""
    with contextlib.suppress(OSError), open(folder.open(name, os.O_RDONLY), "rb") as file:
        data = file.read()
    if _checksum(name, data[DIGEST:]) != data[:DIGEST]:
        return b""
    with contextlib.suppress(OSError):  # another process may have deleted it
        os.utime(folder.at(name), dir_fd=folder.descriptor)
    return data[DIGEST:]


def _checksum(name: str, data: bytes) -> bytes:
    """Checksum of the content and its file name: that of another program is as wrong as a damaged one."""
    return hashlib.sha256(name.partition(".")[0].encode() + data).digest()


def _write_whole(folder: Folder, name: str, data: bytes) -> None:
    """Write a file so that it appears whole, or not at all."""
    part = f"{name}.{os.urandom(8).hex()}"
    try:
        with open(folder.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as file:
            file.write(data)
        at = folder.descriptor
        os.replace(folder.at(part), folder.at(name), src_dir_fd=at, dst_dir_fd=at)
    except BaseException:
        folder.delete(part)
        raise


def _prune(folder: Folder, suffix: str = SUFFIX) -> None:
    """Delete the least recently used files of a kind beyond the number kept."""
    used = []
    for path in folder.path.iterdir():
        if path.suffix == suffix and OWN_FILE.fullmatch(path.name) and path.is_file():
            with contextlib.suppress(OSError):  # another process may have deleted it
                used.append((path.stat().st_mtime, path))
    for _, path in sorted(used)[:-KEPT_PROGRAMS]:
        folder.delete(path.name)
        folder.delete(f"{path.stem}.lock")


def _warn_of_memory_only(folder: Path, error: OSError) -> None:
    if str(folder) in _warned:
        return
    _warned.add(str(folder))
    warnings.warn(
        f"compiled simulators are kept in memory only: {folder} cannot be used "
        f"({error}); set {CACHE_VARIABLE} to a folder of yours to keep them",
        stacklevel=3,
    )


@contextlib.contextmanager
def _file_lock(folder: Folder, name: str) -> Iterator[None]:
    """One process at a time for one program."""
    with open(folder.open(name, os.O_RDWR | os.O_CREAT), "r+b") as file:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            if sys.platform != "win32":  # a process forked in the meantime has the file open, too
                fcntl.flock(file, fcntl.LOCK_UN)
