"""Compile assembled text with numba, once per machine, and hold the memory of a batch."""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import marshal
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import types
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.evaluators import checksums
from redundant_envs.evaluators.arrays import PRIMITIVES
from redundant_envs.evaluators.assemble import LANES, Assembly
from redundant_envs.evaluators.binding import run
from redundant_envs.evaluators.checksums import is_whole, write_checksums, write_whole

CACHE_VARIABLE = "REDUNDANT_ENVS_CACHE"
KEPT_MODULES = 200
MODULE = "simulator.py"
CODE = "simulator.code"
"""The module as Python compiles it, which takes as long as loading the kernels does."""

SETTINGS = (
    "CPU_NAME", "CPU_FEATURES", "ENABLE_AVX", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE",
    "LLVM_REFPRUNE_PASS", "LLVM_REFPRUNE_FLAGS", "DISABLE_INTEL_SVML", "USING_SVML",
    "BOUNDSCHECK", "DEBUG", "DEBUG_JIT", "DEBUG_NRT", "DEBUGINFO_DEFAULT",
    "EXTEND_VARIABLE_LIFETIMES", "ENABLE_PROFILING", "NRT_STATS", "DISABLE_JIT",
)  # fmt: skip
"""Settings of numba (NUMBA_CPU_NAME and so on) that change what it makes of a module."""

_loaded: dict[str, dict[str, Callable[..., Any]]] = {}
_lock = threading.RLock()
_warned: set[str] = set()

KERNELS = """

OPTIONS_KERNEL = dict(OPTIONS, nogil=True, cache=CACHE, boundscheck=False)
for _name, _signature in SIGNATURES.items():
    globals()[_name] = njit(_signature, **OPTIONS_KERNEL)(globals()[_name])
"""


ORDER = "-enable-misched={}"
"""LLVM's option for an order of its own."""


def cache_folder() -> Path | None:
    """Where compiled modules live, or None where nothing may be written."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        base = Path(chosen)
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or "~") / "redundant-envs"
    elif sys.platform == "darwin":
        base = Path("~/Library/Caches/redundant-envs")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "redundant-envs"
    try:
        base = base.expanduser().absolute()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            pass
    except (OSError, RuntimeError) as error:  # RuntimeError: nobody knows a home for "~"
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


def module_key(text: str) -> str:
    """Name of a compiled module: a hash of its text, of all that compiles it and how, and of the CPU."""
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    facts = (
        text,
        KERNELS,
        ORDER,
        CODE,
        checksums.FILE,
        numba.__version__,
        llvmlite.__version__,
        sys.version,
        platform.machine(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
        *(f"{name} {getattr(numba.config, name, None)!r}" for name in SETTINGS),
    )
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()[:32]


def compiled(assembly: Assembly) -> dict[str, Callable[..., Any]]:
    """The compiled kernels of an assembly, from memory, the cache folder, or the compiler."""
    key = module_key(assembly.text)
    with _lock:
        if key not in _loaded:
            _forks_wait()
            scene = assembly.scene
            what = (
                f"{scene.robot.kind} {scene.integrator} with "
                f"{', '.join(type(e).__name__ for e in scene.effects) or 'no effects'}"
                f"{', as an environment' if assembly.task else ''}"
            )
            _loaded[key] = _load(key, assembly.text, what)
        return _loaded[key]


def _load(key: str, text: str, what: str) -> dict[str, Callable[..., Any]]:
    base = cache_folder()
    if base is not None:
        try:
            return _load_kept(base / key, text + KERNELS, what)
        except OSError as error:  # no file lock, no room left, files of somebody else
            _warn_of_memory_only(base / key, error)
    return compiled_in_memory(text, what)


def compiled_in_memory(text: str, what: str) -> dict[str, Callable[..., Any]]:
    """The kernels of a module, kept nowhere."""
    with _announced(what), _order_kept():
        code = compile(text + KERNELS, "<assembled scene>", "exec")
        return _execute("redundant_envs_compiled", code, cache=False)


def _load_kept(folder: Path, text: str, what: str) -> dict[str, Callable[..., Any]]:
    """The kernels of a module in the cache; compiled anew if it is not there whole."""
    path = folder / MODULE
    with _file_lock(folder.with_suffix(".lock")):
        whole, damaged = is_whole(folder, (MODULE, CODE), text), os.path.lexists(folder)
        if not whole:
            if damaged:
                own = folder.is_dir() and not folder.is_symlink()
                shutil.rmtree(folder) if own else folder.unlink()
            folder.mkdir(mode=0o700)
            write_whole(path, text)
            (folder / CODE).write_bytes(marshal.dumps(compile(text, str(path), "exec")))
        code = marshal.loads((folder / CODE).read_bytes())
        if code.co_filename != str(path):  # the cache was moved, and numba looks where the code says
            code = compile(text, str(path), "exec")
        with contextlib.nullcontext() if whole else _announced(what), _order_kept(), _files_beside_module():
            kernels = _execute(f"redundant_envs_compiled_{folder.name}", code, cache=True)
        if not whole:
            write_checksums(folder)
            _prune(folder.parent)
        os.utime(folder)
    if damaged and not whole:
        warnings.warn(
            f"the compiled simulator in {folder} was damaged or left unfinished; it is compiled anew",
            stacklevel=2,
        )
    return kernels


def _execute(name: str, code: types.CodeType, cache: bool) -> dict[str, Callable[..., Any]]:
    """The kernels of a module."""
    module = types.ModuleType(name)
    module.__dict__.update(CACHE=cache, __file__=code.co_filename)
    if cache:
        sys.modules[name] = module  # numba finds it by its name
    exec(code, module.__dict__)
    return {k: getattr(module, k) for k in module.SIGNATURES}


@contextlib.contextmanager
def _files_beside_module() -> Iterator[None]:
    """Numba keeps what it compiles beside the module, where the checksums are, whatever its settings say."""
    from numba import config

    own = {n: getattr(config, n) for n in ("CACHE_DIR", "CACHE_LOCATOR_CLASSES") if hasattr(config, n)}
    try:
        for name in own:
            setattr(config, name, "")
        yield
    finally:
        for name, value in own.items():
            setattr(config, name, value)


@contextlib.contextmanager
def _announced(what: str) -> Iterator[None]:
    print(f"redundant-envs: compiling {what} (once on this machine) ...", file=sys.stderr, end="", flush=True)
    start = time.perf_counter()
    yield
    print(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _order_kept() -> Iterator[None]:
    """LLVM leaves instructions in the order they are given, as evaluators/instructions.py wants.

    The switch is one for all that LLVM compiles, so nothing else may compile meanwhile.
    """
    import llvmlite.binding as llvm
    from numba.core.compiler_lock import global_compiler_lock

    with global_compiler_lock:
        llvm.set_option("redundant-envs", ORDER.format("false"))
        try:
            yield
        finally:
            llvm.set_option("redundant-envs", ORDER.format("true"))


@contextlib.contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    """One process at a time for one module."""
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
            if sys.platform != "win32":  # a process forked meanwhile has the file open too
                fcntl.flock(file, fcntl.LOCK_UN)


def _prune(base: Path) -> None:
    """Delete the modules not used for longest beyond the number kept."""
    own = re.compile(r"[0-9a-f]{32}")  # never anything else that may lie in a folder of the user's
    folders = [p for p in base.iterdir() if own.fullmatch(p.name) and (p / MODULE).is_file()]
    if len(folders) <= KEPT_MODULES:
        return
    folders.sort(key=lambda p: p.stat().st_mtime)
    for folder in folders[:-KEPT_MODULES]:
        shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def _forks_wait() -> None:
    """A fork waits until no thread compiles: its child would never see that thread's locks released.

    To be called before the first module is compiled and after numba is imported. What is registered
    last waits first: whoever forks then holds no lock yet, of logging for one, that numba needs.
    """
    from numba.core.compiler_lock import global_compiler_lock

    def before() -> None:
        _lock.acquire()
        global_compiler_lock.acquire()

    def after() -> None:
        global_compiler_lock.release()
        _lock.release()

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=before, after_in_parent=after, after_in_child=after)


class Memory:
    """The numbers of all lanes of an assembly: blocks of 8 lanes, 64-byte aligned.

    Lanes beyond ``count`` pad the last block; they hold the nominal scene at rest. A copy has an
    array of its own, aligned anew: ``with_scratch``, ``flat`` and ``blocks`` are views of one array.
    """

    def __init__(self, assembly: Assembly, count: int) -> None:
        self._allocate(assembly, count)
        for name, value in assembly.parameters.items():
            self.blocks[:, self.rows[name]] = value
        self.prepare()
        scene = assembly.scene
        self.blocks[:, self.rows["h"]] = scene.control_dt / scene.substeps
        self.blocks[:, self.rows["interval"]] = scene.control_dt
        for name, value in (assembly.lanes.constant if assembly.lanes else {}).items():
            self.blocks[:, self.rows[name]] = value

    def _allocate(self, assembly: Assembly, count: int) -> None:
        self.assembly = assembly
        self.count = count
        self.rows = assembly.rows
        blocks = -(-count // LANES)
        size = blocks * assembly.stride
        raw = np.zeros(size + assembly.scratch + 8)
        offset = (-raw.ctypes.data % 64) // 8
        self.with_scratch: np.ndarray = raw[offset : offset + size + assembly.scratch]
        self.flat = self.with_scratch[:size]
        self.blocks = self.flat.reshape(blocks, len(self.rows), LANES)
        self.index = np.arange(count)

    def __getstate__(self) -> dict[str, Any]:
        """The numbers of all lanes; the scratch block is empty between calls."""
        return {"assembly": self.assembly, "count": self.count, "numbers": self.flat.copy()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._allocate(state["assembly"], state["count"])
        self.flat[:] = state["numbers"]

    def __copy__(self) -> Memory:
        return copy.deepcopy(self)

    def prepare(self) -> None:
        """Renew what follows from the parameters alone; to be called after they are set."""
        values: dict[str, Any] = {n: self.blocks[:, self.rows[n]] for n in self.assembly.parameters}
        with np.errstate(all="ignore"):  # both sides of a choice are computed, as in compiled code
            run(self.assembly.prepared, values, PRIMITIVES)
        for call in self.assembly.prepared:
            for name in call.names:
                self.blocks[:, self.rows[name]] = values[name]

    def forget(self, index: np.ndarray) -> None:
        """Lanes that a stop holds are let go, and their steps chosen anew: a new motion begins."""
        lanes = self.assembly.lanes
        if lanes:
            self.write((*lanes.modes, "next_step"), 0.0, index)

    def read(self, names: tuple[str, ...], index: np.ndarray | None = None) -> np.ndarray:
        """Numbers of some lanes as a new array (lanes, names)."""
        rows = [self.rows[n] for n in names]
        if index is None:
            table = self.blocks[:, rows].transpose(0, 2, 1).reshape(-1, len(rows))
            return np.ascontiguousarray(table[: self.count])
        lanes = np.asarray(index)
        return self.blocks[lanes[:, None] // LANES, rows, lanes[:, None] % LANES]

    def write(self, names: tuple[str, ...], values: Any, index: np.ndarray | None = None) -> None:
        """Set numbers of some lanes from an array that broadcasts to (lanes, names)."""
        rows = [self.rows[n] for n in names]
        lanes = self.index if index is None else np.asarray(index)
        self.blocks[lanes[:, None] // LANES, rows, lanes[:, None] % LANES] = values
