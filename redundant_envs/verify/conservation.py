"""Is the energy balance closed along motions?"""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scenes.scene import Scene
from redundant_envs.verify.checks import LEAST_SHARE, ROUNDING, Array, Sample, check, ratio
from redundant_envs.verify.promises import Finding, at_most

OPEN = 1e-9
"""Largest gap of the energy balance, in units of the exchanged energies: forty times the error of dop853 in
scenes of all effects (2e-11), and far below the effect of a wrong term."""
SAME = 0.1
"""States are judged whose gaps differ by no more than this, in units of ``OPEN``, when the interval is
simulated whole and in parts: steps across a kink, such as that of a stiff spring, cause gaps of their own."""
PARTS, EQUAL_STEPS = 3, 32


class IntervalEnds(NamedTuple):
    """The ends of control intervals."""

    q: Array
    qd: Array
    work: Array  # J
    z: Array  # states of effects
    numerics: NDArray[np.int8]  # flags

    @property
    def good(self) -> NDArray[np.bool_]:
        return self.numerics == 0


def crossed(scene: Scene, q: Array, qd: Array, efforts: Array, parts: int = 1) -> IntervalEnds:
    """A control interval by dop853, whole or in parts."""
    exact = dataclasses.replace(scene, integrator="dop853", substeps=1, tolerance=None)
    return moved(exact, q, qd, efforts, parts)


def moved(scene: Scene, q: Array, qd: Array, efforts: Array, parts: int = 1) -> IntervalEnds:
    """A control interval under constant efforts, in equal parts."""
    batch = BatchSimulator(scene, len(q), track_work=True)
    batch.set_state(q, qd)
    numerics = np.zeros(len(q), np.int8)
    for _ in range(parts):
        numerics |= batch.advance_partly(efforts, scene.control_dt / parts).numerics
    return IntervalEnds(batch.q, batch.qd, batch.work, batch.z, numerics)


def own_interval(trial: Sample) -> IntervalEnds:
    """The interval by the scene's own steps."""
    return moved(trial.scene, *trial.states)


def exact_in_parts(trial: Sample) -> IntervalEnds:
    """The same with other steps: equal ones if updates at the end or an instant forbid a division."""
    updated = any(state.update is not None for state in trial.scene.states().values())
    if not updated and not trial.scene.attached.instants:
        return crossed(trial.scene, *trial.states, PARTS)
    substeps = EQUAL_STEPS * trial.scene.substeps
    fine = dataclasses.replace(trial.scene, integrator="rk8", substeps=substeps, tolerance=None)
    return moved(fine, *trial.states)


def energy_changes(scene: Scene, q: Array, qd: Array, end: IntervalEnds) -> tuple[Array, Array, Array]:
    """Change of kinetic + potential - work, exchanged energies, stored energies; (n,) each, J."""
    kinetic = kinetic_energy(scene, q, qd), kinetic_energy(scene, end.q, end.qd, end.z)
    potential = potential_energy(scene, q), potential_energy(scene, end.q, end.z)
    gained = potential[1] - potential[0]
    scale = kinetic[0] + kinetic[1] + np.abs(gained) + np.abs(end.work)
    return kinetic[1] - kinetic[0] + gained - end.work, scale, np.abs(potential[0]) + np.abs(potential[1])


@check("energy balance", at_most(OPEN))
def energy_book(trial: Sample) -> Finding:
    """Kinetic + potential - work is constant over a control interval, or over a shorter one that is calm for
    half of the states, in units of the energies involved."""
    q, qd, _ = trial.states
    whole, parts = (crossed(trial.calm_scene, *trial.states, n) for n in (1, PARTS))
    change, scale, stored = energy_changes(trial.scene, q, qd, whole)
    other = energy_changes(trial.scene, q, qd, parts)[0]
    here, nudges = potential_energy(trial.scene, q), ROUNDING * np.eye(q.shape[1])  # roundings of coordinates
    by_rounding = [np.abs(potential_energy(trial.scene, q + nudge * q) - here) for nudge in nudges]
    noise = ROUNDING * stored + np.sum(by_rounding, axis=0)
    judged = whole.good & parts.good & ~(np.abs(change - other) > SAME * OPEN * scale + noise)
    if np.mean(judged) < LEAST_SHARE:
        words = "energy: too few intervals could be simulated accurately to judge the scene by"
        return Finding(np.inf, f"{np.mean(judged):.0%} of the states judged", words)
    joules = np.abs(change[judged]).max()
    words = (
        f"energy: kinetic + potential - work changes by up to {joules:.3g} J in a control interval, {{:.1e}} "
        "of the energies at hand: check potential and conservative of the effects"
    )
    return trial.finding(np.where(judged, ratio(np.maximum(np.abs(change) - noise, 0.0), scale), 0.0), words)
