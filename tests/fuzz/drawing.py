"""Cases: scenes of any effects, with states and efforts of lanes, or with calls of environments."""

import contextlib

import numpy as np

from redundant_envs.scenes.scene import Scene
from studies.drawing import (
    RARE_EFFORTS,
    TRIES,
    drawn_arm,
    drawn_effect,
    drawn_efforts,
    drawn_rows,
    drawn_states,
    own_effects,
)

from .cases import plain

STATES = (
    "plain", "plain", "fast", "folded", "at rest", "at stop", "at stop", "near stop", "near stop", "huge"
)  # fmt: skip
RARE_STATES = ("denormal", "far", "overflowing", "nan")
EFFORTS = ("plain", "plain", "bang-bang", "bang-bang", "none", "strong")
LANES = 48
"""Most of a simulator."""
RARE = 0.03
"""Share of lanes with numbers that no motion survives."""


def drawn_kinds(rng, count, usual, rare):
    return [str(rng.choice(rare if rng.random() < RARE else usual)) for _ in range(count)]


def drawn_effects(rng, arm, needed=(), dt=0.02):
    """Any subset of the registered effects that fit an arm, a control interval and each other; limit springs
    at a random number of joints."""
    share = rng.choice([0.03, 0.1, 0.3, 1.0], p=[0.3, 0.35, 0.3, 0.05])  # many take long to compile
    chosen = []
    for name, kind in own_effects().items():
        if name not in needed and not rng.random() < share:
            continue
        for _ in range(int(rng.integers(1, 4)) if name == "LimitSpring" else 1):
            for _ in range(TRIES):
                with contextlib.suppress(ValueError):
                    effect = drawn_effect(rng, kind, arm)
                    Scene(arm, (*chosen, effect), control_dt=dt)
                    chosen.append(effect)
                    break
    rng.shuffle(chosen)
    return tuple(chosen)


def drawn_stepping(rng):
    """Integrator, substeps and tolerance: error control in two of three."""
    kind = rng.random()
    if kind < 0.65:
        return {"tolerance": float(rng.choice([1e-6, 1e-6, 1e-6, 1e-3, 1e-4, 1e-8, 1e-10, 1e-12, 1e-13]))}
    if kind < 0.72:
        return {"integrator": "dop853"}
    return {"integrator": str(rng.choice(["euler", "rk4", "rk8"])), "substeps": int(rng.choice([1, 1, 2, 5]))}


def drawn_scene(rng, needed=(), actuation=None, calm=False):
    """A scene of any registered effects, with ``needed`` among them; a calm one has similar links."""
    arm = drawn_arm(rng, calm)
    dt = float(rng.choice([0.02, 0.02, 0.005, 0.01, 0.05, 1e-6, 0.2]))
    actuation = actuation or str(rng.choice(["joint", "joint", "generalized"]))
    effects = drawn_effects(rng, arm, needed, dt)
    return Scene(arm, effects, control_dt=dt, actuation=actuation, **drawn_stepping(rng))


def drawn_simulator(rng):
    """A case: a scene, the start of its lanes, and efforts of some intervals."""
    scene, intervals = drawn_scene(rng), 3
    lanes = int(rng.choice([1, 7, 8, 9, LANES, LANES, LANES]))
    if scene.integrator == "dop853":  # takes as many steps as it needs, up to seconds for a wild lane
        lanes, intervals = min(lanes, 9), 2
    q, qd = drawn_states(scene, drawn_kinds(rng, lanes, STATES, RARE_STATES), rng)
    kinds = (drawn_kinds(rng, lanes, EFFORTS, tuple(RARE_EFFORTS)) for _ in range(intervals))
    advances = ({"efforts": drawn_efforts(scene, some, rng)} for some in kinds)
    calls = [{"call": "set_state", "rows": {"q": q, "qd": qd}}]
    calls += [{"call": "advance", "rows": rows} for rows in advances]
    return {"face": "simulator", "num_envs": lanes, "scene": scene.to_dict(), "calls": calls}


# ---- environments ------------------------------------------------------------------------------------

MOTORS = "EffortLimits"
"""Environments need it."""
CALLS = ("step",) * 14 + (
    "reset", "reset", "partial_reset", "reset_with", "bad_step", "refused_reset", "refused_step",
)  # fmt: skip
AUTORESETS = ("next_step", "same_step", "disabled")
ACTIONS = ("plain", "bang-bang", "bang-bang", "none", "too large")
SHORT = 7
"""Control steps of an episode, in most cases: few, so that episodes end often."""


def limited_scene(rng):
    """A scene that an environment accepts: motors, joint efforts, sliders of limited travel."""
    for _ in range(TRIES):
        scene = drawn_scene(rng, (MOTORS,), "joint", calm=bool(rng.random() < 0.6))
        limited = all(k in scene.travel() for k in scene.robot.sliders())
        if limited and any(type(e).__name__ == MOTORS for e in scene.effects):
            return scene
    raise AssertionError("no drawn scene has limited travel")


def drawn_vector(rng, scene=None, count=30, **fixed):
    """A case of some calls; a scene and entries of the case may be given."""
    scene = scene or limited_scene(rng)
    mode = str(rng.choice(AUTORESETS))
    case = {
        "face": "vector", "goal": bool(rng.random() < 0.35), "num_envs": int(rng.choice([1, 2, 8, 9, 12])),
        "autoreset_mode": mode, "on_bad_action": str(rng.choice(["raise", "terminate", "terminate"])),
        # Where ends are waited for, short episodes would make most steps be refused.
        "max_episode_steps": 100 if mode == "disabled" else int(rng.choice([1, SHORT, SHORT, 100])),
        "task": {"speed_bound": rng.choice([50.0, 50.0, 5.0])},
    } | fixed  # fmt: skip
    if scene.integrator == "dop853":  # takes as many steps as it needs
        count //= 4
    usual = CALLS + ("reset",) * 5 * (case["autoreset_mode"] == "disabled")
    calls = [{"call": "reset", "rows": {"seed": rng.integers(2**31) + np.arange(case["num_envs"])}}]
    calls += [call_of(rng, case["num_envs"], scene, str(kind)) for kind in rng.choice(usual, count)]
    return case | {"scene": scene.to_dict(), "calls": calls}


def call_of(rng, count, scene, kind):
    """A call with its arguments."""
    joints = len(scene.robot.joints)
    if kind in ("step", "bad_step"):  # inside [-1, 1], at its ends, and beyond
        kinds = (*ACTIONS, *RARE_EFFORTS) if kind == "bad_step" else ACTIONS
        actions = drawn_rows(rng, [str(x) for x in rng.choice(kinds, count)], np.ones(joints))
        return {"call": "step", "rows": {"actions": actions}, "float64": kind == "bad_step"}
    if kind == "refused_step":
        return {"call": "step", "rows": {"actions": np.zeros((count, joints + 1))}, "refused": "shape"}
    if kind == "refused_reset":
        name, wrong = [
            ("unknown", {"unknown": 1.0}), ("masses", {"parameters": {"masses": -1.0}}),
            ("parameters", {"parameters": 3.0}), ("goal", {"goal": [[1e9, 0.0]] * count}),
            ("'q'", {"q": [[0.0]] * count}), ("'qd'", {"qd": [[1e200] * joints] * count}),
        ][rng.integers(6)]  # fmt: skip
        return {"call": "reset", "options": wrong, "refused": name}
    some = rng.permutation(count)[: rng.integers(1, max(2, count // 2))]
    call = {"call": "reset", "lanes": np.sort(some) if kind == "partial_reset" else None, "rows": {}}
    if rng.random() < 0.5:
        call["rows"]["seed"] = rng.integers(2**31) + np.arange(count)
    if kind == "reset_with" or rng.random() < 0.2:
        call["rows"]["options"] = drawn_options(rng, scene, count)
        call["refusable"] = True
    return call


def drawn_options(rng, scene, lanes):
    """Options of a reset: positions, velocities, parameters and goals; some are refused."""
    q, qd = drawn_states(scene, drawn_kinds(rng, lanes, STATES, ("denormal", "overflowing")), rng)
    masses = scene.robot.masses * rng.uniform(0.7, 1.4, (lanes, len(scene.robot.masses)))
    options = {
        "q": q,
        "qd": np.clip(qd, -1e100, 1e100),
        "parameters": {"masses": masses},
        "goal": rng.uniform(-0.4, 0.4, (lanes, 2)) * min(scene.robot.lengths),
    }
    return {name: rows for name, rows in options.items() if rng.random() < 0.4}


def drawn(seed, number):
    """A case of a seed and a number: environments in two of five."""
    rng = np.random.default_rng([seed, number])
    made = {"seed": seed, "number": number, "threads": int(rng.choice([1, 1, 2]))}
    return plain(made | (drawn_vector if number % 5 in (1, 3) else drawn_simulator)(rng))
