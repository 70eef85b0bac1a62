# mypy: allow-untyped-defs
"""Scenes, states and efforts, drawn from one generator: from calm ones to the limits of float64."""

import dataclasses

import numpy as np

from redundant_envs.effects import REGISTRY, InnerControl
from redundant_envs.robots import RPRP, Chain, FourR
from redundant_envs.tasks.base import hard_stops, spring_limits
from studies.interval_families import decades

ARMS = ((RPRP, 2), (FourR, 4))
"""Arms and their numbers of lengths."""
TRIES = 50
"""Most draws of numbers until a scene accepts them."""
OF_SLIDERS = "CentringSpring", "PrismaticStop"
"""Effects with a number for each slider."""


def spread(rng, count, ratio):
    """Positive numbers whose ratios reach ``ratio`` at most; one in four is at an end."""
    places = rng.uniform(-0.5, 0.5, count)
    ends = rng.random(count) < 0.25
    places[ends] = 0.5 * rng.choice([-1.0, 1.0], int(ends.sum()))
    return tuple(float(x) for x in 0.99 * ratio ** (0.999 * places))


def drawn_arm(rng, calm=False):
    kind, lengths = ARMS[rng.integers(len(ARMS))]
    return kind(*drawn_numbers(rng, 4, lengths, calm))


def drawn_chain(rng, most=5):
    """A chain of 1 joint to ``most``, revolute ones and sliders in any order."""
    types = "".join(rng.choice(["R", "R", "P"], rng.integers(1, most + 1)))
    return Chain(types, *drawn_numbers(rng, len(types), types.count("R"), calm=True))


def drawn_numbers(rng, joints, lengths, calm):
    """Masses, kg, and lengths, m; similar ones for a calm arm."""
    wild = 0.0 if calm else rng.random()
    masses = spread(rng, joints, float(rng.choice([4.0, 30.0] if wild < 0.7 else [1e4, 1e8, 1e12])))
    longs = spread(rng, lengths, rng.choice([2.0, 8.0]) if wild < 0.85 else float(rng.choice([1e3, 1e6])))
    scale = decades(rng, 0.1, 2.0) if rng.random() < 0.9 else decades(rng, 1e-6, 1e6)
    return tuple(0.5 * m for m in masses), tuple(scale * x for x in longs)


# ---- effects -----------------------------------------------------------------------------------------


def own_effects():
    """Effects of the package by their names, which tests extend in the same process, but for the modes of
    actions: their commands are no efforts of joints, and only those are drawn."""
    kinds = {name: kind for name, kind in sorted(REGISTRY.items()) if not issubclass(kind, InnerControl)}
    return {name: kind for name, kind in kinds.items() if kind.__module__.startswith("redundant_envs.")}


def size_of(arm):
    """Length of the stretched arm, m; 1 of sliders alone."""
    return sum(arm.lengths) or 1.0


def weight_of(arm):
    """Moment of the stretched arm's weight about its base, N m: the scale of efforts."""
    return 9.81 * sum(arm.masses) * size_of(arm)


def drawn_effect(rng, kind, arm):
    """An effect with numbers by the names of its fields; those of other fields are from 1e-3 to 1."""
    n, size, weight, joint = len(arm.joints), size_of(arm), weight_of(arm), rng.integers(len(arm.joints))
    sliders = len(arm.sliders()) if kind.__name__ in OF_SLIDERS else 1
    count = {"GearBacklash": n, "JointStop": n, "LuGre": n}.get(kind.__name__, sliders)
    if count != 1 or arm.prismatic[joint]:  # from a hundredth of the arm to as long as it is
        low = size * rng.choice([0.0, 0.0, -0.1, 0.05], count)
        high = low + size * decades(rng, 0.01, 1.0, count)
    else:
        low, high = -decades(rng, 0.1, 2.0, 1), decades(rng, 0.1, 2.0, 1)
    stiffness = weight * decades(rng, 1.0, 1e3, count)
    unit = np.where(arm.prismatic, 1.0 / size, 1.0)
    angle, length = rng.uniform(-np.pi, np.pi), rng.choice([1.0, 1.0, 0.5, 0.0])
    down = (0.0, -1.0) if rng.random() < 0.7 else (length * np.cos(angle), length * np.sin(angle))
    coulomb = 0.02 * weight * decades(rng, 0.01, 1.0, n)
    known = {
        "coulomb": coulomb,
        "stiction": coulomb * rng.choice([1.0, 1.4, 3.0]),
        "g": rng.choice([9.81, 9.81, 1.6, 0.0, -9.81, 1e3]),
        "down": down,
        "coefficients": 0.02 * weight * rng.choice([0.0, 0.2, 0.2, 3.0]) * rng.random(n),
        "limits": weight * decades(rng, 0.05, 5.0) * unit * rng.uniform(0.2, 1.0, n),
        "coordinate": arm.joints[joint],
        "joint": joint,
        "joints": rng.choice(arm.joints, min(2, n), replace=False),
        "moment_arms": 0.05 * rng.choice([-1.0, 1.0], 2),
        "name": "",
        "point": rng.integers(arm.num_masses) + 1,
        "post": size * rng.uniform(-1.0, 1.0, 2),
        "lower": low,
        "upper": high,
        "restitution": rng.choice([0.0, 0.0, 0.3, 0.5, 0.9, 1.0]),
        "stiffness": stiffness,
        "damping": rng.choice([0.0, 0.02, decades(rng, 0.1, 20.0)]) * stiffness,
    }
    if kind.__name__ in ("Disc", "HalfPlane"):
        known |= {
            "centre": size * rng.uniform(-1.0, 1.0, 2),
            "radius": size * decades(rng, 0.01, 0.5),
            "point": size * rng.uniform(-1.0, 1.0, 2),
            "normal": rng.normal(0.0, 1.0, 2),
            "along_links": bool(rng.random() < 0.5),
            "stiffness": stiffness / size**2,
            "damping": rng.choice([0.0, 0.2, 2.0]),
        }
    values = {}
    for field in dataclasses.fields(kind):
        plural = any(word in str(field.type) for word in ("Sequence", "Numbers", "Ends"))
        several = plural or field.name in getattr(kind, "of_joints", ())
        guess = decades(rng, 1e-3, 1.0, rng.choice([2, n]) if several else 1)
        value = np.ravel(known.get(field.name, guess)).tolist()
        if field.init:
            values[field.name] = tuple(value) if several else value[0]
    if kind.__name__ == "PrismaticStop":
        values["upper"] = tuple(None if rng.random() < 0.1 else x for x in values["upper"])
    return kind(**values)


# ---- states and efforts ------------------------------------------------------------------------------

RARE_EFFORTS = {"1e300": 1e300, "nan": np.nan, "inf": -np.inf, "denormal": 5e-324}


def drawn_states(scene, kinds, rng):
    """Coordinates and velocities, (lanes, joints) each, one lane of each kind."""
    states = [drawn_state(scene, kind, rng) for kind in kinds]
    return tuple(np.array(x) for x in zip(*states, strict=True))


def drawn_state(scene, kind, rng):
    """Coordinates and velocities of one lane; sliders are between their stops."""
    arm, values = scene.robot, scene.parameters()
    n, size = len(arm.joints), size_of(arm)
    limits = (*spring_limits(scene), *hard_stops(scene))
    ends = {joint: (values[low], values[high]) for joint, low, high in limits}
    q, rates = rng.uniform(-np.pi, np.pi, n), rng.normal(0.0, 1.0, n)
    qd = rates * decades(rng, 0.3, 8.0)
    turned = rng.choice([0.0, 0.5 * np.pi, np.pi, -np.pi], n) + rng.choice([0.0, 1e-15, 1e-9, 1e-4])
    denormal = rng.choice([0.0, 5e-324, -5e-324, 1e-310], n), rng.choice([0.0, 5e-324, -2e-308], n)
    q, qd = {
        "folded": (turned, qd * rng.choice([0.0, 1.0])),  # singular poses, exactly and nearly
        "at rest": (q, 0.0 * qd),
        "fast": (q, 30.0 * rates),
        "huge": (q, rates * decades(rng, 50.0, 1e6)),
        "denormal": denormal,
        "far": (q * decades(rng, 10.0, 1e6), qd),
        "overflowing": (q, np.sign(rates) * 10.0 ** rng.uniform(20.0, 300.0, n)),
    }.get(kind, (q, qd))
    if kind == "nan":
        (q if rng.random() < 0.5 else qd)[rng.integers(n)] = rng.choice([np.nan, np.inf])
    for joint in (k for k in range(n) if arm.prismatic[k]):
        low, high = ends.get(joint, (-size, size))
        low, high = (x if np.isfinite(x) else s * size for x, s in ((low, -1.0), (high, 1.0)))
        high = max(high, low)
        qd[joint] *= 0.3 * size
        if not np.isfinite(q[joint]):
            q[joint] = np.nan  # infinity is beyond its stop, and refused
            continue
        place = rng.uniform(low, high)
        if kind in ("at stop", "near stop"):
            gap = 0.0 if kind == "at stop" else 0.5 * (high - low) * 10.0 ** rng.uniform(-16.0, 0.0)
            place = low + gap if rng.random() < 0.5 else high - gap
            qd[joint] *= rng.choice([0.0, 1e-9, 1.0, 10.0])
        q[joint] = min(max(place, low), high)
    return between_angles(scene, q), qd


def between_angles(scene, q):
    """Coordinates with the angles of joints between their stops, one in four of those at an end."""
    B, values = scene.robot.motor_map, scene.parameters()
    ends = [stop for stop in hard_stops(scene) if not scene.robot.prismatic[stop[0]]]
    joints = np.where(np.isinf(q), np.nan, q) @ B
    for joint, low, high in ends:
        joints[joint] = np.clip(joints[joint], values[low], values[high])
    return joints @ np.linalg.inv(B) if ends else q


def drawn_efforts(scene, kinds, rng):
    """Efforts, (lanes, joints), one lane of each kind, from none to ones that no motion survives."""
    arm = scene.robot
    unit = weight_of(arm) * np.array([1.0 / size_of(arm) if s else 1.0 for s in arm.prismatic])
    return drawn_rows(rng, kinds, unit)


def drawn_rows(rng, kinds, unit):
    """A row of efforts or actions of each kind."""
    rows = rng.uniform(-1.0, 1.0, (len(kinds), len(unit))) * unit
    for row, kind in zip(rows, kinds, strict=True):
        if kind in RARE_EFFORTS:
            row[rng.integers(len(unit))] = RARE_EFFORTS[kind]
        elif kind == "bang-bang":
            row[:] = np.sign(row) * unit
        else:
            row *= {"plain": 1.0, "none": 0.0, "too large": 5.0, "strong": 30.0}[kind]
    return rows
