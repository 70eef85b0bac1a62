"""Motions beyond a control interval, without efforts: errors over Lyapunov times, energy, momentum, stops."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import CentringSpring, Gravity
from redundant_envs.scenes.scene import Scene
from studies import accuracy_metrics as metrics
from studies.account_of_contacts import contact_motion
from studies.accuracy_config import Panel, States, Study
from studies.accuracy_methods import MuJoCo, Ours, installed

Array = NDArray[np.float64]

PATH_SECONDS, PATH_SAMPLES = 0.5, 250
"""Number of motions on which penetration of stops is measured, and the number of times."""
IMPACT_STATES, IMPACT_SECONDS, IMPACT_RTOL = 16, 0.2, 1e-12
"""Number of motions whose first impact is also located by SciPy."""


class Free(NamedTuple):
    """The free motions of a panel."""

    scene: Scene  # the reference
    start: States  # without efforts
    seconds: float  # length of the motions
    exponent: float  # of Lyapunov, median over the states, 1/s
    times: dict[str, float]  # error -> its time, s, rising; times after the end are absent
    reference: dict[str, Array]  # error -> coordinates of the reference, (n, 4)
    doubt: dict[str, float]  # error -> distance of a second reference, median over the states, m
    energy_scale: float  # J
    impacts: dict[int, float]  # motion -> time of its first impact by SciPy, s; empty without stops


def error_names(study: Study) -> list[str]:
    """Columns of the tip errors: after a second, and after some numbers of Lyapunov times."""
    return ["1_s", *(f"{k:g}_lyapunov" for k in study.long_runs.lyapunov_times)]


def free_motions(study: Study, panel: Panel, start: States) -> Free:
    """Reference and exponent of a panel's first states, released without efforts."""
    long, dt = study.long_runs, study.control_dt
    q, qd, _ = (x[: long.states] for x in start)
    start = q, qd, np.zeros_like(q)
    exponents = metrics.lyapunov(panel.scene(dt, substeps=4), start, long.lyapunov_seconds)
    exponent = float(np.median(exponents))
    due = [1.0, *(k / exponent if exponent > 0.0 else math.inf for k in long.lyapunov_times)]
    times = {
        name: dt * math.ceil(t / dt - 1e-9)
        for t, name in sorted(zip(due, error_names(study), strict=True))
        if t <= long.seconds
    }
    scene = panel.scene(dt, **study.reference.scene)
    both = scene, second_reference(panel, scene)
    reference, other = ({name: metrics.end(s, start, t)[0] for name, t in times.items()} for s in both)
    doubt = {k: metrics.quantile(metrics.tip_error(scene, other[k], reference[k]), 0.5) for k in times}
    scale = metrics.energy_scale(scene, 0.5 * np.add(panel.low, panel.high))
    impacts = first_impacts(scene, start)
    return Free(scene, start, long.seconds, exponent, times, reference, doubt, scale, impacts)


def second_reference(panel: Panel, reference: Scene) -> Scene:
    """The panel's scene by rk8 with twice the steps of the reference, at least 64."""
    return panel.scene(reference.control_dt, integrator="rk8", substeps=max(64, 2 * reference.substeps))


def first_impacts(scene: Scene, start: States) -> dict[int, float]:
    """The first motions that meet a stop, and the time of the first impact, s, located by SciPy."""
    if metrics.stops(scene) is None or not installed("scipy"):
        return {}
    few = tuple(x[:IMPACT_STATES] for x in start)
    _, times = contact_motion(dataclasses.replace(scene, control_dt=IMPACT_SECONDS), few, IMPACT_RTOL)
    return {i: found[0] for i, found in enumerate(times) if found}


def long_metrics(method: Ours | MuJoCo, free: Free) -> dict[str, float]:
    """All long metrics of one configuration, by column."""
    row: dict[str, float] = {}
    rest = free.start[2]
    states, clock = free.start, 0.0
    for name, time in (*free.times.items(), ("end", free.seconds)):
        if time > clock:
            q, qd, _ = method.motion(free.scene, states, time - clock)
            states, clock = (q, qd, rest), time
        if name in free.reference:
            error = metrics.tip_error(free.scene, states[0], free.reference[name])
            row |= _summary(f"tip_mm_{name}", 1e3 * error)
    if keeps_energy(free.scene):
        change = metrics.energy(free.scene, *states[:2]) - metrics.energy(free.scene, *free.start[:2])
        row |= _summary("energy_rate", np.abs(change) / (free.energy_scale * free.seconds))
        floating = metrics.weightless(free.scene)
        ends = method.motion(floating, free.start, free.seconds)[:2]
        row |= _summary("momentum", metrics.momentum_error(floating, free.start, ends))
    return row | stop_metrics(method, free)


def stop_metrics(method: Ours | MuJoCo, free: Free) -> dict[str, float]:
    """Penetration of the stops by sliders, and errors of the times of the first impacts."""
    ends = metrics.stops(free.scene)
    if ends is None:
        return {}
    path, impacts = method.path(free.scene, free.start, PATH_SECONDS, PATH_SAMPLES)
    row = _summary("penetration_mm", 1e3 * metrics.penetration(path, ends))
    if impacts is not None and free.impacts:
        first: dict[int, float] = {}
        for motion, time in impacts:
            first.setdefault(motion, time)
        errors = [abs(first.get(motion, math.inf) - time) for motion, time in free.impacts.items()]
        row |= _summary("impact_time_s", np.array(errors))
    return row


def keeps_energy(scene: Scene) -> bool:
    """Whether only the integrator can change the energy of a free motion."""
    values = scene.parameters()
    lossless = (Gravity, CentringSpring)
    return all(isinstance(e, lossless) or values.get(f"{e.key}.restitution") == 1.0 for e in scene.effects)


def _summary(name: str, errors: Array) -> dict[str, float]:
    return {f"{name}_{label}": metrics.quantile(errors, x) for label, x in (("median", 0.5), ("95", 0.95))}
