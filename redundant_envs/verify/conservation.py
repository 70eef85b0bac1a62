"""Is the energy balance closed along motions, and is momentum kept?"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects.hooks import Inertia, PointMass
from redundant_envs.language.algebra import numbered
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.scenes.scene import Scene
from redundant_envs.verify.checks import ENOUGH_SMOOTH, ROUNDING, Array, Sample, check, enough, ratio
from redundant_envs.verify.equations import added_inertia, equations_at, from_points, slopes
from redundant_envs.verify.promises import Finding, NotApplicable, at_most

OPEN = 1e-9
"""Largest gap of the energy balance, in units of the exchanged energies: forty times the error of dop853 in
scenes of all effects (2e-11), and far below the effect of a wrong term."""
SAME = 0.1
"""States are judged whose gaps differ by no more than this, in units of ``OPEN``, when the interval is
simulated whole and in parts: steps across a kink, such as that of a stiff spring, cause gaps of their own."""
PARTS, EQUAL_STEPS = 3, 32


class Crossing(NamedTuple):
    """The ends of control intervals."""

    q: Array
    qd: Array
    work: Array  # J
    z: Array  # states of effects
    numerics: NDArray[np.int8]  # flags

    @property
    def good(self) -> NDArray[np.bool_]:
        return self.numerics == 0


def crossed(scene: Scene, q: Array, qd: Array, efforts: Array, parts: int = 1) -> Crossing:
    """A control interval by dop853, whole or in parts."""
    exact = dataclasses.replace(scene, integrator="dop853", substeps=1, tolerance=None)
    return moved(exact, q, qd, efforts, parts)


def moved(scene: Scene, q: Array, qd: Array, efforts: Array, parts: int = 1) -> Crossing:
    """A control interval under constant efforts, in equal parts."""
    batch = BatchSimulator(scene, len(q), track_work=True)
    batch.set_state(q, qd)
    numerics = np.zeros(len(q), np.int8)
    for _ in range(parts):
        numerics |= batch.advance_partly(efforts, scene.control_dt / parts).numerics
    return Crossing(batch.q, batch.qd, batch.work, batch.z, numerics)


def own_interval(trial: Sample) -> Crossing:
    """The interval by the scene's own steps."""
    return moved(trial.scene, *trial.states)


def exact_in_parts(trial: Sample) -> Crossing:
    """The same with other steps: equal ones if updates at the end or an instant forbid a division."""
    updated = any(state.update is not None for state in trial.scene.states().values())
    if not updated and not trial.scene.attached.instants:
        return crossed(trial.scene, *trial.states, PARTS)
    substeps = EQUAL_STEPS * trial.scene.substeps
    fine = dataclasses.replace(trial.scene, integrator="rk8", substeps=substeps, tolerance=None)
    return moved(fine, *trial.states)


def energy_changes(scene: Scene, q: Array, qd: Array, end: Crossing) -> tuple[Array, Array, Array]:
    """Change of kinetic + potential - work, exchanged energies, stored energies; (n,) each, J."""
    kinetic = kinetic_energy(scene, q, qd), kinetic_energy(scene, end.q, end.qd, end.z)
    potential = potential_energy(scene, q), potential_energy(scene, end.q, end.z)
    gained = potential[1] - potential[0]
    scale = kinetic[0] + kinetic[1] + np.abs(gained) + np.abs(end.work)
    stored = np.abs(potential[0]) + np.abs(potential[1])
    return kinetic[1] - kinetic[0] + gained - end.work, scale, stored


def by_rounding(scene: Scene, q: Array) -> Array:
    """Change of the potential energy if each coordinate is off by its rounding, (n,), J."""
    nudges = ROUNDING * np.eye(q.shape[1])
    here = potential_energy(scene, q)
    return np.sum([np.abs(potential_energy(scene, q + nudge * q) - here) for nudge in nudges], axis=0)


@check("energy book", at_most(OPEN))
def energy_book(trial: Sample) -> Finding:
    """Kinetic + potential - work is constant over a control interval, or over a shorter one that is calm for
    half of the states, in units of the energies involved."""
    q, qd, _ = trial.states
    whole, parts = (crossed(trial.calm_scene, *trial.states, n) for n in (1, PARTS))
    change, scale, stored = energy_changes(trial.scene, q, qd, whole)
    other = energy_changes(trial.scene, q, qd, parts)[0]
    noise = ROUNDING * stored + by_rounding(trial.scene, q)
    judged = whole.good & parts.good & ~(np.abs(change - other) > SAME * OPEN * scale + noise)
    if np.mean(judged) < ENOUGH_SMOOTH:
        words = "energy: too few intervals could be simulated accurately to judge the scene by"
        return Finding(np.inf, f"{np.mean(judged):.0%} of the states judged", words)
    relative = np.where(judged, ratio(np.maximum(np.abs(change) - noise, 0.0), scale), 0.0)
    joules = np.abs(change[judged]).max()
    words = (
        f"energy: kinetic + potential - work changes by up to {joules:.3g} J in a control interval, {{:.1e}} "
        "of the energies at hand: check potential and conservative of the effects"
    )
    return trial.finding(relative, words)


ADRIFT = 1e-9
"""Largest change of a momentum, in units of the sum of the sizes of its parts: forty times the error of
dop853 over a control interval, as for the energy balance."""
MOVE, RIGID = 0.5, 1e-9
"""If a joint moves the whole arm by the first number, rad or m, its inertia changes by at most the second."""


@check("momentum", at_most(ADRIFT))
def momentum(trial: Sample) -> Finding:
    """Without a field, and with motors at all joints but the first, the momentum along that is kept: it turns
    the whole arm about the base, or slides it, which changes no inertia."""
    (q, qd, efforts), robot = trial.states, trial.scene.robot
    turned = slopes(robot, numbered("phi{}", len(robot.joints)), q[:1])[0]
    base = np.linalg.inv(turned)[:, 0]  # coordinates per unit of the first joint
    e, added = trial.shared(from_points), added_inertia(trial)
    elsewhere = equations_at(trial.arm, added, q + MOVE * base)
    change = ratio(elsewhere.M - e.M, e.scale[:, :, None] * e.scale[:, None, :])
    if not change.max() <= RIGID:
        raise NotApplicable("the first joint moves the masses against each other")
    others = {a.key for a in trial.scene.attached if not isinstance(a.hook, PointMass | Inertia)}
    kept = tuple(x for x in trial.scene.effects if x.key not in others)
    scene = Scene(robot, kept, control_dt=trial.calm_scene.control_dt)
    forces = np.where(np.arange(q.shape[1]) == 0, 0.0, efforts)
    end = crossed(scene, q, qd, forces)
    after = equations_at(trial.arm, added, end.q)
    ends = (e, qd), (after, end.qd)
    before, then = ((at.M * base * rates[:, :, None]).reshape(len(q), -1) for at, rates in ends)
    good = end.good & np.isfinite(then).all(axis=1)
    enough(good, "too few motions without a field could be simulated to rounding")
    size = np.maximum(np.abs(before).sum(axis=1), np.abs(then).sum(axis=1))
    change = np.where(good, then.sum(axis=1) - before.sum(axis=1), 0.0)
    gaps = np.where(good, ratio(change, size), 0.0)
    words = "the momentum about the base changes by {:.1e} of its parts without a moment there"
    return trial.finding(gaps, f"{trial.arm.kind}: {words}: M, h or Q is wrong")
