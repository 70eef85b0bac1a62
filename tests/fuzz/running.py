"""Cases drawn one after another, for a given time; each failure becomes a file."""

import sys
import time
import traceback
from collections import Counter

from . import cases
from .cases import Violation
from .drawing import drawn
from .invariants import violations

HARNESS = "the_case_is_played"
"""The name of the failure of a case that could not be judged: an exception outside its calls."""
KEPT = 5
"""Most failures of one invariant that become files."""


def judged(case, tally=None, only=()):
    """The violations of a case of any kind; ``only`` those of some promises."""
    try:
        return violations(case, tally, only)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__} at {place.name}, line {place.lineno}: {error}"
        return [Violation(HARNESS, -1, -1, text)]


def run(seed, numbers, end, out, only=()):
    """Counts, and files of failures in a folder, of cases of a seed until a time of ``time.monotonic``."""
    tally, files = Counter(), []
    for number in numbers:
        if time.monotonic() > end:
            break
        case = drawn(seed, number)
        failures = {v.invariant: v for v in reversed(judged(case, tally, only))}
        for kind, violation in failures.items():
            tally[f"{kind} failed"] += 1
            if tally[f"{kind} failed"] <= KEPT:
                files.append(out / f"{kind}-{seed}-{number}.json")
                cases.write({"fails": kind, "found": violation.found, **case}, files[-1])
        told = f"fuzz: case {number}, {tally['intervals']} intervals: {', '.join(failures) or 'good'}"
        print(told, file=sys.stderr, flush=True)
    return tally, files
