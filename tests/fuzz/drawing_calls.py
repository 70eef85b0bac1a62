"""Cases of the batch simulator: a drawn scene, and calls in any order."""

from __future__ import annotations

from typing import Any

import numpy as np

from redundant_envs.robots.parameters import LARGEST_RATIO
from redundant_envs.scene import Scene

from .cases import Case, plain
from .drawing import Generator, drawn_efforts, drawn_scene, drawn_states

CALLS = ("advance",) * 10 + (
    "set_state", "set_parameters", "refused_parameters", "refused_state", "advance_partly", "save", "restore",
    "copy", "pickle", "npz",
)  # fmt: skip


def case_generator(seed: int, number: int) -> Generator:
    """The generator of a case: it depends only on the two numbers."""
    return np.random.default_rng([seed, number])


def some_lanes(rng: Generator, count: int) -> list[int]:
    """A few lanes in any order."""
    return [int(k) for k in rng.permutation(count)[: rng.integers(1, max(2, count // 2))]]


def drawn_parameters(rng: Generator, scene: Scene, lanes: int) -> tuple[dict[str, Any], list[str]]:
    """New numbers near the scene's own, and the names of those that differ from lane to lane."""
    robot: Any = scene.robot
    values: dict[str, Any] = {}
    for name in ("masses", "lengths"):
        if rng.random() < 0.6:
            own = np.array(getattr(robot, name))
            near = own * rng.uniform(0.7, 1.4, (lanes, len(own)))
            too_far_apart = near.max(axis=1) > LARGEST_RATIO * near.min(axis=1)
            values[name] = np.where(too_far_apart[:, None], own, near).tolist()
    strengths = ("gravity.g", "viscous_friction.coefficients", "effort_limits.limits",
                 "prismatic_stop.restitution")  # fmt: skip
    parameters = scene.parameters()
    for name in strengths:
        own = np.array([v for p, v in parameters.items() if p.split("[")[0] == name])
        if len(own) and rng.random() < 0.6:
            values[name] = (own * rng.uniform(0.3, 1.0, (lanes, len(own)))).tolist()
    return values, list(values)


def drawn_call(rng: Generator, scene: Scene, num_envs: int, kind: str) -> dict[str, Any]:
    """A call with its arguments."""
    robot: Any = scene.robot
    if kind in ("save", "restore", "copy", "pickle", "npz"):
        return {"call": kind}
    if kind in ("advance", "advance_partly"):
        call: dict[str, Any] = {"call": kind, "efforts": drawn_efforts(scene, num_envs, rng)}
        if kind == "advance_partly":
            call["duration"] = scene.control_dt * float(rng.choice([1e-6, 0.3, 1.0, 1.7]))
        return call
    lanes = some_lanes(rng, num_envs)
    if kind == "set_state":
        # Parameters may have moved the stops since: then it is refused.
        q, qd = drawn_states(scene, len(lanes), rng)
        return {"call": kind, "lanes": lanes, "q": q, "qd": qd, "refusable": True}
    if kind == "set_parameters":
        values, of_lanes = drawn_parameters(rng, scene, len(lanes))
        return {"call": kind, "lanes": lanes, "parameters": values, "of_lanes": of_lanes}
    if kind == "refused_state":
        q, qd = drawn_states(scene, len(lanes), rng)
        wrong = [{"q": q[:, :-1]}, {"q": [["1"] * q.shape[1]] * len(lanes), "text": True}][rng.integers(2)]
        return {"call": "set_state", "lanes": lanes, "q": q, "qd": qd, **wrong, "refused": True}
    wrong = [
        {"masses": -1.0}, {"masses": [1.0] * (len(robot.masses) + 1)}, {"lengths": 0.0}, {"unknown": 1.0},
        {"masses": float("nan")}, {"gravity.g": 1e200},
        {"masses": [1e-29, *[1e29] * (len(robot.masses) - 1)]},
    ][rng.integers(7)]  # fmt: skip
    return {"call": "set_parameters", "lanes": lanes, "parameters": wrong, "refused": True}


def drawn_case(seed: int, number: int, lanes: int = 48, calls: int = 6) -> Case:
    """A case of the batch simulator."""
    rng = case_generator(seed, number)
    scene = drawn_scene(rng)
    count = int(rng.choice([1, 7, 8, 9, lanes, lanes, lanes]))
    if scene.integrator == "dop853":  # takes as many steps as it needs, up to seconds for a wild lane
        count, calls = min(count, 9), min(calls, 3)
    q, qd = drawn_states(scene, count, rng)
    made = [{"call": "set_state", "q": q, "qd": qd}]
    made += [drawn_call(rng, scene, count, str(rng.choice(CALLS))) for _ in range(calls)]
    made.append(drawn_call(rng, scene, count, "advance"))
    case: Case = plain(
        {
            "face": "simulator",
            "seed": seed,
            "number": number,
            "scene": scene.to_dict(),
            "num_envs": count,
            "threads": int(rng.choice([1, 1, 2])),
            "calls": made,
        }
    )
    return case
