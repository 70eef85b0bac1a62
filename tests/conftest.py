"""Kernels compiled by the tests live in the checkout's own pytest cache, kept between runs."""

import gc
import os
import signal
from collections import defaultdict
from pathlib import Path

import pytest

from redundant_envs.compiler.backends import llvm

FOLDER = Path(__file__).parents[1] / ".pytest_cache" / "kernels"
os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(FOLDER))
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
for library in ("OMP", "OPENBLAS", "MKL"):  # sums of torch and NumPy depend on their number of threads
    os.environ[f"{library}_NUM_THREADS"] = "1"
for variable in ("FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "COLUMNS", "LINES"):
    os.environ.pop(variable, None)  # rich and argparse would write otherwise than without a terminal
os.environ.pop("MPLBACKEND", None)  # of a notebook, whose back end may not be here

LONG_FILE = "\npytestmark = pytest.mark.long\n"
COLLECTION_THRESHOLDS = 50_000, 20, 100
"""Allocations until a collection of the youngest objects, and collections of one generation until one of the
next. Kept simulators are millions of objects and no garbage: with Python's own thresholds, looking at them
again and again took 14 % of the processor time of 1900 tests, with these 10 % of that of 346 others."""
AS_USERS_GET_IT = {"backends", "exports", "tracing", "web"}
"""Folders whose tests are about code as users get it. Elsewhere tests compile many scenes and compute little
with each: with its least effort LLVM makes their code in a third of the time. No bit depends on that
(``backends/test_processors.py``). ``make test-long`` without MARK has the code of users everywhere."""


def pytest_ignore_collect(collection_path, config):
    """``make test`` does not import files of long tests: together they import most of what there is."""
    if collection_path.suffix == ".py" and "not long" in config.getoption("markexpr"):
        return LONG_FILE in collection_path.read_text(encoding="utf-8") or None
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """``@pytest.mark.quick("row", ...)`` names the rows of a test that ``make test`` runs."""
    rows = defaultdict(set)
    for item in items:
        for mark in item.iter_markers("quick"):
            rows[item.parent, item.originalname, mark.args].add(item.callspec.id)
            if item.callspec.id not in mark.args:
                item.add_marker("long")
    for (parent, name, quick), found in rows.items():
        if missing := {*quick} - found and len(found) > 1:
            raise pytest.UsageError(f"{parent.nodeid}::{name} has no rows {missing}")


FULL = llvm.EFFORT
USUAL = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL, "SIGHUP": signal.SIG_DFL}


def pytest_configure(config):
    if config.getoption("markexpr"):
        llvm.EFFORT = 0
    # tests interrupt themselves, and signals may be ignored, as in the background of a script or under nohup
    for name, handler in USUAL.items():
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


@pytest.fixture(autouse=True, scope="module")
def code_of_users(request):
    """LLVM's full effort for the tests of some folders."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in AS_USERS_GET_IT:
            patch.setattr(llvm, "EFFORT", FULL)
        yield


def pytest_collection_finish():
    """What was imported and collected stays to the end: garbage collection need not look at it."""
    gc.freeze()
    gc.set_threshold(*COLLECTION_THRESHOLDS)


def pytest_sessionfinish():
    """pytest looks for garbage five times at its end, for what its destruction raises; once is enough."""
    gc.collect()
    gc.freeze()
