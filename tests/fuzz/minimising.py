"""Minimising a failing case: fewer lanes, calls, effects and digits, while the same promise is broken."""

import copy
import time

from .cases import with_lanes, without_calls

SECONDS = 60.0
"""Time after which a case is small enough."""


def fewer_lanes(case):
    """Halves, quarters, ... of the lanes, and all but one of few."""
    count, size = case["num_envs"], case["num_envs"] // 2
    while size >= 1:
        for first in range(0, count, size):
            part = list(range(first, min(first + size, count)))
            yield with_lanes(case, part)
            if size < count // 2 or size == 1:
                yield with_lanes(case, [lane for lane in range(count) if lane not in part])
        size //= 2


def fewer_calls(case):
    """Without the second half, and without each call, from the last on; the first begins the motion."""
    count = len(case["calls"])
    if count > 3:
        yield without_calls(case, list(range(count // 2 + 1, count)))
    for k in reversed(range(1, count)):
        yield without_calls(case, [k])


def plainer(case):
    """Without an effect; one thread, joint actuation, a usual control interval, round masses and lengths."""
    scene, robot = case["scene"], case["scene"]["robot"]
    for k in range(len(scene["effects"])):
        yield {**case, "scene": {**scene, "effects": scene["effects"][:k] + scene["effects"][k + 1 :]}}
    yield {**case, "threads": 1}
    for name, value in (("actuation", "joint"), ("control_dt", 0.02), ("substeps", 1)):
        yield {**case, "scene": {**scene, name: value}}
    for name in ("masses", "lengths"):
        for new in ([0.5] * len(robot[name]), [float(f"{x:.1g}") for x in robot[name]]):
            yield {**case, "scene": {**scene, "robot": {**robot, name: new}}}


def fewer_digits(case):
    """Zeros, and numbers with two digits, one table after another."""
    for k, call in enumerate(case["calls"]):
        for name in ("q", "qd", "efforts", "actions"):
            table = [] if call.get("refused") else call.get(name, [])
            for short in (lambda _: 0.0, lambda x: float(f"{x:.2g}") if isinstance(x, float) else x):
                made = copy.deepcopy(case)
                made["calls"][k] = {**call, name: [[short(x) for x in row] for row in table]}
                if table:
                    yield made


def minimised(case, fails, seconds=SECONDS):
    """The smallest case found that fails as this one does; a case that cannot be played does not fail."""
    end, found = time.monotonic() + seconds, True
    while found:
        found = None
        for way in (fewer_lanes, fewer_calls, plainer, fewer_digits):
            smaller = case
            while smaller is not None and time.monotonic() < end:
                case, found = smaller, found or smaller is not case
                smaller = next((c for c in way(case) if c != case and fails_too(c, fails, end)), None)
    return case


def fails_too(case, fails, end):
    try:
        return time.monotonic() < end and fails(case)
    except Exception:  # without a lane or an effect a scene or a call may be impossible
        return False
