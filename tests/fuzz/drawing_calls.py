"""Cases: a drawn scene, a simulator or a kind of environment, and calls in any order."""

import numpy as np

from redundant_envs.robots.parameters import LARGEST_RATIO
from studies.drawing import TRIES, drawn_efforts, drawn_state, drawn_states

from .cases import plain
from .drawing_scenes import (
    EFFORTS,
    MOTORS,
    RARE_EFFORTS,
    RARE_STATES,
    STATES,
    drawn_actions,
    drawn_kinds,
    drawn_scene,
)

LANES, FEW, MANY = 48, 12, 128
"""Most lanes of a simulator and of environments."""
LIMIT = 7
"""Control steps of an episode, in most cases: few, so that episodes end often."""
CALLS_OF_ENVIRONMENTS = ("step",) * 14 + (
    "reset", "reset", "partial_reset", "reset_with", "save", "restore", "copy", "pickle", "bad_step",
    "refused_reset", "refused_step",
)  # fmt: skip
PLAIN = ("save", "restore", "copy", "pickle", "anew")
"""Calls without arguments."""
AUTORESETS = ("next_step", "same_step", "disabled")


def drawn(seed, number, scene=None, calls=None, **fixed):
    """A case of a seed and a number: environments in two of five, one of them with many lanes.

    A scene and entries of the case may be given.
    """
    rng = np.random.default_rng([seed, number])
    face = fixed.get("face", "environment" if number % 5 in (1, 3) else "simulator")
    made = {"seed": seed, "number": number, "threads": int(rng.choice([1, 1, 2]))}
    if face == "simulator":
        scene = scene or drawn_scene(rng)
        made |= {"face": face, "num_envs": rng.choice([1, 7, 8, 9, LANES, LANES, LANES])} | fixed
        of_case, calls = calls_of_simulator, calls or 6
    else:
        scene = scene or limited_scene(rng)
        made |= drawn_environment(rng, FEW if number % 5 == 1 else MANY) | fixed
        of_case, calls = calls_of_environment, calls or 30
    if scene.integrator == "dop853":  # takes as many steps as it needs, up to seconds for a wild lane
        made["num_envs"], calls = min(made["num_envs"], 2 if face != "simulator" else 9), max(3, calls // 4)
    return plain({**made, "scene": scene.to_dict(), "calls": of_case(rng, made, scene, calls)})


def some_lanes(rng, count):
    """A few lanes in any order."""
    return rng.permutation(count)[: rng.integers(1, max(2, count // 2))]


def drawn_parameters(rng, scene, lanes):
    """New numbers near the scene's own, with a row for each lane."""
    values = {}
    for name in ("masses", "lengths"):
        if rng.random() < 0.6:
            own = np.array(getattr(scene.robot, name))
            near = own * rng.uniform(0.7, 1.4, (lanes, len(own)))
            too_far_apart = near.max(axis=1) > LARGEST_RATIO * near.min(axis=1)
            values[name] = np.where(too_far_apart[:, None], own, near)
    parameters = scene.parameters()
    for name in ("gravity.g", "viscous_friction.coefficients", "effort_limits.limits",
                 "prismatic_stop.restitution"):  # fmt: skip
        own = np.array([v for p, v in parameters.items() if p.split("[")[0] == name])
        if len(own) and rng.random() < 0.6:
            values[name] = own * rng.uniform(0.3, 1.0, (lanes, len(own)))
    return values


def calls_of_simulator(rng, case, scene, count):
    lanes = case["num_envs"]
    q, qd = drawn_states(scene, drawn_kinds(rng, lanes, STATES, RARE_STATES), rng)
    efforts = (
        drawn_efforts(scene, drawn_kinds(rng, lanes, EFFORTS, tuple(RARE_EFFORTS)), rng) for _ in range(count)
    )
    start = {"call": "set_state", "rows": {"q": q, "qd": qd}}
    return [start, *({"call": "advance", "rows": {"efforts": rows}} for rows in efforts)]


def limited_scene(rng):
    """A scene that an environment accepts: motors, joint efforts, sliders of limited travel."""
    for _ in range(TRIES):
        scene = drawn_scene(rng, (MOTORS,), "joint", calm=bool(rng.random() < 0.6))
        limited = all(k in scene.travel() for k in scene.robot.sliders())
        if limited and any(type(e).__name__ == MOTORS for e in scene.effects):
            return scene
    raise AssertionError("no drawn scene has limited travel")


def drawn_environment(rng, lanes):
    mode = str(rng.choice(AUTORESETS))
    return {
        "face": "vector", "goal": bool(rng.random() < 0.35), "num_envs": int(rng.choice([1, 2, 8, 9, lanes])),
        "autoreset_mode": mode, "on_bad_action": str(rng.choice(["raise", "terminate", "terminate"])),
        # Where ends are waited for, short episodes would make most steps be refused.
        "max_episode_steps": 100 if mode == "disabled" else int(rng.choice([1, LIMIT, LIMIT, 100])),
        "task": {"speed_bound": rng.choice([50.0, 50.0, 5.0])},
    }  # fmt: skip


def calls_of_environment(rng, case, scene, count):
    early = [step(drawn_actions(rng, case["num_envs"], len(scene.robot.joints)), refused="before reset")]
    made = early if rng.random() < 0.2 else []
    made.append({"call": "reset", "rows": {"seed": drawn_seeds(rng, case["num_envs"])}})
    usual = CALLS_OF_ENVIRONMENTS + ("reset",) * 5 * (case["autoreset_mode"] == "disabled")
    return made + [call_of_environment(rng, case, scene, str(kind)) for kind in rng.choice(usual, count)]


def drawn_seeds(rng, count):
    return rng.integers(2**31) + np.arange(count)


def step(actions, **more):
    return {"call": "step", "rows": {"actions": actions}, **more}


def call_of_environment(rng, case, scene, kind):
    count, joints = case["num_envs"], len(scene.robot.joints)
    if kind in PLAIN:
        return {"call": kind}
    if kind == "step":
        return step(drawn_actions(rng, count, joints))
    if kind == "bad_step":
        return step(drawn_actions(rng, count, joints, bad=True), float64=True)
    if kind == "refused_step":
        wrong, said = [(np.zeros((count, joints + 1)), "shape"), ([["0"] * joints] * count, "dtype")][
            rng.integers(2)
        ]
        return step(wrong, refused=said)
    if kind == "refused_reset":
        name, wrong = [
            ("unknown", {"unknown": 1.0}), ("masses", {"parameters": {"masses": -1.0}}),
            ("parameters", {"parameters": 3.0}), ("goal", {"goal": [[1e9, 0.0]] * count}),
            ("'q'", {"q": [[0.0]] * count}), ("'qd'", {"qd": [[1e200] * joints] * count}),
        ][rng.integers(6)]  # fmt: skip
        return {"call": "reset", "options": wrong, "refused": name}
    partly = np.sort(some_lanes(rng, count)) if kind == "partial_reset" else None
    call = {"call": "reset", "lanes": partly, "rows": {}}
    if rng.random() < 0.5:
        call["rows"]["seed"] = drawn_seeds(rng, count)
    if kind == "reset_with" or rng.random() < 0.2:
        call["rows"]["options"] = drawn_options(rng, scene, count, case["goal"])
        call["refusable"] = True
    return call


def drawn_options(rng, scene, lanes, goal):
    """Options of a reset: positions, velocities and parameters; some are refused."""
    options = {}

    def states(*kinds):
        found = [drawn_state(scene, str(rng.choice(kinds)), rng) for _ in range(lanes)]
        return (np.array(x) for x in zip(*found, strict=True))

    if rng.random() < 0.6:
        usual = ("plain", "folded", "at rest", "at stop", "near stop", "denormal")
        options["q"], options["qd"] = states(*usual)
    if rng.random() < 0.3:
        _, qd = states("fast", "huge", "overflowing")
        options["qd"] = np.clip(qd, -1e100, 1e100)
    if rng.random() < 0.4:
        options["parameters"] = drawn_parameters(rng, scene, lanes)
        if goal:
            options["parameters"].pop("lengths", None)
    if rng.random() < 0.3:
        options["goal"] = rng.uniform(-0.4, 0.4, (lanes, 2)) * min(scene.robot.lengths)
    return options
