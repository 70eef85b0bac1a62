"""Cache of machine code: within this process, and in a folder of the user across processes."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from redundant_envs.backends import llvm
from redundant_envs.tracing.flow import Program
from redundant_envs.tracing.listing import fingerprints

CACHE_VARIABLE = "REDUNDANT_ENVS_CACHE"
KEPT_PROGRAMS = 1000
"""Number of programs that the folder keeps; the least recently used ones are deleted."""
SUFFIX = ".code"
OWN_FILE = re.compile(r"[0-9a-f]{40}\.(code|lock)")
"""Names of files that this module makes; it deletes no others."""
DIGEST = 32
"""Length in bytes of the checksum at the beginning of a file."""

_kept: dict[str, dict[str, llvm.Entry]] = {}
_lock = threading.RLock()
if hasattr(os, "register_at_fork"):
    # A fork waits until no thread compiles: its child would never see that thread's locks released.
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
_warned: set[str] = set()


def kernels(key: str, program: Program, what: str) -> dict[str, llvm.Entry]:
    """The kernels of a program in machine code, by name; ``what`` is compiled, says a message.

    Its key is computed before compilation, which changes its graphs.
    """
    with _lock:
        if key not in _kept:
            _kept[key] = llvm.load(_code(key, program, what), [k.name for k in program.kernels])
        return _kept[key]


def identity(program: Program) -> str:
    """A digest of a program: equal for equal ones, on every machine."""
    return hashlib.sha256("\n".join(fingerprints(program)).encode()).hexdigest()


def program_key(program: str, lanes: int) -> str:
    """Name of a program's machine code: from its identity, the lanes of a block that it computes, the
    compiler and the processor."""
    text = "\0".join((program, str(lanes), platform.machine(), *llvm.facts(), *_sources()))
    return hashlib.sha256(text.encode()).hexdigest()[:40]


@functools.cache
def _sources() -> list[str]:
    """The source of the compiler: our own passes and emitters."""
    own = Path(__file__).parent
    files = sorted([*own.glob("llvm*.py"), *own.parent.glob("tracing/**/*.py")])
    return [p.read_text(encoding="utf-8") for p in files]


def _code(key: str, program: Program, what: str) -> bytes:
    folder = cache_folder()

    @functools.cache  # called again if the code cannot be kept on disk
    def compiled() -> bytes:
        start, told = time.perf_counter(), f"redundant-envs: compiling {what} (once on this machine) ..."
        print(told, file=sys.stderr, end="", flush=True)
        code = llvm.object_code(program)
        print(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
        return code

    if folder is not None:
        try:
            return _code_in(folder, key, compiled)
        except OSError as error:  # no file lock, no space left, files of another user
            _warn_of_memory_only(folder, error)
    return compiled()


def _code_in(folder: Path, key: str, compiled: Callable[[], bytes]) -> bytes:
    """The machine code in a folder; compiled if it is missing or incomplete."""
    path = folder / f"{key}{SUFFIX}"
    if code := _used(path):  # files appear whole: no need to wait for a process that compiles the same again
        return code
    with _file_lock(path.with_suffix(".lock")):
        if code := _used(path):
            return code
        damaged, code = os.path.lexists(path), compiled()
        if path.is_dir() and not path.is_symlink():
            raise OSError(f"{path} is a folder")
        _write_whole(path, _checksum(path, code) + code)
        _prune(folder)
    if damaged:
        warnings.warn(
            f"the compiled simulator {path} was damaged or not ours; it is compiled again", stacklevel=2
        )
    return code


def _used(path: Path) -> bytes:
    """The code in a file, and nothing if its checksum is wrong; this counts as a use of the file.

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


def _checksum(path: Path, code: bytes) -> bytes:
    """Checksum of the code and its file name: the code of another program is as wrong as a damaged one."""
    return hashlib.sha256(path.stem.encode() + code).digest()


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


def _prune(folder: Path) -> None:
    """Delete the least recently used programs beyond the number kept."""
    own = [p for p in folder.iterdir() if p.suffix == SUFFIX and OWN_FILE.fullmatch(p.name) and p.is_file()]
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
