"""Compile assembled text with numba, once per machine, and hold the memory of a batch."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import importlib.util
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

from redundant_envs.evaluators.arrays import PRIMITIVES
from redundant_envs.evaluators.assemble import LANES, Assembly
from redundant_envs.evaluators.binding import run

CACHE_VARIABLE = "REDUNDANT_ENVS_CACHE"
KEPT_MODULES = 200
MODULE = "simulator.py"

_loaded: dict[str, dict[str, Callable[..., Any]]] = {}
_lock = threading.Lock()
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
        base = Path(os.environ.get("LOCALAPPDATA", Path.home())) / "redundant-envs"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches" / "redundant-envs"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "redundant-envs"
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            pass
    except OSError as error:
        if str(base) not in _warned:
            _warned.add(str(base))
            warnings.warn(
                f"compiled simulators are kept in memory only: {base} cannot be written "
                f"({error}); set {CACHE_VARIABLE} to a folder of yours to keep them",
                stacklevel=2,
            )
        return None
    return base


def module_key(text: str) -> str:
    """Name of a compiled module: a hash of its text, of all that compiles it, and of the CPU."""
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    facts = (
        text,
        KERNELS,
        ORDER,
        numba.__version__,
        llvmlite.__version__,
        sys.version,
        platform.machine(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    )
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()[:32]


def compiled(assembly: Assembly) -> dict[str, Callable[..., Any]]:
    """The compiled kernels of an assembly, from memory, the cache folder, or the compiler."""
    key = module_key(assembly.text)
    with _lock:
        if key not in _loaded:
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
    if base is None:
        return _compile_in_memory(text, what)
    folder = base / key
    with _file_lock(base / f"{key}.lock"):
        fresh = not (folder / "complete").exists()
        folder.mkdir(mode=0o700, exist_ok=True)
        path = folder / MODULE
        if not path.exists():
            _write_once(path, text + KERNELS)
        with _announced(what) if fresh else contextlib.nullcontext(), _order_kept():
            kernels = _import(path, key)
        if fresh:
            _write_once(folder / "complete", "")
            _prune(base)
    os.utime(folder)
    return kernels


def _write_once(path: Path, text: str) -> None:
    """Let a file appear whole; it is never rewritten."""
    handle, name = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(name, path)


def _import(path: Path, key: str) -> dict[str, Callable[..., Any]]:
    name = f"redundant_envs_compiled_{key}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    module.__dict__["CACHE"] = True
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return {k: getattr(module, k) for k in module.SIGNATURES}


def _compile_in_memory(text: str, what: str) -> dict[str, Callable[..., Any]]:
    module = types.ModuleType("redundant_envs_compiled")
    module.__dict__["CACHE"] = False
    with _announced(what), _order_kept():
        exec(compile(text + KERNELS, "<assembled scene>", "exec"), module.__dict__)
    return {k: getattr(module, k) for k in module.SIGNATURES}


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
        yield


def _prune(base: Path) -> None:
    """Delete the modules not used for longest beyond the number kept."""
    own = re.compile(r"[0-9a-f]{32}")  # never anything else that may lie in a folder of the user's
    folders = [p for p in base.iterdir() if own.fullmatch(p.name) and (p / MODULE).is_file()]
    if len(folders) <= KEPT_MODULES:
        return
    folders.sort(key=lambda p: p.stat().st_mtime)
    for folder in folders[:-KEPT_MODULES]:
        shutil.rmtree(folder, ignore_errors=True)


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
