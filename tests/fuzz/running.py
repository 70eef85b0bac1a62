"""Cases drawn one after another, for a given time; each failure becomes a small file."""

import time
import traceback

from . import cases
from .drawing_calls import drawn
from .invariants import Tally, Violation, violations
from .minimising import minimised

HARNESS = "the_case_is_played"
"""The name of the failure of a case that could not be judged: an exception outside its calls."""
KEPT = 5
"""Most failures of one invariant that become files."""


def judged(case, tally=None):
    """The violations of a case of any kind."""
    try:
        return violations(case, tally=tally)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__} at {place.name}, line {place.lineno}: {error}"
        return [Violation(HARNESS, -1, -1, text)]


def write_failure(case, violation, out, seconds):
    """A file that reproduces a violation, made small in some seconds; 0 writes it as it is."""

    def again(case):
        return next((v for v in judged(case) if v.invariant == violation.invariant), None)

    made = minimised(case, again, seconds) if seconds else case
    path = out / f"{violation.invariant}-{case['seed']}-{case['number']}.json"
    cases.write({"fails": violation.invariant, "found": (again(made) or violation).found, **made}, path)
    return path


def run(seed, numbers, end, out, told, seconds=40.0):
    """Counts, and files of failures in a folder, of cases of a seed until a time of ``time.monotonic``.

    ``told`` receives the number of each case, the counts so far, and the failures. Each of these is made
    small in some seconds.
    """
    tally, files = Tally(), []
    for number in numbers:
        if time.monotonic() > end:
            break
        case = drawn(seed, number)
        failures = {v.invariant: v for v in reversed(judged(case, tally))}
        for kind, violation in failures.items():
            tally.failures[kind] = tally.failures.get(kind, 0) + 1
            if sum(path.name.startswith(f"{kind}-") for path in files) < KEPT:
                files.append(write_failure(case, violation, out, seconds))
        told(number, tally, ", ".join(failures))
    return tally, files
