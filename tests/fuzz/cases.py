"""A case: a scene, and calls of its simulator or environment, as a JSON document that needs no generator.

A case is a mapping with "face" ("simulator" or "vector"), "scene", "num_envs" and "calls".
Each call is a mapping with "call", its arguments, and "refusable" if it may be refused, or "refused" if it
must be: then a text is a pattern of the message. Arguments in "rows" are tables with a row for each lane of
the case; a call for some "lanes" takes their rows.
"""

import json
from typing import NamedTuple


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
    """The case with some of its lanes, in any order and each as often as it is there; calls for none of them
    are left out."""
    calls, places = [], {}
    for place, lane in enumerate(order):
        places.setdefault(lane, []).append(place)
    for call in case["calls"]:
        # A mask has no order: rows are those of ascending lanes.
        if chosen := sorted(place for lane in lanes_of(case, call) for place in places.get(lane, ())):
            lanes = None if call.get("lanes") is None else chosen
            calls.append({**call, "lanes": lanes, "rows": taken(call.get("rows", {}), order)})
    return {**case, "num_envs": len(order), "calls": calls}


def without_calls(case, left_out):
    """The case without some of its calls."""
    return {**case, "calls": [c for k, c in enumerate(case["calls"]) if k not in left_out]}
