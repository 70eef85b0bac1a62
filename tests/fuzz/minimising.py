"""Minimising a failing case: fewer lanes, calls, effects and digits, while the same promise is broken."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator
from typing import Any

from .cases import ENVIRONMENTS, Case, without_calls
from .cases import with_lanes as lanes_of_calls
from .invariants_episodes import of_lanes

Fails = Callable[[Case], bool]
SECONDS = 60.0
"""Time after which a case is small enough."""


def with_lanes(case: Case, order: list[int]) -> Case:
    """The case with some lanes, including the options of resets."""
    return of_lanes(case, order) if case["face"] in ENVIRONMENTS else lanes_of_calls(case, order)


def fewer_lanes(case: Case) -> Iterator[Case]:
    """Halves, quarters, ... of the lanes, and all but one of few."""
    count, size = case["num_envs"], case["num_envs"] // 2
    while size >= 1:
        for first in range(0, count, size):
            part = list(range(first, min(first + size, count)))
            yield with_lanes(case, part)
            if size < count // 2 or size == 1:
                yield with_lanes(case, [lane for lane in range(count) if lane not in part])
        size //= 2


def fewer_calls(case: Case) -> Iterator[Case]:
    """Without the second half, and without each call, from the last on; the first begins the motion."""
    count = len(case["calls"])
    if count > 3:
        yield without_calls(case, list(range(count // 2 + 1, count)))
    for k in reversed(range(1, count)):
        yield without_calls(case, [k])


def fewer_effects(case: Case) -> Iterator[Case]:
    effects = case["scene"]["effects"]
    for k in range(len(effects)):
        scene = {**case["scene"], "effects": effects[:k] + effects[k + 1 :]}
        yield {**copy.deepcopy(case), "scene": scene}


def plainer(case: Case) -> Iterator[Case]:
    """One thread, joint actuation, a usual control interval."""
    for name, value in (("threads", 1),):
        if case.get(name, value) != value:
            yield {**copy.deepcopy(case), name: value}
    for name, value in (("actuation", "joint"), ("control_dt", 0.02), ("substeps", 1)):
        if case["scene"].get(name, value) != value:
            yield {**copy.deepcopy(case), "scene": {**case["scene"], name: value}}
    for name in ("masses", "lengths"):
        own = case["scene"]["robot"].get(name, [])
        rounded = [float(f"{x:.1g}") for x in own]
        for new in ([0.5] * len(own), rounded):
            if own != new:
                made = copy.deepcopy(case)
                made["scene"]["robot"][name] = new
                yield made


def fewer_digits(case: Case) -> Iterator[Case]:
    """Numbers of all calls with two digits, and zeros, one table after another."""
    for k, call in enumerate(case["calls"]):
        for name in ("q", "qd", "efforts", "actions"):
            table = call.get(name)
            if not isinstance(table, list) or call.get("refused"):
                continue
            zeros = [[0.0] * len(row) for row in table if isinstance(row, list)]
            short = [[_short(x) for x in row] for row in table if isinstance(row, list)]
            for new in (zeros, short):
                if len(new) == len(table) and new != table:
                    made = copy.deepcopy(case)
                    made["calls"][k][name] = new
                    yield made


def _short(value: Any) -> Any:
    return float(f"{value:.2g}") if isinstance(value, float) else value


WAYS = (fewer_lanes, fewer_calls, fewer_effects, plainer, fewer_digits)


def minimised(case: Case, fails: Fails, seconds: float = SECONDS) -> Case:
    """The smallest case found that fails as this one does; a case that cannot be played does not fail."""
    end, again = time.monotonic() + seconds, True
    while again:
        again = False
        for way in WAYS:
            smaller = True
            while smaller and time.monotonic() < end:
                smaller = False
                for candidate in way(case):
                    if time.monotonic() > end:
                        return case
                    if candidate != case and _fails(candidate, fails):
                        case, smaller, again = candidate, True, True
                        break
    return case


def _fails(candidate: Case, fails: Fails) -> bool:
    try:
        return fails(candidate)
    except Exception:  # without a lane or an effect a scene or a call may be impossible
        return False
