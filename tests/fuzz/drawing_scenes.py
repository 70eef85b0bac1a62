"""Scenes of any effects, and the kinds of states, efforts and actions of their lanes."""

import numpy as np

from redundant_envs.scenes.scene import Scene
from studies.drawing import RARE_EFFORTS, TRIES, drawn_arm, drawn_effect, drawn_rows, own_effects

MOTORS = "EffortLimits"
"""Environments need it."""
STATES = (
    "plain", "plain", "fast", "folded", "at rest", "at stop", "at stop", "near stop", "near stop", "huge"
)  # fmt: skip
RARE_STATES = ("denormal", "far", "overflowing", "nan")
EFFORTS = ("plain", "plain", "bang-bang", "bang-bang", "none", "strong")
ACTIONS = ("plain", "bang-bang", "bang-bang", "none", "too large")
RARE = 0.03
"""Share of lanes with numbers that no motion survives."""


def drawn_kinds(rng, count, usual, rare):
    return [str(rng.choice(rare if rng.random() < RARE else usual)) for _ in range(count)]


def drawn_effects(rng, arm, needed=(), dt=0.02):
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
        if name not in needed and not rng.random() < share:
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


def drawn_scene(rng, needed=(), actuation=None, calm=False):
    """A scene of any registered effects, with ``needed`` among them; a calm one has similar links."""
    arm = drawn_arm(rng, calm)
    dt = float(rng.choice([0.02, 0.02, 0.005, 0.01, 0.05, 1e-6, 0.2]))
    actuation = actuation or str(rng.choice(["joint", "joint", "generalized"]))
    effects = drawn_effects(rng, arm, needed, dt)
    return Scene(arm, effects, control_dt=dt, actuation=actuation, **drawn_stepping(rng))


def drawn_actions(rng, count, joints, bad=False):
    """Actions, (count, joints): inside [-1, 1], at its ends, and beyond; bad ones in float64."""
    kinds = (*ACTIONS, *RARE_EFFORTS) if bad else ACTIONS
    rows = drawn_rows(rng, [str(rng.choice(kinds)) for _ in range(count)], np.ones(joints))
    return rows if bad else rows.astype(np.float32)
