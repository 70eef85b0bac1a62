"""Cache of machine code, and of facts about programs: in this process, and in a folder of the user."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import platform
import re
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

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


def _content(name: str, make: Callable[[], bytes]) -> bytes:
    """The content of a file of the folder; made if it is missing."""
    folder, made = cache_folder(), functools.cache(make)  # called again if it cannot be kept on disk
    if folder is not None:
        try:
            return _content_in(folder / name, made)
        except OSError as error:  # no file lock, no space left, files of another user
            _warn_of_memory_only(folder, error)
    return made()


def _content_in(path: Path, made: Callable[[], bytes]) -> bytes:
    """The content of a file; made if it is missing or incomplete."""
    if data := _used(path):  # files appear whole: no need to wait for a process that makes the same
        return data
    with _file_lock(path.with_suffix(".lock")):
        if data := _used(path):
            return data
        damaged, data = os.path.lexists(path), made()
        if path.is_dir() and not path.is_symlink():
            raise OSError(f"{path} is a folder")
        _write_whole(path, _checksum(path, data) + data)
        _prune(path.parent, path.suffix)
    if damaged:
        what, again = ("compiled simulator", "compiled") if path.suffix == SUFFIX else ("record", "made")
        warnings.warn(f"the {what} {path} was damaged or not ours; it is {again} again", stacklevel=2)
    return data


def _used(path: Path) -> bytes:
    """The content of a file, and nothing if its checksum is wrong; this counts as a use of the file.

    This detects accidents. It cannot protect against anyone who may write to the folder.
    """
    data = b""
    if path.is_file():  # reading a pipe would never end
        with contextlib.suppress(OSError):
            data = path.read_bytes()
    if _checksum(path, data[DIGEST:]) != data[:DIGEST]:
        return b""
    with contextlib.suppress(OSError):  # another process may have deleted it, or it is not ours
        os.utime(path)
    return data[DIGEST:]


def _checksum(path: Path, data: bytes) -> bytes:
    """Checksum of the content and its file name: that of another program is as wrong as a damaged one."""
    return hashlib.sha256(path.stem.encode() + data).digest()


def _write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it appears whole, or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _prune(folder: Path, suffix: str = SUFFIX) -> None:
    """Delete the least recently used files of a kind beyond the number kept."""
    own = [p for p in folder.iterdir() if p.suffix == suffix and OWN_FILE.fullmatch(p.name) and p.is_file()]
    used = []
    for path in own:
        with contextlib.suppress(OSError):  # another process may have deleted it
            used.append((path.stat().st_mtime, path))
    for _, path in sorted(used)[:-KEPT_PROGRAMS]:
        path.unlink(missing_ok=True)
        path.with_suffix(".lock").unlink(missing_ok=True)


def cache_folder() -> Path | None:
    """The folder for machine code, or None if nothing may be written."""
    usual = {"win32": os.environ.get("LOCALAPPDATA") or "~", "darwin": "~/Library/Caches"}
    home = usual.get(sys.platform, os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    base = Path(os.environ.get(CACHE_VARIABLE) or f"{home}/redundant-envs")
    try:
        base = base.expanduser().absolute()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            pass
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home directory for "~"
        _warn_of_memory_only(base, error)
        return None
    return base


def _warn_of_memory_only(folder: Path, error: Exception) -> None:
    if str(folder) in _warned:
        return
    _warned.add(str(folder))
    warnings.warn(
        f"compiled simulators are kept in memory only: {folder} cannot be used "
        f"({error}); set {CACHE_VARIABLE} to a folder of yours to keep them",
        stacklevel=3,
    )


@contextlib.contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    """One process at a time for one program."""
    with open(path, "a+b") as file:
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
