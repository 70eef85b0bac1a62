"""Readings of sensors: what observations know of the motion, and the states of the sensors."""

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from redundant_envs.effects.bound_hooks import Attachments, Bound
from redundant_envs.effects.hooks import Reading, Sensing
from redundant_envs.language.algebra import any_of, arguments_of, gives_of, logical_not
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm

LARGEST = {Reading.POSITION: 1e6, Reading.RATE: 1e100}
"""Largest readings: sines are exact up to 1e6 rad, and squares of rates are finite."""
Read = dict[tuple[Reading, int], Any]
"""Readings by what they measure, and the number of the joint."""


def renewed(attached: Attachments, what: str, x: Quantities) -> dict[str, Any]:
    """New values of the sensors' states, by their fields: the "update" at the end of an interval, or those
    that are "initial"; ``x`` then has them."""
    owned = (functions for a in attached.of(Sensing) for functions in a.states.values())
    return _read(attached, x, what)[1] if any(what in functions for functions in owned) else {}


def _read(attached: Attachments, x: Quantities, what: str = "") -> tuple[Read, dict[str, Any]]:
    """Readings of the scene's sensors, from true quantities and the states of the sensors, and new values of
    these. Each sensor gets what those before it read at this instant."""
    read: Read = {}
    new: dict[str, Any] = {}
    for a in attached.of(Sensing):
        key = a.hook.reading, a.hook.joint
        reaching = _reaching(a.hook.reading.value.format(a.hook.joint + 1), read.get(key), x)
        z = {field: reaching(functions[what]) for field, functions in a.states.items() if what in functions}
        x.update(z)
        new |= z
        read[key] = reaching(a.functions["function"])
    return read, new


def _reaching(name: str, read: Any, x: Quantities) -> Callable[[Bound], Any]:
    """Evaluates functions of a sensor, for which the quantity that it measures is what reaches it."""
    reaching = x[name] if read is None else read
    return lambda function: function.on(reaching if n == name else x[n] for n in function.names)


def measured(attached: Attachments, arm: Arm, x: Quantities) -> dict[str, Any]:
    """Coordinates and rates as the sensors read them, from true quantities; {} without sensors."""
    read, _ = _read(attached, x)
    if not read:
        return {}
    kinds = [(r, k) for r in Reading for k in range(len(arm.coordinates))]
    names = {(r, k): r.value.format(k + 1) for r, k in kinds}
    joints = {name: read[key] if key in read else x[name] for key, name in names.items()}
    place = arm.coordinates_of_joints
    results = place(*(joints[name] for name in arguments_of(place)))
    motion = dict(zip(gives_of(place), results if isinstance(results, tuple) else (results,), strict=True))
    for rate, row in zip(arm.rates, np.linalg.inv(arm.motor_map.T), strict=True):
        shares = [(float(b), joints[f"phid{k + 1}"]) for k, b in enumerate(row) if b != 0.0]
        motion[rate] = reduce(operator.add, (v if b == 1.0 else b * v for b, v in shares))
    return motion


def reads_nonsense(attached: Attachments, x: Quantities) -> Any:
    """Whether a reading is NaN, or too large for an observation."""
    read, _ = _read(attached, x)
    return any_of(logical_not(abs(value) <= LARGEST[kind]) for (kind, _), value in read.items())
