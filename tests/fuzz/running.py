"""Cases drawn one after another, for a given time; each failure becomes a file.

A case is a mapping with "scene", "num_envs", "threads" and "calls": the first sets the states of its lanes,
the others advance them under efforts; "rows" has a row for each lane.
"""

import json
import sys
import time
import traceback
from collections import Counter

import numpy as np

from .drawing import drawn
from .judging import Violation, violations_of

HARNESS = "the_case_is_played"
"""The name of the failure of a case that could not be judged: an exception outside its calls."""
KEPT = 5
"""Most failures of one invariant that become files."""


def write(case, path):
    """A file with one line for each call, so that it can be read and shortened by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in case.items() if k != "calls"]
    calls = ",\n".join(f"  {json.dumps(c)}" for c in case["calls"])
    path.write_text("{\n" + ",\n".join(lines) + f',\n "calls": [\n{calls}\n ]\n}}\n', encoding="utf-8")


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def judged(case, tally=None, only=()):
    """The violations of a case; ``only`` those of some promises."""
    try:
        with np.errstate(all="ignore"):
            return violations_of(case, Counter() if tally is None else tally, only)
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
                write({"fails": kind, "found": violation.found, **case}, files[-1])
        told = f"fuzz: case {number}, {tally['intervals']} intervals: {', '.join(failures) or 'good'}"
        print(told, file=sys.stderr, flush=True)
    return tally, files
