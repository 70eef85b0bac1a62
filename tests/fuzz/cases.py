"""A case: a scene, and calls of its simulator or environment, as a JSON document that needs no generator.

A case is a mapping with "face" ("simulator" or one of :data:`ENVIRONMENTS`), "scene", "num_envs" and "calls".
Each call is a mapping with "call", its arguments, and "refusable": whether it may be refused. What differs
from lane to lane has a row for each lane of "lanes", or of all lanes where that is None.
"""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Case = dict[str, Any]
Array = NDArray[np.float64]

ENVIRONMENTS = ("env", "vector", "sb3")
ROWS = ("q", "qd", "efforts", "actions", "goal", "seed")
"""Arguments with a row for each lane that a call is for."""


def plain(value: Any) -> Any:
    """Numbers in the form of JSON; those that are not finite become texts."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def numbers(value: Any) -> Array:
    """An array from the result of :func:`plain`."""
    return np.array(value, dtype=object).astype(np.float64)


def write(case: Case, path: Path) -> None:
    """A file with one line for each call, so that it can be read and shortened by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = {k: v for k, v in case.items() if k != "calls"}
    lines = [f" {json.dumps(k)}: {json.dumps(plain(v))}" for k, v in head.items()]
    calls = ",\n".join(f"  {json.dumps(plain(c))}" for c in case["calls"])
    path.write_text("{\n" + ",\n".join(lines) + f',\n "calls": [\n{calls}\n ]\n}}\n', encoding="utf-8")


def read(path: Path) -> Case:
    found: Case = json.loads(path.read_text(encoding="utf-8"))
    return found


def lanes_of(case: Case, call: dict[str, Any]) -> list[int]:
    """Lanes that a call is for."""
    lanes = call.get("lanes")
    return list(range(case["num_envs"])) if lanes is None else list(lanes)


def with_lanes(case: Case, order: list[int]) -> Case:
    """The case with some of its lanes, in any order; calls for none of them are left out."""
    place = {lane: k for k, lane in enumerate(order)}
    made = {**copy.deepcopy(case), "num_envs": len(order), "calls": []}
    for call in case["calls"]:
        own = lanes_of(case, call)
        kept = [lane for lane in order if lane in own]
        if not kept:
            continue
        rows = [own.index(lane) for lane in kept]
        new = copy.deepcopy(call)
        for name in ROWS:
            if new.get(name) is not None:
                new[name] = [call[name][k] for k in rows]
        for name, value in (new.get("parameters") or {}).items():
            if isinstance(value, list) and len(value) == len(own) and name in call.get("of_lanes", ()):
                new["parameters"][name] = [value[k] for k in rows]
        if call.get("lanes") is not None:
            new["lanes"] = [place[lane] for lane in kept]
        made["calls"].append(new)
    return made


def without_calls(case: Case, left_out: list[int]) -> Case:
    """The case without some of its calls."""
    calls = [c for k, c in enumerate(case["calls"]) if k not in left_out]
    return {**case, "calls": copy.deepcopy(calls)}
