"""Cache of machine code, and of facts about programs: in this process, and in a folder of the user."""

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
from typing import Any

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
SILENT_WAIT, LONGEST_WAIT = 3.0, 180.0
"""s of waiting for a process that compiles the same until it is told, and until it ends. Usual scenes take a
second, the largest a minute."""
SUFFIX, FACTS = ".code", ".facts"
OWN_FILE = re.compile(r"[0-9a-f]{40}\.(lock|(code|facts)(\.[0-9a-f]{16})?)")
"""Names of files that this module makes; it deletes no others. Unfinished ones have the last part."""
DIGEST = 32
"""Length in bytes of the checksum at the beginning of a file."""
KEPT_KERNELS = 100
"""Programs whose machine code, some 0.4 MB each, stays in this process though no simulator uses it."""

_kept: dict[str, dict[str, llvm.Entry]] = {}
"""The kernels that were asked for last, the latest at the end."""
_lock = threading.RLock()
if hasattr(os, "register_at_fork"):
    # A fork waits until no thread compiles: its child would never see that thread's locks released.
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
_warned: set[Path] = set()


def kernels(
    key: str, names: Sequence[str], program: Callable[[], Program], what: str
) -> dict[str, llvm.Entry]:
    """The kernels of a program in machine code, by name; ``what`` is compiled, says a message."""
    with _lock:
        entries = _kept.pop(key, None) or llvm.load(
            code(key, lambda: llvm.object_code(program()), what), names
        )
        _kept[key] = entries
        if len(_kept) > KEPT_KERNELS:
            del _kept[next(iter(_kept))]
        return entries


def code(key: str, make: Callable[[], bytes], what: str) -> bytes:
    """The code of a program, under a key from before its compilation, which changes its graphs."""

    def compiled(how_long: str) -> bytes:
        start = time.perf_counter()
        say(f"redundant-envs: compiling {what} ({how_long}) ...", file=sys.stderr, end="", flush=True)
        code = make()
        say(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
        return code

    return _content(f"{key}{SUFFIX}", what, compiled)


def facts(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Facts of plain JSON data under a name of 40 hexadecimal digits; "" keeps nothing."""
    if not name:
        return compute()
    data = _content(f"{name}{FACTS}", "a record", lambda how_long: json.dumps(compute()).encode())
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
    compiler, our own part of which is told by its source, and the processor."""
    text = "\0".join((program, str(lanes), platform.machine(), *llvm.facts(), *_sources()))
    return hashlib.sha256(text.encode()).hexdigest()[:40]


@functools.cache
def _sources() -> list[str]:
    package = Path(__file__).parents[2]
    files = sorted(path for room in ("compiler", "language") for path in (package / room).rglob("*.py"))
    return [path.read_text(encoding="utf-8") for path in files]


def _content(name: str, what: str, make: Callable[[str], bytes]) -> bytes:
    """The content of a file, which is made if it is missing or damaged."""
    data = b""
    try:
        path = usable_folder() / name
        if data := _used(path):  # files appear whole: no need to wait for a process that makes the same
            return data
        with _file_lock(path.with_suffix(".lock"), what):
            if data := _used(path):
                return data
            damaged = os.path.lexists(path)
            data = make("once on this machine")
            _write_whole(path, _checksum(path, data) + data)
            _prune(path.parent)
        if damaged:
            warnings.warn(f"{path} was damaged or not ours; it is made again", stacklevel=4)
    except OSError as error:  # another user's folder, no file lock, no space left
        if (folder := cache_folder()) not in _warned:
            _warned.add(folder)
            warnings.warn(f"compiled simulators are kept in memory only: {_unusable(error)}", stacklevel=4)
    return data or make("for this process alone")


def cache_folder() -> Path:
    """Where machine code is kept: the system's folder for caches, and ours in it, unless the user says
    another one. A relative XDG_CACHE_HOME is ignored, as its standard says."""
    if place := os.environ.get(CACHE_VARIABLE):
        return Path(os.path.expanduser(place))
    systems = {"win32": os.environ.get("LOCALAPPDATA", ""), "darwin": "~/Library/Caches"}
    home = os.path.expanduser(systems.get(sys.platform, os.environ.get("XDG_CACHE_HOME", "")))
    return Path(home if os.path.isabs(home) else os.path.expanduser("~/.cache")) / "redundant-envs"


def usable_folder() -> Path:
    """This folder, made if it is missing; OSError if another user could put code into it."""
    path = cache_folder()
    if not path.is_absolute():  # or there is no home directory for "~"
        raise OSError("it is not an absolute path")
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check_own(path, path.stat())
    return path


def _check_own(path: Path, status: os.stat_result) -> None:
    """OSError for a folder or a file that another user could have put machine code into."""
    if sys.platform == "win32":  # whose cache folder is closed to others
        return
    if status.st_uid != os.geteuid():
        raise OSError(f"{path} belongs to user {status.st_uid}, but this process to user {os.geteuid()}")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise OSError(f"others may write to {path}; forbid it with chmod go-w")


def _opened(path: Path, flags: int) -> int:
    """Descriptor of a file of this user; OSError for anything else, such as a link or a pipe."""
    flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    file = os.open(path, flags, 0o600)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{path} is not a file")
        _check_own(path, status)
    except BaseException:
        os.close(file)
        raise
    return file


def _used(path: Path) -> bytes:
    """The content of a file; none if it is not this user's, or its checksum is wrong. That is for accidents:
    nobody else may write to the folder. Reading counts as a use of the file."""
    data = b""
    with contextlib.suppress(OSError), open(_opened(path, os.O_RDONLY), "rb") as file:
        data = file.read()
    if _checksum(path, data[DIGEST:]) != data[:DIGEST]:
        return b""
    with contextlib.suppress(OSError):  # another process may have deleted it
        os.utime(path)
    return data[DIGEST:]


def _checksum(path: Path, data: bytes) -> bytes:
    """Checksum of the content and its file name: that of another program is as wrong as a damaged one."""
    return hashlib.sha256(path.stem.encode() + data).digest()


def _write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it appears whole, or not at all."""
    part = path.with_name(f"{path.name}.{os.urandom(8).hex()}")
    try:
        with open(_opened(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as file:
            file.write(data)
        os.replace(part, path)
    except BaseException:
        _delete(part)
        raise


def _delete(path: Path) -> None:
    with contextlib.suppress(OSError):  # another process may have done so
        path.unlink()


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Last use, size and path of the files that this module made, the newest first."""
    files = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):  # another process may have deleted it
            if OWN_FILE.fullmatch(path.name) and stat.S_ISREG((status := path.lstat()).st_mode):
                files.append((status.st_mtime, status.st_size, path))
    return sorted(files, reverse=True)


def _prune(folder: Path) -> None:
    """Delete the least recently used files beyond those kept, unfinished ones of killed processes, too."""
    filled = 0
    for _, size, path in _files(folder):
        filled += size
        if filled > KEPT_BYTES:
            _delete(path)


def usage(clear: bool = False) -> str:
    """What the folder of compiled code holds, and, if it is cleared, held; OSError if it is not used."""
    try:
        folder = usable_folder()
        files = _files(folder)
    except OSError as error:
        raise OSError(_unusable(error)) from None
    for _, _, path in files if clear else ():
        _delete(path)
    size = sum(size for _, size, _ in files)
    count = sum(path.suffix != ".lock" for _, _, path in files)
    most = f"at most {KEPT_BYTES / 1e6:.0f} MB are kept"
    return f"{folder}: {count} files, {size / 1e6:.1f} MB{' deleted' if clear else f'; {most}'}"


def _unusable(error: OSError) -> str:
    fix = f"set {CACHE_VARIABLE} to a folder of yours to keep them"
    return f"{cache_folder()} cannot be used ({error}); {fix}"


@contextlib.contextmanager
def _file_lock(path: Path, what: str) -> Iterator[None]:
    """One process at a time for one program; OSError if another one takes too long."""
    with open(_opened(path, os.O_RDWR | os.O_CREAT), "r+b") as file:
        start, announced = time.monotonic(), False
        while not _locked(file.fileno()):
            waited = time.monotonic() - start
            if waited > LONGEST_WAIT:
                raise OSError(f"another process has held {path} for {waited:.0f} s")
            if waited > SILENT_WAIT and not announced:
                announced = True
                waiting = f"waiting for another process that makes {what} (it has locked {path})"
                say(f"redundant-envs: {waiting}, for at most {LONGEST_WAIT:.0f} s ...", file=sys.stderr)
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
