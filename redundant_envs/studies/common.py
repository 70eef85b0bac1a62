"""Common parts of studies: machine and versions of a figure, one core, tables."""

from __future__ import annotations

import contextlib
import csv
import datetime
import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.files import scene_folder

MATRIX = 1024


def study_path(name: str) -> Path:
    """The file of a named study: package data in a wheel, configs/studies in a checkout."""
    return scene_folder().parent / "studies" / f"{name}.yaml"


def dgemm_rate(repeats: int = 4, size: int = MATRIX) -> float:
    """Best rate of a product of two square matrices, 1e9 floating point operations per second."""
    a = np.random.default_rng(0).standard_normal((size, size))
    out = np.empty_like(a)
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        np.matmul(a, a, out=out)
        best = min(best, time.perf_counter() - start)
    return 2.0 * size**3 / best / 1e9


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep the calling thread on one core and BLAS in the calling thread, as far as possible."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with contextlib.ExitStack() as stack:
        try:
            from threadpoolctl import threadpool_limits
        except ImportError:
            if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
                print(
                    "threadpoolctl is not installed: set OPENBLAS_NUM_THREADS=1 for the rate of one core",
                    file=sys.stderr,
                )
        else:
            stack.enter_context(threadpool_limits(limits=1, user_api="blas"))
        if allowed is not None:
            os.sched_setaffinity(0, {min(allowed)})
            stack.callback(os.sched_setaffinity, 0, allowed)
        yield


def machine_name() -> str:
    """Model of the processor."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def commit() -> str:
    """Short commit of the running checkout, with "-dirty" if it is changed; empty for an installed
    package."""
    root = scene_folder().parents[1]
    if not (root / ".git").exists():
        return ""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return ""


def versions() -> dict[str, str]:
    """Machine, date and versions with which a figure was measured."""
    return {
        "machine": machine_name(),
        "date": datetime.date.today().isoformat(),
        "python": platform.python_version(),
        "llvmlite": importlib.metadata.version("llvmlite"),
        "numpy": np.__version__,
        "commit": commit(),
    }


def write_rows(rows: Sequence[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write rows as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Rows as text in aligned columns."""
    lines = [list(columns), *([str(row[c]) for c in columns] for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns))]
    padded = (" ".join(f"{c:>{w}}" for c, w in zip(line, widths, strict=True)) for line in lines)
    return "\n".join(padded)
