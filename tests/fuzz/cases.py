"""A case: a scene, and calls of its simulator or environment, as a JSON document that needs no generator.

A case is a mapping with "face" ("simulator" or "vector"), "scene", "num_envs", "threads" and "calls". Each
call is a mapping with "call" and its arguments; those in "rows" are tables with a row for each lane of the
case, of which a call for some "lanes" takes theirs. A call is "refusable", or "refused" if it must be: then a
text is a pattern of the message.
"""

import json
import time
from typing import NamedTuple

SECONDS = 40.0
"""Time after which a case is small enough."""


class Violation(NamedTuple):
    invariant: str
    call: int  # -1: none in particular, as the lane
    lane: int
    found: str


def plain(case):
    """The case as it is read from a file."""
    return json.loads(json.dumps(case, default=lambda array: array.tolist()))


def write(case, path):
    """A file with one line for each call, so that it can be read and shortened by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in case.items() if k != "calls"]
    calls = ",\n".join(f"  {json.dumps(c)}" for c in case["calls"])
    path.write_text("{\n" + ",\n".join(lines) + f',\n "calls": [\n{calls}\n ]\n}}\n', encoding="utf-8")


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def lanes_of(case, call):
    """Lanes that a call is for."""
    lanes = call.get("lanes")
    return list(range(case["num_envs"])) if lanes is None else lanes


def taken(rows, lanes):
    """Rows of some lanes, of tables and of mappings of them."""
    return {k: taken(x, lanes) if isinstance(x, dict) else [x[n] for n in lanes] for k, x in rows.items()}


def with_lanes(case, order):
    """The case with some of its lanes, in any order; calls for none of them are left out."""
    calls = []
    for call in case["calls"]:
        own = set(lanes_of(case, call))
        # A mask has no order: rows are those of ascending lanes.
        if chosen := [place for place, lane in enumerate(order) if lane in own]:
            lanes = None if call.get("lanes") is None else chosen
            calls.append({**call, "lanes": lanes, "rows": taken(call.get("rows", {}), order)})
    return {**case, "num_envs": len(order), "calls": calls}


# ---- small cases -------------------------------------------------------------------------------------


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
    yield from (with_lanes(case, lanes) for lanes in fewer_lanes(case))
    calls, scene, robot = case["calls"], case["scene"], case["scene"]["robot"]
    yield from ({**case, "calls": calls[:k] + calls[k + 1 :]} for k in reversed(range(1, len(calls))))
    effects = scene["effects"]
    changes = [{"effects": effects[:k] + effects[k + 1 :]} for k in range(len(effects))]
    changes += [{"actuation": "joint"}, {"control_dt": 0.02}, {"substeps": 1}]
    changes += [{"robot": {**robot, n: [0.5] * len(robot[n])}} for n in ("masses", "lengths")]
    yield {**case, "threads": 1}
    yield from ({**case, "scene": {**scene, **change}} for change in changes)


def minimised(case, fails):
    """The smallest case found that fails as this one does; a case that cannot be played does not fail."""
    end = time.monotonic() + SECONDS

    def fails_too(made):
        try:
            return time.monotonic() < end and made != case and fails(made)
        except Exception:  # without a lane or an effect a scene or a call may be impossible
            return False

    while found := next(filter(fails_too, smaller(case)), None):
        case = found
    return case
