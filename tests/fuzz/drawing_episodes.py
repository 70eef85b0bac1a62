"""Cases of the environments: a random scene with motors, a kind of environment, and calls in any order."""

from __future__ import annotations

from typing import Any

import numpy as np

from redundant_envs.scene import Scene

from .cases import ENVIRONMENTS, Case, plain
from .drawing import MOTORS, TRIES, Generator, drawn_scene, drawn_state
from .drawing_calls import case_generator, drawn_parameters, some_lanes

LIMIT = 7
"""Control steps of an episode, in most cases: few, so that episodes end often."""
ACTIONS = ("plain", "bang-bang", "bang-bang", "none", "too large")
BAD_ACTIONS = ("nan", "inf", "1e300", "denormal")
CALLS = ("step",) * 14 + (
    "reset", "reset", "partial_reset", "reset_with", "save", "restore", "copy", "pickle", "bad_step",
    "refused_reset", "refused_step", "observe",
)  # fmt: skip
AUTORESETS = ("next_step", "same_step", "disabled")


def limited_scene(rng: Generator) -> Scene:
    """A scene that an environment accepts: motors, joint efforts, sliders of limited travel."""
    for _ in range(TRIES):
        scene = drawn_scene(rng, (MOTORS,), "joint", calm=bool(rng.random() < 0.6))
        sliders = scene.robot.sliders()
        if all(k in scene.travel() for k in sliders) and any(
            type(e).__name__ == MOTORS for e in scene.effects
        ):
            return scene
    raise AssertionError("no drawn scene has limited travel")


def drawn_actions(rng: Generator, count: int, joints: int, kinds: tuple[str, ...] = ACTIONS) -> Any:
    """Actions, (count, joints): inside [-1, 1], at its ends, and beyond."""
    rows = rng.uniform(-1.0, 1.0, (count, joints))
    for k in range(count):
        kind = str(rng.choice(kinds))
        if kind == "bang-bang":
            rows[k] = np.sign(rows[k])
        elif kind == "none":
            rows[k] = 0.0
        elif kind == "too large":
            rows[k] *= 5.0
        elif kind != "plain":
            wild = {"nan": np.nan, "inf": -np.inf, "1e300": 1e300, "denormal": 5e-324}[kind]
            rows[k, rng.integers(joints)] = wild
    return rows.astype(np.float32) if "1e300" not in kinds else rows


def drawn_options(rng: Generator, scene: Scene, lanes: int, goal: bool) -> dict[str, Any]:
    """Options of a reset: positions, velocities and parameters; some are refused."""
    options: dict[str, Any] = {}
    robot: Any = scene.robot
    if rng.random() < 0.6:
        kinds = ("plain", "folded", "at rest", "at stop", "near stop", "denormal")
        states = [drawn_state(scene, str(rng.choice(kinds)), rng) for _ in range(lanes)]
        options["q"] = np.array([q for q, _ in states])
        options["qd"] = np.array([qd for _, qd in states])
    if rng.random() < 0.3:
        fast = ("fast", "huge", "overflowing")
        states = [drawn_state(scene, str(rng.choice(fast)), rng) for _ in range(lanes)]
        options["qd"] = np.clip([qd for _, qd in states], -1e100, 1e100)
    if rng.random() < 0.4:
        options["parameters"], _ = drawn_parameters(rng, scene, lanes)
        if goal:
            options["parameters"].pop("lengths", None)
    if rng.random() < 0.3:
        options["goal"] = rng.uniform(-0.4, 0.4, (lanes, 2)) * min(robot.lengths)
    return options


def drawn_call(rng: Generator, case: Case, scene: Scene, kind: str) -> dict[str, Any]:
    count, joints = case["num_envs"], len(scene.robot.joints)
    if kind in ("save", "restore", "copy", "pickle", "observe"):
        return {"call": kind}
    if kind == "step":
        return {"call": kind, "actions": drawn_actions(rng, count, joints)}
    if kind == "bad_step":
        actions = drawn_actions(rng, count, joints, (*ACTIONS, *BAD_ACTIONS))
        return {"call": "step", "actions": actions, "float64": True, "refusable": True}
    if kind == "refused_step":
        wrong = [[[0.0] * (joints + 1)] * count, [["0"] * joints] * count][rng.integers(2)]
        return {"call": "step", "actions": wrong, "text": isinstance(wrong[0][0], str), "refused": True}
    if kind == "refused_reset":
        wrong = [{"q": [[0.0]] * count}, {"unknown": 1.0}, {"parameters": {"masses": -1.0}},
                 {"parameters": 3.0}, {"goal": [[1e9, 0.0]] * count}][rng.integers(5)]  # fmt: skip
        return {"call": "reset", "options": wrong, "refused": True}
    seed = int(rng.integers(2**31)) if rng.random() < 0.5 else None
    call: dict[str, Any] = {
        "call": "reset",
        "seed": None if seed is None else [seed + k for k in range(count)],
    }
    if kind == "partial_reset" and case["face"] == "vector":
        call["lanes"] = sorted(some_lanes(rng, count))
        call["seed"] = call["seed"] and [call["seed"][k] for k in call["lanes"]]
    if kind == "reset_with" or rng.random() < 0.2:
        lanes = len(call.get("lanes", range(count)))
        options = drawn_options(rng, scene, lanes, case["goal"])
        call |= {"options": options, "refusable": True}
        call["of_lanes"] = [n for n in options if n != "parameters"]
    return call


def drawn_episodes(seed: int, number: int, lanes: int, calls: int = 30) -> Case:
    """A case of an environment."""
    rng = case_generator(seed, number)
    scene = limited_scene(rng)
    face = str(rng.choice(ENVIRONMENTS))
    count = 1 if face == "env" else int(rng.choice([2, 8, 9, lanes]))
    if scene.integrator == "dop853":  # takes as many steps as it needs, a tenth of a second for a wild lane
        count, calls = min(count, 2), min(calls, 8)
    case: Case = {
        "face": face, "seed": seed, "number": number, "goal": bool(rng.random() < 0.35),
        "scene": scene.to_dict(), "num_envs": count,
        "threads": 1 if face == "env" else int(rng.choice([1, 1, 2])),
        "autoreset_mode": str(rng.choice(AUTORESETS)),
        "on_bad_action": str(rng.choice(["raise", "terminate", "terminate"])),
        "max_episode_steps": int(rng.choice([1, LIMIT, LIMIT, 100])),
        "task": {"speed_bound": float(rng.choice([50.0, 50.0, 5.0]))},
    }  # fmt: skip
    if case["autoreset_mode"] == "disabled" and face == "vector":
        case["max_episode_steps"] = 100  # or most steps are refused, as other lanes wait for a reset
    first: list[dict[str, Any]] = []
    if rng.random() < 0.2:
        first = [{"call": "step", "actions": drawn_actions(rng, count, len(scene.robot.joints)),
                  "refused": True}]  # fmt: skip
    first.append({"call": "reset", "seed": [int(rng.integers(2**20)) + k for k in range(count)]})
    waits = face == "env" or (face == "vector" and case["autoreset_mode"] == "disabled")
    usual = (*CALLS, *("reset",) * 5) if waits else CALLS  # else most steps come after an end
    first += [drawn_call(rng, case, scene, str(rng.choice(usual))) for _ in range(calls)]
    made: Case = plain({**case, "calls": first})
    return made
