"""Long lives of processes: memory that does not grow, threads that neither differ nor hang."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

MEGABYTE = 1e6
LINUX = pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux's /proc"
)
STARTING = 90.0
"""Time for imports and a first compilation, s; a process that takes longer than this and its run hangs."""


def alone(*arguments, seconds=0.0):
    """What a process of its own measures; a TimeoutExpired if it hangs."""
    command = [sys.executable, str(Path(__file__).with_name("alone.py")), *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=STARTING + seconds, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@LINUX
@pytest.mark.parametrize("face", ["vector", "sb3"])
@pytest.mark.parametrize(
    ("lanes", "warm_up", "measured", "most"),
    [(128, 300, 1000, 1.0), pytest.param(1024, 1000, 10_000, 2.0, marks=pytest.mark.long)],
)
def test_memory_does_not_grow_with_episodes(face, lanes, warm_up, measured, most):
    """``measured`` episodes of all environments in all, after ``warm_up``; at most so many megabytes."""
    growth = alone("episodes", face, lanes, warm_up, measured, seconds=30.0)
    assert growth < most * MEGABYTE


@LINUX
@pytest.mark.parametrize(
    ("warm_up", "measured", "windows", "most"),
    [(300, 60, 4, 0.3), pytest.param(1000, 1000, 1, 2.0, marks=pytest.mark.long)],
)
def test_memory_does_not_grow_with_makes(warm_up, measured, windows, most):
    """A cache of data about functions reaches its 256 entries after 300 makes or so: 1 MB."""
    growth = alone("makes", warm_up, measured, windows, seconds=60.0)
    assert growth < most * MEGABYTE


@pytest.mark.parametrize("seconds", [0.5, pytest.param(60.0, marks=pytest.mark.long)])
def test_four_threads_on_two_busy_cores_give_the_same_bits(seconds):
    """A vector environment and a simulator of four threads against those of one; four simulators at once."""
    found = alone("threads", seconds, seconds=seconds)
    for compared, different in found.values():
        assert compared > 2 * seconds
        assert different == 0
