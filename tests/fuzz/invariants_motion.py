"""Promises about motions: they keep their tolerance or are flagged, and their energy balances close."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scene import Scene
from redundant_envs.tasks.limits import hard_stops
from redundant_envs.verify.judging import agree, judge

from .cases import Array, numbers
from .played import Played, Violation
from .playing import Lanes, Step
from .references import (
    Judgement,
    energies,
    fine_interval,
    judged,
    lane_parameters,
    of_lanes,
    tips,
    tolerance_of,
)

ENERGY = 1e-5
"""An energy balance that is off by less is closed, in units of the exchanged energies: impacts cost equal
steps a few 1e-8."""
KINKED_ENERGY = 1e-3
"""The same with limit springs: equal steps across the jump of a stiffness are of second order."""
COARSE_ENERGY = 1e-3
"""The same for a scene at its own tolerance, if that is :data:`SMALL` arm lengths or less."""
SMALL = 1e-6
ROUNDING = 1e-8
"""Differences of energies are accurate to this share of the energies, times :data:`ENERGY`."""
CONVERGING = 0.5
"""A balance whose error is less than this share of the coarser reference's is still converging."""
MANY_STEPS, MOST_STEPS = 40_000, 400_000
"""Steps of a control interval for lanes whose references may be wrong, or whose balance is not closed yet."""


def can_be_judged(scene: Scene, step: Step) -> Any:
    """Lanes whose interval can be computed again: all numbers finite, and sliders between their stops."""
    efforts = numbers(step.call["efforts"])
    arrays = (step.before.q, step.before.qd, step.before.z, step.before.work[:, None], efforts)
    possible = np.logical_and.reduce([np.isfinite(a).all(axis=1) for a in arrays])
    values = lane_parameters(scene, step.before)
    for joint, low, high in hard_stops(scene):
        x = step.before.q[:, joint]
        possible &= (x >= values[low]) & (x <= values[high])
    return possible


def tolerance_and_energies(played: Played) -> list[Violation]:
    """An interval keeps its tolerance, or is flagged; kinetic + potential - work stays.

    Both are judged where two references agree: the tip is off by less than twice the tolerance (with dop853
    by less than 1e-9 arm lengths); the energy book closes in the scene itself or in a reference, and in the
    scene itself to a thousandth if its tolerance is small.
    """
    scene, found = played.scene, []
    promised = scene.tolerance is not None or scene.integrator == "dop853"
    for k, step in played.intervals():
        lanes = np.flatnonzero(can_be_judged(scene, step) & (step.status["numerics"] == 0))
        if not len(lanes):
            continue
        judgement = judged(scene, step, lanes)
        count = int(judgement.agreed.sum())
        played.tally.judged += count if promised else 0
        played.tally.books += count
        if promised:
            missed = missed_tolerances(scene, step, lanes, judgement)
            found += [Violation("tolerance_is_kept_or_flagged", k, *each) for each in missed]
        books = open_books(scene, step, lanes, judgement, promised)
        found += [Violation("the_energy_book_closes", k, *each) for each in books]
    return found


def missed_tolerances(
    scene: Scene, step: Step, lanes: NDArray[np.intp], judgement: Judgement
) -> Iterator[tuple[int, str]]:
    """Lanes whose tip is off, and by how much."""
    tolerance = tolerance_of(scene)
    right = tips(scene, judgement.finer)
    _, missed, error = judge(tips(scene, of_lanes(step.after, lanes)), [right], tolerance, judgement.agreed)
    for k in np.flatnonzero(missed):
        # An impact within the first step of both references leaves them the same piece before it.
        finest, _ = fine_interval(scene, step, lanes[[k]], MANY_STEPS)
        if agree([tips(scene, finest), right[[k]]], tolerance)[0]:
            off = f"the tip is off by {tolerance * error[k]:.3g} m"
            yield int(lanes[k]), f"{off}, the tolerance is {tolerance:.3g} m"


def open_books(
    scene: Scene, step: Step, lanes: NDArray[np.intp], judgement: Judgement, promised: bool
) -> Iterator[tuple[int, str]]:
    """Lanes whose energy balance is not closed, and the gap."""
    robot: Any = scene.robot
    before = of_lanes(step.before, lanes)
    ends = (of_lanes(step.after, lanes), judgement.finer, judgement.coarser)
    own, fine, coarse = (drifts(scene, before, end) for end in ends)
    # Rounding grows with the number of steps: a wrong balance is wrong in all three.
    least = np.minimum(np.minimum(own, fine), coarse)
    kinked = any(type(effect).__name__ == "LimitSpring" for effect in scene.effects)
    off = (least > (KINKED_ENERGY if kinked else ENERGY)) & (fine > CONVERGING * coarse)
    if promised and tolerance_of(scene) <= SMALL * sum(robot.lengths):
        off |= own > COARSE_ENERGY
    for k in np.flatnonzero(judgement.agreed & off):
        # The energy that fast friction takes may need far more steps than the position of the tip.
        here = of_lanes(before, np.array([k]))
        finest = (fine_interval(scene, step, lanes[[k]], n)[0] for n in (MANY_STEPS, MOST_STEPS))
        if not any(drifts(scene, here, end)[0] <= CONVERGING * fine[k] for end in finest):
            text = (
                f"kinetic + potential - work drifts by {own[k]:.3g} of the energies exchanged, in the "
                f"references by {coarse[k]:.3g} and {fine[k]:.3g}"
            )
            yield int(lanes[k]), text


def drifts(scene: Scene, before: Lanes, after: Lanes) -> Array:
    """Drift of kinetic + potential - work, in units of the exchanged energies."""
    (kinetic, potential), (kinetic_after, potential_after) = (energies(scene, x) for x in (before, after))
    with np.errstate(all="ignore"):
        work, gained = after.work - before.work, potential_after - potential
        rounding = ROUNDING * (np.abs(potential) + np.abs(after.work)) + rounding_of_places(scene, before)
        scale = np.maximum(kinetic, kinetic_after) + np.abs(gained) + np.abs(work) + rounding
        drift = np.abs(kinetic_after - kinetic + gained - work)
        return np.where(drift == 0.0, 0.0, drift / scale)


def rounding_of_places(scene: Scene, lanes: Lanes) -> Array:
    """Change of the potential energy if each coordinate is off by :data:`ROUNDING` of itself, J."""
    _, potential = energies(scene, lanes)
    total = np.zeros(len(potential))
    for k in range(lanes.q.shape[1]):
        q = lanes.q.copy()
        q[:, k] *= 1.0 + ROUNDING
        total += np.abs(energies(scene, dataclasses.replace(lanes, q=q))[1] - potential)
    return total
