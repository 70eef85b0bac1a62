"""Cases drawn one after another, for a given time; each failure becomes a small file."""

import sys
import time
import traceback
from collections import Counter

import numpy as np

from . import environments, judging
from .cases import Violation, minimised, write
from .drawing import drawn

NAMES = {judging.FLAGS, *judging.OF_VERIFY, *(one.__name__ for one in environments.PROMISES)}
HARNESS = "the_case_is_played"
"""The name of the failure of a case that could not be judged: an exception outside its calls."""
KEPT = 5
"""Most failures of one invariant that become files."""


def judged(case, tally=None, only=()):
    """The violations of a case; ``only`` those of some promises. ``tally`` counts what was looked at."""
    tally = Counter() if tally is None else tally
    tally["scenes"] += 1
    face = environments if case["face"] == "vector" else judging
    try:
        with np.errstate(all="ignore"):
            return face.violations_of(case, tally, only or NAMES)
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

                def again(case, kind=kind):
                    return next((v for v in judged(case, only=(kind,)) if v.invariant == kind), None)

                small = minimised(case, again)
                files.append(out / f"{kind}-{seed}-{number}.json")
                found = (again(small) or violation).found
                write({"fails": kind, "found": found, **small}, files[-1])
        told = f"fuzz: case {number}, {tally['intervals']} intervals: {', '.join(failures) or 'good'}"
        print(told, file=sys.stderr, flush=True)
    return tally, files
