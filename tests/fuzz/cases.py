"""A case: a scene, and calls of its simulator or environment, as a JSON document that needs no generator.

A case is a mapping with "face" ("simulator" or one of :data:`ENVIRONMENTS`), "scene", "num_envs" and "calls".
Each call is a mapping with "call", its arguments, and "refusable" if it may be refused, or "refused" if it
must be: then a text is a pattern of the message. What differs from lane to lane has a row for each lane of
"lanes", or of all lanes where that is None; "of_lanes": parameters and options do, too.
"""

import copy
import json
import math

import numpy as np

ENVIRONMENTS = ("env", "vector", "sb3")
ROWS = ("q", "qd", "efforts", "actions", "goal", "seed")
"""Arguments with a row for each lane that a call is for."""


def plain(value):
    """Numbers in the form of JSON; those that are not finite become texts."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def numbers(value):
    """An array from the result of :func:`plain`."""
    return np.array(value, dtype=object).astype(np.float64)


def write(case, path):
    """A file with one line for each call, so that it can be read and shortened by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f" {json.dumps(k)}: {json.dumps(plain(v))}" for k, v in case.items() if k != "calls"]
    calls = ",\n".join(f"  {json.dumps(plain(c))}" for c in case["calls"])
    path.write_text("{\n" + ",\n".join(lines) + f',\n "calls": [\n{calls}\n ]\n}}\n', encoding="utf-8")


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def lanes_of(case, call):
    """Lanes that a call is for."""
    lanes = call.get("lanes")
    return list(range(case["num_envs"])) if lanes is None else list(lanes)


def with_lanes(case, order):
    """The case with some of its lanes, in any order; calls for none of them are left out."""
    made = {**copy.deepcopy(case), "num_envs": len(order), "calls": []}
    for call in copy.deepcopy(case["calls"]):
        own = lanes_of(case, call)
        kept = [lane for lane in order if lane in own]
        rows = [own.index(lane) for lane in kept]
        of_lanes = "of_lanes" in call
        options = call.get("options") or {} if of_lanes else {}
        tables = [*(of_lanes * [call.get("parameters")]), options, options.get("parameters")]
        for table, names in ((call, ROWS), *((t, t) for t in tables if t)):
            for name in names:
                if isinstance(table.get(name), list):
                    table[name] = [table[name][k] for k in rows]
        if call.get("lanes") is not None:
            call["lanes"] = [order.index(lane) for lane in kept]
        if kept:
            made["calls"].append(call)
    return made


def without_calls(case, left_out):
    """The case without some of its calls."""
    calls = [c for k, c in enumerate(case["calls"]) if k not in left_out]
    return {**case, "calls": copy.deepcopy(calls)}
