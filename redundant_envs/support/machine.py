"""Machine and versions with which a figure was measured."""

import contextlib
import datetime
import importlib.metadata
import platform
import subprocess
from pathlib import Path

import numpy as np


def machine_name() -> str:
    """Model of the processor."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def commit() -> str:
    """Short commit of the running checkout, with "-dirty" if it is changed; "" for an installed package."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return ""


def versions() -> dict[str, str]:
    """Machine, date and versions, as columns of a table."""
    return {
        "machine": machine_name(),
        "date": datetime.date.today().isoformat(),
        "python": platform.python_version(),
        "llvmlite": importlib.metadata.version("llvmlite"),
        "numpy": np.__version__,
        "commit": commit(),
    }
