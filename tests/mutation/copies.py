"""Tests that run in copies of the repository, in which code may be changed."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

from redundant_envs.support.progress import counted

ROOT = Path(__file__).parents[2]
KERNELS = os.environ.get("REDUNDANT_ENVS_CACHE") or str(ROOT / ".pytest_cache" / "kernels")
T = TypeVar("T")
SECONDS = 1800.0
"""For a run of tests."""
MEMORY = 8 * 2**30
"""Bytes of address space for a run of tests: some changes let programs grow without end."""
ALL = "long or not (long)"
"""Selects all tests; with a selection they compile with little effort (``tests/conftest.py``)."""


class Outcome(NamedTuple):
    """How a run of tests ended."""

    result: str  # green, red, hung or not run
    failed: str = ""  # the test that failed


def outcome(
    tests: Sequence[str], copy: Path, kernels: str = KERNELS, mark: str = ALL, seconds: float = SECONDS
) -> Outcome:
    """The outcome of tests in a copy of the tree, up to the first that fails."""
    paths = {"PYTHONPATH": f"{copy}{os.pathsep}{copy / 'agents'}", "REDUNDANT_ENVS_CACHE": kernels}
    options = ["-B", "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider"]
    command = [sys.executable, *options, "-m", mark, *tests]
    with subprocess.Popen(
        command, cwd=copy, env=os.environ | paths, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
    ) as run:  # fmt: skip
        try:
            told, _ = run.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)  # with the processes that its tests started
            return Outcome("hung")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", told, re.MULTILINE)
    return Outcome({0: "green", 1: "red"}.get(run.returncode, "not run"), failed[1] if failed else "")


def in_copies(what: str, items: Sequence[T], workers: int, do: Callable[[T, Path], str]) -> None:
    """Do something with each item in a copy of the tree, one for each worker, and tell what it returns."""
    with tempfile.TemporaryDirectory() as folder, counted(what, len(items)) as told:

        def work(worker: int) -> None:
            copy = Path(folder, str(worker))
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
            for item in items[worker::workers]:
                told(do(item, copy))

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(work, range(workers)))
