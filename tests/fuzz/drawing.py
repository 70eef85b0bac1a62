"""Cases: scenes of any effects, with states and efforts of their lanes, as JSON documents."""

import json

import numpy as np

from redundant_envs.scenes.scene import Scene
from studies.drawing import (
    RARE_EFFORTS,
    TRIES,
    drawn_arm,
    drawn_effect,
    drawn_efforts,
    drawn_states,
    own_effects,
)

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


def drawn_effects(rng, arm, dt=0.02):
    """Any subset of the registered effects that fit an arm, a control interval and each other; limit springs
    at a random number of joints."""
    share = rng.choice([0.03, 0.1, 0.3, 1.0], p=[0.3, 0.35, 0.3, 0.05])  # many take long to compile
    chosen = []

    def fits(*effects):
        try:
            return Scene(arm, effects, control_dt=dt)
        except ValueError:
            return None

    for name, kind in own_effects().items():
        if not rng.random() < share:
            continue
        for _ in range(int(rng.integers(1, 4)) if name == "LimitSpring" else 1):
            for _ in range(TRIES):
                try:
                    effect = drawn_effect(rng, kind, arm)
                except ValueError:
                    continue
                if fits(effect) and fits(*chosen, effect):
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


def drawn_scene(rng, calm=False):
    """A scene of any registered effects; a calm one has similar links."""
    arm = drawn_arm(rng, calm)
    dt = float(rng.choice([0.02, 0.02, 0.005, 0.01, 0.05, 1e-6, 0.2]))
    actuation = str(rng.choice(["joint", "joint", "generalized"]))
    effects = drawn_effects(rng, arm, dt)
    return Scene(arm, effects, control_dt=dt, actuation=actuation, **drawn_stepping(rng))


def drawn(seed, number):
    """A case of a seed and a number: a scene, the start of its lanes, and efforts of some intervals."""
    rng = np.random.default_rng([seed, number])
    threads, scene = int(rng.choice([1, 1, 2])), drawn_scene(rng)
    lanes, intervals = int(rng.choice([1, 7, 8, 9, LANES, LANES, LANES])), 3
    if scene.integrator == "dop853":  # takes as many steps as it needs, up to seconds for a wild lane
        lanes, intervals = min(lanes, 9), 2
    q, qd = drawn_states(scene, drawn_kinds(rng, lanes, STATES, RARE_STATES), rng)
    kinds = (drawn_kinds(rng, lanes, EFFORTS, tuple(RARE_EFFORTS)) for _ in range(intervals))
    advances = ({"efforts": drawn_efforts(scene, some, rng)} for some in kinds)
    calls = [{"call": "set_state", "rows": {"q": q, "qd": qd}}]
    calls += [{"call": "advance", "rows": rows} for rows in advances]
    case = {"seed": seed, "number": number, "threads": threads, "num_envs": lanes}
    case |= {"scene": scene.to_dict(), "calls": calls}
    return json.loads(json.dumps(case, default=lambda array: array.tolist()))
