"""Cases drawn one after another, for a given time; each failure becomes a small file."""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any

from . import cases
from .cases import ENVIRONMENTS, Case
from .drawing_calls import drawn_case
from .drawing_episodes import drawn_episodes
from .invariants import violations
from .invariants_episodes import episode_violations
from .minimising import minimised
from .played import Tally, Violation

HARNESS = "the_case_is_played"
"""The name of the failure of a case that could not be judged: an exception outside its calls."""
TOLD = 10
"""Number of cases between two lines of progress."""
FEW, MANY = 12, 128
"""Most lanes of an environment."""
KEPT = 5
"""Most failures of one invariant that become files."""


def drawn(seed: int, number: int) -> Case:
    """A case of a seed and a number: environments in two of five, one of them with many lanes."""
    if number % 5 in (1, 3):
        return drawn_episodes(seed, number, lanes=FEW if number % 5 == 1 else MANY)
    return drawn_case(seed, number)


def judged(case: Case, tally: Tally | None = None) -> list[Violation]:
    """The violations of a case of any kind."""
    try:
        if case["face"] in ENVIRONMENTS:
            return episode_violations(case, tally=tally)
        return violations(case, tally=tally)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__} at {place.name}, line {place.lineno}: {error}"
        return [Violation(HARNESS, -1, -1, text)]


def small(case: Case, kind: str, seconds: float) -> Case:
    """The case, minimised while it fails in the same way."""
    return minimised(case, lambda c: any(v.invariant == kind for v in judged(c)), seconds)


def case_failures(case: Case, tally: Tally) -> dict[str, Violation]:
    """The first violation of each kind."""
    found: dict[str, Violation] = {}
    for violation in judged(case, tally):
        found.setdefault(violation.invariant, violation)
    for kind in found:
        tally.failures[kind] = tally.failures.get(kind, 0) + 1
    return found


def write_failure(case: Case, kind: str, violation: Violation, out: Path, seconds: float) -> Path:
    """A file that reproduces a violation, made small in some seconds."""
    made = small(case, kind, seconds) if seconds else case
    again = next((v for v in judged(made) if v.invariant == kind), violation)
    path = out / f"{kind}-{case['seed']}-{case['number']}.json"
    cases.write({"fails": kind, "found": again.found, **made}, path)
    return path


def run(
    seed: int, numbers: Iterator[int], end: float, out: Path, told: Callable[[int, Tally, str], Any],
    seconds: float = 40.0,
) -> tuple[Tally, list[Path]]:  # fmt: skip
    """Cases of a seed until a time of ``time.monotonic``.

    Parameters
    ----------
    seed : int
    numbers : iterator of int
        Of the cases.
    end : float
        s.
    out : Path
        Folder of the files of failures.
    told : callable
        Receives the number of the case, the counts so far, and the failure.
    seconds : float
        To make a failure small; 0 writes it as it is.

    Returns
    -------
    (Tally, list of Path)
    """
    tally, files, written = Tally(), [], dict[str, int]()
    for number in numbers:
        if time.monotonic() > end:
            break
        case = drawn(seed, number)
        failures = case_failures(case, tally)
        for kind, violation in failures.items():
            if written.get(kind, 0) >= KEPT:
                continue
            written[kind] = written.get(kind, 0) + 1
            files.append(write_failure(case, kind, violation, out, seconds))
        told(number, tally, ", ".join(failures))
    return tally, files


def worker(seed: int, first: int, stride: int, minutes: float, out: Path) -> tuple[Tally, list[Path]]:
    """The cases first, first + stride, ... of a seed."""
    warnings.simplefilter("ignore", RuntimeWarning)  # NumPy warns of overflows; the cases provoke them
    start, parent = time.monotonic(), os.getppid()

    def told(number: int, tally: Tally, failed: str) -> None:
        if os.getppid() != parent:
            sys.exit("fuzz: who asked for it is gone")
        if failed or tally.scenes % TOLD == 0:
            seconds, counts = time.monotonic() - start, (tally.scenes, tally.intervals, tally.judged)
            text = f"fuzz: {seconds:.0f} of {60 * minutes:.0f} s, case {number}: "
            text += "{} scenes, {} intervals, {} judged".format(*counts)
            print(f"{text}: {failed} failed" if failed else text, file=sys.stderr, flush=True)

    return run(seed, count(first, stride), start + 60.0 * minutes, out, told)


def summary(tally: Tally, seed: int, minutes: float, files: list[Path]) -> dict[str, Any]:
    """Counts of a run as plain data."""
    return {"seed": seed, "minutes": minutes, **asdict(tally), "files": [path.name for path in files]}


def write_summary(data: dict[str, Any], out: Path) -> Path:
    """``summary.json`` in a folder."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "summary.json"
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return path
