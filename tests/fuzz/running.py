"""Cases drawn one after another, for a given time; each failure becomes a small file."""

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
SECONDS = 40.0
"""Time after which a case is small enough."""


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

                def again(case, kind=kind):
                    return next((v for v in judged(case, only=(kind,)) if v.invariant == kind), None)

                small = minimised(case, again)
                files.append(out / f"{kind}-{seed}-{number}.json")
                found = (again(small) or violation).found
                cases.write({"fails": kind, "found": found, **small}, files[-1])
        told = f"fuzz: case {number}, {tally['intervals']} intervals: {', '.join(failures) or 'good'}"
        print(told, file=sys.stderr, flush=True)
    return tally, files


# ---- small cases ----------------------------------------------------------------------------------------


def fewer_lanes(case):
    """Halves, quarters, ... of the lanes, and all but one of them."""
    every, size = list(range(case["num_envs"])), case["num_envs"] // 2
    while size >= 1:
        for first in every[::size]:
            part = every[first : first + size]
            yield part
            yield [k for k in every if k not in part]
        size //= 2


def smaller(case):
    """With fewer lanes, calls (the first begins the motion) and effects, and with plain numbers."""
    yield from (cases.with_lanes(case, lanes) for lanes in fewer_lanes(case))
    yield from (cases.without_calls(case, [k]) for k in reversed(range(1, len(case["calls"]))))
    scene, robot = case["scene"], case["scene"]["robot"]
    effects = scene["effects"]
    changes = [{"effects": effects[:k] + effects[k + 1 :]} for k in range(len(effects))]
    changes += [{"actuation": "joint"}, {"control_dt": 0.02}, {"substeps": 1}]
    changes += [{"robot": {**robot, n: [0.5] * len(robot[n])}} for n in ("masses", "lengths")]
    yield {**case, "threads": 1}
    yield from ({**case, "scene": {**scene, **change}} for change in changes)


def minimised(case, fails, seconds=SECONDS):
    """The smallest case found that fails as this one does; a case that cannot be played does not fail."""
    end = time.monotonic() + seconds

    def fails_too(made):
        try:
            return time.monotonic() < end and made != case and fails(made)
        except Exception:  # without a lane or an effect a scene or a call may be impossible
            return False

    while found := next(filter(fails_too, smaller(case)), None):
        case = found
    return case
