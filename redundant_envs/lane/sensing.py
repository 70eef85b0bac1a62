"""Readings of the sensors of the joints, from which observations follow."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from functools import reduce
from typing import Any

import numpy as np

from redundant_envs.algebra import any_of, arguments_of, gives_of, logical_not
from redundant_envs.effects.hooks import Reading, Sensing
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.quantities import Quantities

LARGEST = {Reading.POSITION: 1e6, Reading.RATE: 1e100}
"""Largest readings: sines are exact up to 1e6 rad, and squares of rates are finite."""


def readings(dynamics: Dynamics, x: Quantities) -> dict[tuple[Reading, int], Any]:
    """Readings of the scene's sensors, from true quantities."""
    read: dict[tuple[Reading, int], Any] = {}
    for a in dynamics.scene.attached.of(Sensing):
        key, name = (a.hook.reading, a.hook.joint), a.hook.reading.value.format(a.hook.joint + 1)
        reaching, function = read.get(key, x[name]), a.functions["function"]
        read[key] = function.on(reaching if n == name else x[n] for n in function.names)
    return read


def measured(dynamics: Dynamics, x: Quantities) -> dict[str, Any]:
    """Coordinates and rates as the sensors read them, from true quantities; {} without sensors."""
    read = readings(dynamics, x)
    if not read:
        return {}
    joints = range(dynamics.count)
    return motion_of_joints(
        dynamics.arm,
        {
            name: read[r, k] if (r, k) in read else x[name]
            for r in Reading
            for k in joints
            for name in [r.value.format(k + 1)]
        },
    )


def reads_nonsense(dynamics: Dynamics, x: Quantities) -> Any:
    """Whether a reading is NaN, or too large for an observation."""
    read = readings(dynamics, x)
    return any_of(logical_not(abs(value) <= LARGEST[kind]) for (kind, _), value in read.items())


def motion_of_joints(arm: Any, joints: Mapping[str, Any]) -> dict[str, Any]:
    """Coordinates and rates of an arm whose joints are at phi1, ... and move with phid1, ..."""
    place = arm.coordinates_of_joints
    results = place(*(joints[name] for name in arguments_of(place)))
    motion = dict(zip(gives_of(place), results if isinstance(results, tuple) else (results,), strict=True))
    for rate, row in zip(arm.rates, np.linalg.inv(arm.motor_map.T), strict=True):
        shares = [(float(b), joints[f"phid{k + 1}"]) for k, b in enumerate(row) if b != 0.0]
        motion[rate] = reduce(operator.add, (v if b == 1.0 else b * v for b, v in shares))
    return motion
