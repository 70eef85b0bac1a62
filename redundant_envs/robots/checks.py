"""Checks that the definition of an arm is complete, made when its class is created."""

import functools
import re
from typing import Any

from redundant_envs.compiler import dialect
from redundant_envs.language.algebra import entries, gives_of, numbered
from redundant_envs.language.quantities import Quantities, givers_of
from redundant_envs.robots.joint_types import MAX_JOINTS

OWN_NAMES = re.compile(
    r"(m|l|t|Q|G|h|n|x|y|vx|vy|phi|phid|qdd|command|action|held|hold|low|high|u|draw)\d+|[JMCWXY]\d{2,4}|"
    r"tip_v?[xy]|manipulability|Jdqd\d|[XY]dqd\d+|a[xy]|[TU]|Lz"
)
"""Names of the quantities that every arm has."""
FUNCTIONS = ("column_norms", "mobility_bounds", "held_dynamics", "slider_mobility", "coordinates_of_joints")
"""What a class may give beside ``functions`` that is a function of its own."""
OF_CLASSES = ("functions", "prepared", *FUNCTIONS, "coordinates", "rates", "joints", "prismatic", "sincos")
"""What is the same for all arms of a class."""
INSTEAD = "it belongs to the class: let its functions take m1, l1 and so on as arguments"
OF_LANES = ("h", "interval", "work", "error", "fault", "limit", "steps", "reach")


def check_class(kind: Any) -> None:
    """ValueError if an arm's class computes what is the same for all its arms from one of them."""
    for name in OF_CLASSES:
        if isinstance(value := vars(kind).get(name), property | functools.cached_property):
            raise ValueError(f"{kind.__name__}.{name} is a {type(value).__name__}; {INSTEAD}")


def check_own(arm: Any) -> None:
    """ValueError if an arm has equations of its own, which could hold its masses and lengths."""
    for name in OF_CLASSES:
        if name in getattr(arm, "__dict__", ()):
            raise ValueError(f"robot.{name} is that of one {arm.kind}; {INSTEAD}")


def check_functions(arm: Any) -> None:
    """ValueError unless the functions that an arm's class gives itself belong to the physics dialect."""
    if dialect.is_own(arm):
        return
    inherited = {id(f) for base in arm.__mro__[1:] for f in vars(base).get("functions", ())}
    functions = [("functions", f) for f in arm.functions if id(f) not in inherited]
    functions += [("prepared", f) for f in vars(arm).get("prepared", ())]
    functions += [(name, getattr(arm, name)) for name in FUNCTIONS if callable(vars(arm).get(name))]
    for name, function in functions:
        try:
            dialect.check(function)
        except ValueError as error:
            raise ValueError(f"{arm.__name__}.{name}: {error}") from None


def check_joints(arm: Any) -> None:
    """ValueError unless an arm names its coordinates, rates and joints, each once."""
    for name in ("num_lengths", "coordinates", "rates", "joints", "prismatic", "sincos"):
        if not hasattr(arm, name):
            raise ValueError(f"{arm.__name__} lacks {name}; give it (see redundant_envs.Arm)")
    n = len(arm.coordinates)
    if not 1 <= n <= MAX_JOINTS:
        raise ValueError(f"{arm.__name__} has {n} coordinates; give 1 to {MAX_JOINTS}")
    for name in ("rates", "joints", "prismatic"):
        count = len(getattr(arm, name))
        if count != n:
            raise ValueError(
                f"{arm.__name__}.{name} has {count} entries; its coordinates are {n}: give as many"
            )
    if not all(isinstance(slides, bool) for slides in arm.prismatic):
        raise ValueError(f"{arm.__name__}.prismatic is {arm.prismatic!r}; give True or False for each joint")
    if len(set(arm.joints)) < n:
        raise ValueError(f"{arm.__name__}.joints is {arm.joints!r}; give each joint a name of its own")
    taken = {*OF_LANES, *(name for f in arm.functions for name in gives_of(f))}
    taken |= {name for pair in arm.sincos.values() for name in pair}
    names = [*arm.coordinates, *arm.rates]
    for name in names:
        fine = isinstance(name, str) and name.isidentifier() and not OWN_NAMES.fullmatch(name)
        if not fine or name in taken or names.count(name) > 1:
            raise ValueError(
                f"{arm.__name__} calls a coordinate or a rate {name!r}; give each an identifier that is no "
                "name of another one, of its functions, of every arm (m1, tip_x) or of the engine (work)"
            )


def check_quantities(arm: Any) -> None:
    """ValueError unless an arm has all required functions, and its sliders move along their own
    coordinates."""
    n = len(arm.coordinates)
    if not hasattr(arm, "coordinates_of_joints"):
        raise ValueError(f"{arm.kind} gives phi1 and no coordinates_of_joints; give that function too")
    names = givers_of(tuple(arm.functions))
    required = [
        *(f"{axis}{k + 1}" for k in range(arm.num_masses) for axis in "xy"), "tip_x", "tip_y",
        *entries("J", 2, n), "Jdqd1", "Jdqd2", *entries("M", n, n),
        *(form.format(k + 1) for form in ("h{}", "G{}", "phi{}", "phid{}", "Q{}", "qdd{}") for k in range(n)),
    ]  # fmt: skip
    missing = [name for name in required if name not in names]
    if missing:
        raise ValueError(f"{arm.kind} gives no {', '.join(missing[:8])}; add functions that do")
    known = {*numbered("l{}", arm.num_lengths), *(f"high{k + 1}" for k in arm.sliders())}
    for name in arm.extent:
        if name not in known:
            raise ValueError(f"{arm.kind}.extent has {name!r}; choose {', '.join(sorted(known))}")
    places = {name: 0.3 + 0.17 * k for k, name in enumerate(arm.coordinates)}
    lengths = {name: 0.7 + 0.1 * k for k, name in enumerate(numbered("l{}", arm.num_lengths))}
    x = Quantities({**places, **lengths}, tuple(arm.functions), arm.sincos)
    for k in arm.sliders():
        if x[f"phi{k + 1}"] != places[arm.coordinates[k]]:
            raise ValueError(
                f"the slider {arm.joints[k]!r} of {arm.kind} is not at coordinate {k + 1}, "
                f"{arm.coordinates[k]!r}; use the position of a slider on its link as its coordinate: there "
                "its stops act"
            )
