"""Number of runs: their seeds, and the number at a time."""

from __future__ import annotations

import os
import re

from ..config import MOST_SEEDS

MOST_PROCESSES = 1024


def seeds_of(text: str) -> list[int]:
    """Seeds as a user writes them: ``0..9``, or ``1,4,7``, or both."""
    seeds: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,4})(?:\.\.(\d{1,4}))?\s*", part)
        if not match:
            raise ValueError(
                f"seeds is {text[:80]!r}; write such as 0..9 or 1,4,7, with seeds from 0 to {MOST_SEEDS}"
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ValueError(f"seeds is {text[:80]!r}; write the lower one first, {last}..{first}")
        seeds += range(first, last + 1)
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds is {text[:80]!r}; give different seeds from 0 to {MOST_SEEDS}")
    return seeds


def cores() -> list[int]:
    """Cores that this process may use; empty if the system does not report them."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def count_of(processes: int | None) -> int:
    """Runs at a time on this machine: ``processes``, or one for each core."""
    count = (len(cores()) or os.cpu_count() or 1) if processes is None else processes
    if not 1 <= count <= MOST_PROCESSES:
        raise ValueError(f"processes is {count}; give a whole number from 1 to {MOST_PROCESSES}")
    return count
