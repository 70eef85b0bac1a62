"""Are closed forms of effects' states solutions of the states' own derivatives?

Fixed steps evaluate a closed form where error control integrates the derivative: if one does not belong to
the other, a scene moves differently with another integrator.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from redundant_envs.effects.bound_hooks import TIME, Attached, Functions
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.verify.checks import Array, Sample, check, ratio
from redundant_envs.verify.hints import Motion, worst_of
from redundant_envs.verify.promises import Finding, at_most

AGREE = at_most(1e-9)  # rounding is 1e-15 times the time in time constants, a wrong factor 1e-3 and more
DECADES = 4.0  # number of decades of times below the control interval: of states that decay within it as well
SPREAD = 2.0  # largest values of a state at the start, in units of that which it has an interval later


@check("closed forms of states", AGREE)
def closed_forms(trial: Sample) -> Finding:
    """A closed form keeps the value of its state at the time 0, and its derivative by the time is that of the
    state, at the values that it gives, with all other quantities constant."""
    dynamics, (q, qd, efforts) = Dynamics(trial.scene), trial.states
    B = dynamics.arm.motor_map
    x = Motion(dynamics, q @ B, qd @ B, efforts).values()
    states = ((a, field, own) for a in dynamics.scene.attached for field, own in a.states.items())
    found = [_closed_form(trial, x, *state) for state in states if "closed" in state[2]]
    return worst_of(found, "no state has a closed form")


def _closed_form(trial: Sample, x: Quantities, a: Attached[Any], field: str, own: Functions) -> Finding:
    """The largest gap between a closed form and its derivative, in units of the largest derivative."""
    count, interval = len(trial.states[0]), trial.scene.control_dt
    rng = np.random.default_rng(trial.seed + 9)
    times = interval * 10.0 ** -rng.uniform(0.0, DECADES, count)

    def at(function: str, value: Any, time: Any = 0.0) -> Any:
        given = {field: value, TIME: time}
        return own[function].on(given[n] if n in given else x[n] for n in own[function].names)

    later = np.broadcast_to(at("closed", x[field], interval), count)
    size = np.where(later == 0.0, 1.0, np.abs(later))
    start = size * rng.uniform(-SPREAD, SPREAD, count)
    kept = np.abs(at("closed", start) - start)
    then = dual(at("closed", start, Dual(times, np.ones(count))))
    slope, rate = np.broadcast_arrays(then.slope, at("derivative", then.value))
    largest: Array = np.abs(at("derivative", start))
    for other in (slope, rate, (np.abs(start) + np.abs(then.value)) / interval):
        largest = np.maximum(largest, np.abs(other))
    gaps = np.maximum(ratio(slope - rate, largest), ratio(kept, size))
    most, where = trial.worst(gaps)
    state = int(where.removeprefix("state "))
    words = (
        f"{a.key}: closed= of {field!r} changes by {slope[state]:.6g} per second after {times[state]:.3g} s, "
        f"and by {kept[state]:.3g} at once; its derivative= is {rate[state]:.6g} there: give the solution of "
        "the derivative with all other quantities constant"
    )
    return Finding(most, f"{where}, {a.key}", words)
