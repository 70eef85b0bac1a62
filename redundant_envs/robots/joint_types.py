"""An arm from the types of its joints, as :class:`~redundant_envs.Chain` describes it. Revolute joints and
sliders are counted each on their own: theta1, r1, theta2."""

import re
from collections.abc import Callable, Collection
from typing import Any

from redundant_envs.language.algebra import arguments_of, gives_of, numbered, physics
from redundant_envs.support.values import shown

Function = Callable[..., Any]
MAX_JOINTS = 10
"""With more joints, M111 could be two different entries."""


def check_joint_types(where: str, types: Any) -> str:
    """ValueError unless these are types of joints."""
    if not isinstance(types, str) or not re.fullmatch(f"[RP]{{1,{MAX_JOINTS}}}", types):
        raise ValueError(
            f"{where} is {shown(types)}; give 1 to {MAX_JOINTS} letters from base to tip, R for a revolute "
            "joint and P for a prismatic one, such as 'RPR'"
        )
    return types


def facts_of(arm: Any) -> dict[str, Any]:
    """Attributes of an arm's class that has ``joint_types``, by their names in :class:`~redundant_envs.Arm`.
    Without point masses among its functions, these are at the ends of its links."""
    types, functions = getattr(arm, "joint_types", None), arm.functions
    if types is None:
        return {}
    check_joint_types(f"{arm.__name__}.joint_types", types)
    names = _counted(types, "theta{}", "r{}")
    angles = [name for name, kind in zip(names, types, strict=True) if kind == "R"]
    result_names = {name for f in functions for name in gives_of(f)}
    facts: dict[str, Any] = {
        "coordinates": tuple(names),
        "rates": tuple(_counted(types, "w{}", "v{}")),
        "joints": tuple(_counted(types, "joint{}", "r{}")),
        "prismatic": tuple(kind == "P" for kind in types),
        "sincos": {angle: (f"s{k + 1}", f"c{k + 1}") for k, angle in enumerate(angles)},
    }
    lengths = len(angles)
    if "x1" in result_names:
        matches = (re.fullmatch(r"l(\d+)", a) for f in functions for a in arguments_of(f))
        lengths = max((int(number.group(1)) for number in matches if number), default=0)
        facts["num_masses"] = sum(re.fullmatch(r"x\d+", name) is not None for name in result_names)
    facts["num_lengths"] = lengths
    return facts


def functions_of(types: str, angles: Collection[str], existing: set[str]) -> list[Function]:
    """Functions of an arm of such joints that are not yet ``existing``, by the names of their results.
    Sines and cosines of its ``angles`` are known."""
    bent = [k for k in range(2, types.count("R") + 1) if {f"theta{k - 1}", f"theta{k}"} <= {*angles}]
    functions = [*_joint_maps(types), _points(types), *map(_angle_between, bent)]
    return [f for f in functions if existing.isdisjoint(gives_of(f))]


def coordinates_of_joints(types: str) -> Function:
    """Coordinates from joint positions: an angle is the sum of the joint angles up to its link."""

    @physics(gives=_counted(types, "theta{}", "r{}"), takes=numbered("phi{}", len(types)))
    def coordinates_of_joints(*phi):
        turned, coordinates = None, []
        for kind, position in zip(types, phi, strict=True):
            if kind == "R":
                turned = position if turned is None else turned + position
            coordinates.append(turned if kind == "R" else position)
        return tuple(coordinates)

    return coordinates_of_joints


def _counted(types: str, revolute: str, prismatic: str) -> list[str]:
    return [
        (revolute if kind == "R" else prismatic).format(types[: k + 1].count(kind))
        for k, kind in enumerate(types)
    ]


def _joint_maps(types: str) -> list[Function]:
    """Positions and rates of the joints, B^T q and B^T qd, and the motor map B t: a motor acts between the
    link of its joint and the part before it."""
    n, revolute = len(types), [k for k, kind in enumerate(types) if kind == "R"]
    before = dict(zip(revolute[1:], revolute, strict=False))
    behind = {k: j for j, k in before.items()}

    @physics(gives=numbered("phi{}", n), takes=_counted(types, "theta{}", "r{}"))
    def joint_positions(*q):
        return tuple(x - q[before[k]] if k in before else x for k, x in enumerate(q))

    @physics(gives=numbered("phid{}", n), takes=_counted(types, "w{}", "v{}"))
    def joint_rates(*qd):
        return tuple(x - qd[before[k]] if k in before else x for k, x in enumerate(qd))

    @physics(gives=numbered("Q{}", n), takes=numbered("t{}", n))
    def motor_map(*t):
        return tuple(x - t[behind[k]] if k in behind else x for k, x in enumerate(t))

    return [joint_positions, joint_rates, motor_map]


def _points(types: str) -> Function:
    """The ends of all links and sliders, where the masses are."""
    revolute = types.count("R")
    takes = [*numbered("l{}", revolute), *_counted(types, "s{}", "r{}"), *numbered("c{}", revolute)]

    @physics(gives=[f"{axis}{k + 1}" for k in range(len(types)) for axis in "xy"], takes=takes)
    def points(*values):
        lengths, moved, cosines = values[:revolute], values[revolute : -revolute or None], values[-revolute:]
        links, positions = iter(range(revolute)), []
        start, s, c, reach = [], None, None, None  # nothing is added to what begins at the base, along +x
        for kind, value in zip(types, moved, strict=True):
            if kind == "R":
                link, start = next(links), positions[-2:]
                s, c, reach = value, cosines[link], lengths[link]
            else:
                reach = value if reach is None else reach + value
            ahead = (reach, 0.0) if c is None else (reach * c, reach * s)
            positions += [a + b for a, b in zip(start, ahead, strict=True)] if start else ahead
        return tuple(positions)

    return points


def _angle_between(k: int) -> Function:
    """Sine and cosine of theta_k - theta_(k-1)."""

    @physics(gives=f"s{k}{k - 1} c{k}{k - 1}", takes=f"s{k} c{k} s{k - 1} c{k - 1}")
    def angle_between(s2, c2, s1, c1):
        return s2 * c1 - c2 * s1, c2 * c1 + s2 * s1

    return angle_between
