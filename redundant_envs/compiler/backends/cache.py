"""Cache of machine code, and of facts about programs: in this process, and in a folder of the user."""

from __future__ import annotations

import contextlib
import errno
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.compiler.tracing.listing import lines
from redundant_envs.support.values import say

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

CACHE_VARIABLE = "REDUNDANT_ENVS_CACHE"
KEPT_BYTES = 1 << 29
"""Most bytes that the folder keeps; a simulator has some 200 kB. The least recently used files go first."""
ABANDONED = 3600.0
"""Age in s of an unfinished file that no process can be writing any more."""
SILENT_WAIT, LONGEST_WAIT = 3.0, 180.0
"""Waiting for a process that compiles the same: s until it is told, and until this one does not wait any
longer. Usual scenes take a second, the largest a minute."""
SUFFIX, FACTS = ".code", ".facts"
OWN_FILE = re.compile(r"([0-9a-f]{40})\.(code|facts|lock)(\.[0-9a-f]{16})?")
"""Names of files that this module makes; it deletes no others. Unfinished ones have the third part."""
MAX_LINKS = 40
"""Links on the way to the folder, as many as Linux follows."""
DIGEST = 32
"""Length in bytes of the checksum at the beginning of a file."""

KEPT_KERNELS = 100
"""Programs whose machine code, some 0.4 MB each, stays in this process though no simulator uses it."""

_kept: dict[str, dict[str, llvm.Entry]] = {}
"""The kernels that were asked for last, the latest at the end."""
_engines: WeakValueDictionary[str, Any] = WeakValueDictionary()
"""The owners of these, and of all others that simulators use."""
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

    def compiled(kept: bool) -> bytes:
        start, how_long = time.perf_counter(), "once on this machine" if kept else "for this process alone"
        say(f"redundant-envs: compiling {what} ({how_long}) ...", file=sys.stderr, end="", flush=True)
        code = llvm.object_code(program())
        say(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
        return code

    with _lock:
        found = _kept.pop(key, None)
        if found is None and key in _engines:
            found = llvm.entries(_engines[key], names)
        if found is None:
            found = llvm.load(_content(f"{key}{SUFFIX}", what, compiled), names)
            _engines[key] = next(iter(found.values())).engine  # type: ignore[attr-defined]
        _kept[key] = found
        if len(_kept) > KEPT_KERNELS:
            del _kept[next(iter(_kept))]
        return found


def facts(name: str, found: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Facts of plain JSON data under a name of 40 hexadecimal digits; "" keeps nothing."""
    if not name:
        return found()
    data = _content(f"{name}{FACTS}", "a record", lambda kept: json.dumps(found()).encode())
    return json.loads(data)  # type: ignore[no-any-return]


def identity(program: Program) -> str:
    """A digest of a program: equal for equal ones, on every machine."""
    return hashlib.sha256("\n".join(lines(program)).encode()).hexdigest()


def with_fields(program: str, fields: Mapping[str, tuple[str, int]]) -> str:
    """A digest of a program, from its :func:`identity`, and of the memory and row of each of its fields."""
    rows = (f"{name}: {memory}[{row}]" for name, (memory, row) in fields.items())
    return hashlib.sha256("\n".join((program, *rows)).encode()).hexdigest()


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
    if sys.platform != "win32":
        _check_links(path)
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform == "win32":
        yield Folder(path, None)
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _check_own(path, os.fstat(descriptor))
        yield Folder(path, descriptor)
    finally:
        os.close(descriptor)


def _check_links(path: Path) -> None:
    """OSError if a link of another user is on the way to a folder, also behind one of this user's own."""
    at, names, links = Path(path.anchor), [*path.parts[:0:-1]], 0
    while names:
        place = at / names.pop()
        try:
            status = place.lstat()
        except FileNotFoundError:
            return  # it will be made
        if not stat.S_ISLNK(status.st_mode):
            at = at.parent if place.name == ".." else place
            continue
        if status.st_uid not in (0, os.geteuid()):
            raise OSError(f"{place} is a link of user {status.st_uid}, who can have it lead anywhere")
        if (links := links + 1) > MAX_LINKS:
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
        target = at / os.readlink(place)  # from the root if it says so
        at, names = Path(target.anchor), [*names, *target.parts[:0:-1]]


def cache_folder() -> Path:
    """Where machine code is kept; no absolute path if there is no home directory, or its name is empty."""
    place = os.environ.get(CACHE_VARIABLE) or _usual_folder()
    homeless = os.environ.get("USERPROFILE" if sys.platform == "win32" else "HOME") == ""
    unknown = homeless and place.startswith(("~/", "~\\"))
    return Path(place) if unknown else Path(os.path.expanduser(place))


def _usual_folder() -> str:
    """The system's folder for caches, and ours in it. A relative XDG_CACHE_HOME is ignored, as its standard
    says."""
    usual = {"win32": os.environ.get("LOCALAPPDATA", ""), "darwin": "~/Library/Caches"}
    home = usual.get(sys.platform, os.environ.get("XDG_CACHE_HOME", ""))
    return f"{home if home.startswith('~/') or os.path.isabs(home) else '~/.cache'}/redundant-envs"


def _content(name: str, what: str, make: Callable[[bool], bytes]) -> bytes:
    """The content of a file of the folder; if it is missing it is made by ``make``, which takes whether it
    will be kept."""
    made: list[bytes] = []

    def once(kept: bool) -> bytes:
        made.extend([] if made else [make(kept)])
        return made[0]

    try:
        with opened() as folder:
            return _content_in(folder, name, what, once)
    except OSError as error:  # another user's folder, no file lock, no space left
        _warn_of_memory_only(cache_folder(), error)
    return once(False)


def _content_in(folder: Folder, name: str, what: str, made: Callable[[bool], bytes]) -> bytes:
    """The content of a file; made if it is missing or incomplete."""
    if data := _used(folder, name):  # files appear whole: no need to wait for a process that makes the same
        return data
    path = folder.path / name
    with _file_lock(folder, f"{path.stem}.lock", what):
        if data := _used(folder, name):
            return data
        damaged, data = os.path.lexists(path), made(True)
        if path.is_dir() and not path.is_symlink():
            raise OSError(f"{path} is a folder")
        _write_whole(folder, name, _checksum(name, data) + data)
        _prune(folder)
    if damaged:
        kind, again = ("compiled simulator", "compiled") if path.suffix == SUFFIX else ("record", "made")
        warnings.warn(f"the {kind} {path} was damaged or not ours; it is {again} again", stacklevel=2)
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


def _files(folder: Folder) -> list[tuple[float, int, str]]:
    """Last use, size and name of the files that this module made, the newest first."""
    found = []
    with os.scandir(folder.path if folder.descriptor is None else folder.descriptor) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):  # another process may have deleted it
                if OWN_FILE.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                    status = entry.stat(follow_symlinks=False)
                    found.append((status.st_mtime, status.st_size, entry.name))
    return sorted(found, reverse=True)


def _prune(folder: Folder) -> None:
    """Delete what a killed process left unfinished, and the least recently used files beyond those kept."""
    files, filled = _files(folder), 0
    for used, size, name in files:
        program, kind, unfinished = OWN_FILE.fullmatch(name).groups()  # type: ignore[union-attr]
        if unfinished:
            if used < time.time() - ABANDONED:
                folder.delete(name)
        elif kind != "lock":
            fits = filled == 0 or filled + size <= KEPT_BYTES
            filled += size
            if not fits:
                folder.delete(name)
                folder.delete(f"{program}.lock")


def usage(clear: bool = False) -> str:
    """What the folder of compiled code holds, and, if it is cleared, held; OSError if it is not used."""
    try:
        with opened() as folder:
            files = _files(folder)
            if clear:
                for _, _, name in files:
                    folder.delete(name)
    except OSError as error:
        raise OSError(_unusable(cache_folder(), error)) from None
    size = sum(size for _, size, _ in files)
    kept = sum(not name.endswith(".lock") for _, _, name in files)
    most = f"at most {KEPT_BYTES / 1e6:.0f} MB are kept"
    return f"{folder.path}: {kept} files, {size / 1e6:.1f} MB{' deleted' if clear else f'; {most}'}"


def _warn_of_memory_only(folder: Path, error: OSError) -> None:
    if str(folder) in _warned:
        return
    _warned.add(str(folder))
    warnings.warn(f"compiled simulators are kept in memory only: {_unusable(folder, error)}", stacklevel=3)


def _unusable(folder: Path, error: OSError) -> str:
    return f"{folder} cannot be used ({error}); set {CACHE_VARIABLE} to a folder of yours to keep them"


@contextlib.contextmanager
def _file_lock(folder: Folder, name: str, what: str) -> Iterator[None]:
    """One process at a time for one program; OSError if another one takes too long."""
    with open(folder.open(name, os.O_RDWR | os.O_CREAT), "r+b") as file:
        start, told = time.monotonic(), False
        while not _locked(file.fileno()):
            waited = time.monotonic() - start
            if waited > LONGEST_WAIT:
                raise OSError(f"another process has held {folder.path / name} for {waited:.0f} s")
            if waited > SILENT_WAIT and not told:
                told = True
                say(
                    f"redundant-envs: waiting for another process that makes {what} (it has locked "
                    f"{folder.path / name}), for at most {LONGEST_WAIT:.0f} s ...",
                    file=sys.stderr,
                )
            time.sleep(min(0.1, 0.001 + waited / 10))
        try:
            yield
        finally:
            if sys.platform != "win32":  # a process forked in the meantime has the file open, too
                fcntl.flock(file, fcntl.LOCK_UN)


def _locked(descriptor: int) -> bool:
    """Lock a file, if no other process has; OSError if the file system has no locks."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLOCK):
            return False
        raise
    return True
