"""Promises about motions: they keep their tolerance or are flagged, and their energy balances close.

References for a control interval are the same scene in many equal steps.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

import redundant_envs as rde
from redundant_envs.effects.hooks import Force
from redundant_envs.model import parameters
from redundant_envs.model.energy import scene_quantities
from redundant_envs.tasks.base import hard_stops
from redundant_envs.verify.judging import agree, judge

from .playing import lanes_now

FINE = ((96, 160), (1536, 2560))
"""Steps per control interval of the two references; more of both for lanes where they do not agree."""
FINE_ACROSS_KINKS = ((1536, 2560, 4297), (12288, 20483, 34381))
"""Where a force changes its law errors depend on where a step meets the change: of 96 and 160 steps both were
off by three tolerances, and by the same."""
MANY_STEPS, MAX_STEPS = 40_000, 400_000
"""Steps of a control interval for lanes whose references may be wrong, or whose balance is not closed yet."""
NO_TOLERANCE = 1e-9
"""The tolerance of scenes that have none, in units of the arm's length."""
ENERGY, KINKED_ENERGY = 1e-5, 1e-3
"""An energy balance that is off by less is closed, in units of the exchanged energies: impacts cost equal
steps a few 1e-8. With limit springs equal steps across the jump of a stiffness are of second order."""
COARSE_ENERGY, SMALL = 1e-3, 1e-6
"""The same for a scene at its own tolerance, if that is :data:`SMALL` arm lengths or less."""
ROUNDING = 1e-8
"""Differences of energies are accurate to this share of the energies, times :data:`ENERGY`."""
CONVERGING = 0.5
"""A balance whose error is less than this share of the coarser reference's is still converging."""


class Judged(NamedTuple):
    """An interval of some lanes, and its references."""

    call: int
    step: Any
    lanes: Any  # numbers of the lanes
    before: dict
    after: dict
    agreed: Any  # lanes whose references agree
    finer: dict
    coarser: dict


def tolerance_is_kept_or_flagged(played):
    """The tip of an unflagged interval is off by less than twice the tolerance (with dop853 by less than 1e-9
    arm lengths), judged where references agree."""
    scene, tolerance = played.scene, tolerance_of(played.scene)
    for one in played.judgements if promises(scene) else ():
        played.tally["judged"] += int(one.agreed.sum())
        right = tips(scene, one.finer)
        _, missed, error = judge(tips(scene, one.after), [right], tolerance, one.agreed)
        for k in np.flatnonzero(missed):
            # An impact within the first step of both references leaves them the same piece before it.
            finest, _ = fine_interval(scene, one.step, one.lanes[[k]], MANY_STEPS)
            if agree([tips(scene, finest), right[[k]]], tolerance)[0]:
                off = f"the tip is off by {tolerance * error[k]:.3g} m"
                yield one.call, one.lanes[k], f"{off}, the tolerance is {tolerance:.3g} m"


def the_energy_book_closes(played):
    """Kinetic + potential - work stays in the scene itself or in a reference, and in the scene itself to a
    thousandth if its tolerance is small."""
    scene = played.scene
    kinked = any(type(effect).__name__ == "LimitSpring" for effect in scene.effects)
    for one in played.judgements:
        played.tally["books"] += int(one.agreed.sum())
        own, fine, coarse = (drifts(scene, one.before, x) for x in (one.after, one.finer, one.coarser))
        # Rounding grows with the number of steps: a wrong balance is wrong in all three.
        least = np.minimum(np.minimum(own, fine), coarse)
        off = (least > (KINKED_ENERGY if kinked else ENERGY)) & (fine > CONVERGING * coarse)
        if promises(scene) and tolerance_of(scene) <= SMALL * sum(scene.robot.lengths):
            off |= own > COARSE_ENERGY
        for k in np.flatnonzero(one.agreed & off):
            # The energy that fast friction takes may need far more steps than the position of the tip.
            here = rows(one.before, [k])
            finest = (fine_interval(scene, one.step, one.lanes[[k]], n)[0] for n in (MANY_STEPS, MAX_STEPS))
            if not any(drifts(scene, here, end)[0] <= CONVERGING * fine[k] for end in finest):
                text = f"kinetic + potential - work drifts by {own[k]:.3g} of the energies exchanged"
                yield one.call, one.lanes[k], f"{text}, in references by {coarse[k]:.3g} and {fine[k]:.3g}"


def judgements(played):
    """Intervals with lanes that can be computed again, and what references say of them."""
    for k, step in played.intervals():
        lanes = np.flatnonzero(can_be_judged(played.scene, step) & (step.told["numerics"] == 0))
        if len(lanes):
            ends = (rows(step.before, lanes), rows(step.after, lanes))
            yield Judged(k, step, lanes, *ends, *referred(played.scene, step, lanes))


def can_be_judged(scene, step):
    """Lanes whose interval can be computed again: all numbers finite, and sliders between their stops."""
    before, values = step.before, values_of(scene, step.before)
    arrays = (before["q"], before["qd"], before["z"], before["work"][:, None], step.call["efforts"])
    possible = np.logical_and.reduce([np.isfinite(a).all(axis=1) for a in arrays])
    for stop in stops_of(scene, before["q"], values):
        possible &= ~stop.beyond
    return possible


class Stop(NamedTuple):
    """A joint between hard stops, in many lanes; m, or rad."""

    joint: int
    positions: np.ndarray
    lower: Any
    upper: Any
    rounding: Any  # by which an angle, a difference of coordinates, may be beyond an end: 4 ulp

    @property
    def beyond(self):
        return (self.positions < self.lower - self.rounding) | (self.positions > self.upper + self.rounding)


def stops_of(scene, q, values):
    """Joints with hard stops at coordinates, (lanes, joints)."""
    for joint, low, high in hard_stops(scene):
        lower, upper = values[low], values[high]
        if scene.robot.prismatic[joint]:
            yield Stop(joint, q[:, joint], lower, upper, 0.0)
            continue
        ends = [np.where(np.isfinite(end), np.abs(end), 0.0) for end in (lower, upper)]
        with np.errstate(all="ignore"):
            parts = q[:, scene.robot.motor_map[:, joint] != 0.0]
            sizes = np.maximum(np.abs(parts).max(axis=1), np.maximum(*ends))
            yield Stop(joint, q @ scene.robot.motor_map[:, joint], lower, upper, 4.0 * np.spacing(sizes))


def referred(scene, step, lanes):
    """Lanes whose references agree, and the lanes at the end of the finer and of the coarser one."""
    left, done, ends = np.arange(len(lanes)), np.zeros(len(lanes), np.bool_), None
    kinked = any(a.law for a in scene.attached.of(Force))
    for steps in FINE_ACROSS_KINKS if kinked else FINE:
        if not len(left):
            break
        found, flags = zip(*(fine_interval(scene, step, lanes[left], n) for n in steps), strict=True)
        within = agree([tips(scene, end) for end in reversed(found)], tolerance_of(scene))
        exact = rounding_of(scene, found[-1], steps[-1]) <= tolerance_of(scene)
        done[left] = (np.bitwise_or.reduce(flags) == 0) & within & exact
        ends = ends or (found[-1], found[0])
        for end, new in zip(ends, (found[-1], found[0]), strict=True):
            for name, table in end.items():
                table[left] = new[name]
        left = left[~done[left]]
    return done, *ends


def fine_interval(scene, step, lanes, steps):
    """Lanes after an interval of equal rk8 steps, and their flags."""
    batch = begun(scene, in_equal_steps(scene, steps), rows(step.before, lanes))
    status = advanced(batch, step.call, lanes)
    return lanes_now(batch), status.numerics


def in_equal_steps(scene, steps):
    """The scene in some rk8 steps for each control interval."""
    return dataclasses.replace(scene, integrator="rk8", tolerance=None, substeps=steps)


def begun(scene, other, lanes):
    """A simulator of another scene with the same numbers and states, at the start of an interval of some
    lanes of a scene."""
    count = len(lanes["q"])
    batch = rde.BatchSimulator(other, count, track_work=True)
    parameters.write(other, batch._memory, np.arange(count), values_of(scene, lanes))
    batch.set_state(lanes["q"], lanes["qd"])
    if batch.z.size:
        columns = [list(scene.states()).index(name) for name in other.states()]
        batch._memory.write(tuple(batch.simulator.dynamics.effect_states), lanes["z"][:, columns])
    batch._memory.write(("work",), lanes["work"][:, None])
    if batch.draws.size:
        batch.set_draws(lanes["draws"])
    return batch


def advanced(batch, call, lanes, share=1.0):
    """The status of some lanes after a call that advances them, with a share of its efforts."""
    duration = () if call["call"] == "advance" else (call["duration"],)
    return getattr(batch, call["call"])(share * call["efforts"][lanes], *duration)


def rows(lanes, chosen):
    return {name: table[chosen] for name, table in lanes.items()}


def values_of(scene, lanes):
    """Parameter name -> its value in each lane."""
    return {name: lanes["values"][:, k] for k, name in enumerate(scene.parameters())}


def promises(scene):
    return scene.tolerance is not None or scene.integrator == "dop853"


def tolerance_of(scene):
    """m."""
    return scene.tolerance if scene.tolerance is not None else NO_TOLERANCE * sum(scene.robot.lengths)


def quantities(scene, lanes):
    """Quantities of the scene, with each lane's own numbers."""
    values, states = values_of(scene, lanes), dict(zip(scene.states(), lanes["z"].T, strict=True))
    values |= scene.attached.moving_masses(values, states)
    return scene_quantities(scene, lanes["q"], lanes["qd"], values)


def tips(scene, lanes):
    """(num_envs, 2), m."""
    return np.stack(quantities(scene, lanes).each(("tip_x", "tip_y")), axis=1)


def rounding_of(scene, lanes, steps):
    """Largest error of the tip by rounding, in a number of steps that all round the same way, m."""
    own, slides = values_of(scene, lanes), list(scene.loaded_robot.sliders())
    size = np.sum([own[name] for name in own if "." not in name and name.startswith("l")], axis=0)
    size = size + np.abs(lanes["q"][:, slides]).sum(axis=1)
    angles = np.abs(np.delete(lanes["q"], slides, axis=1)).max(axis=1, initial=1.0)
    return np.asarray(steps * np.finfo(np.float64).eps * size * angles)


def energies(scene, lanes):
    """Kinetic and potential energy of each lane, J."""
    x = quantities(scene, lanes)
    springs = [a.functions["potential"](x) for a in scene.attached if "potential" in a.functions]
    return x["T"], x["U"] + sum(springs)


def drifts(scene, before, after):
    """Drift of kinetic + potential - work, in units of the exchanged energies."""
    (kinetic, potential), (kinetic_after, potential_after) = (energies(scene, x) for x in (before, after))
    work, gained = after["work"] - before["work"], potential_after - potential
    rounding = ROUNDING * (np.abs(potential) + np.abs(after["work"]))
    for k in range(before["q"].shape[1]):  # each coordinate is off by a share of itself
        q = before["q"].copy()
        q[:, k] *= 1.0 + ROUNDING
        rounding += np.abs(energies(scene, before | {"q": q})[1] - potential)
    scale = np.maximum(kinetic, kinetic_after) + np.abs(gained) + np.abs(work) + rounding
    drift = np.abs(kinetic_after - kinetic + gained - work)
    return np.where(drift == 0.0, 0.0, drift / scale)
