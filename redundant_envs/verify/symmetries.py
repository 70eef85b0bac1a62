"""Is a motion reversible, and does it scale as mechanics requires?"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from redundant_envs.effects import Gravity
from redundant_envs.effects.hooks import Field, Force, Hook, Inertia, PointMass
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, Scene
from redundant_envs.verify.checks import Array, Sample, check, enough
from redundant_envs.verify.promises import EQUAL_BITS, Finding, Mode, NotApplicable, at_most

BACK = at_most(1e-9, "rad or reaches")
"""Distance after a calm motion there and back by dop853: ten thousand times the error of that."""


@check("time reversal", BACK, Mode.STANDARD)
def time_reversal(trial: Sample) -> Finding:
    """With reversed velocities an arm returns to its start, under the same efforts, and with those effects of
    the scene that conserve energy and depend on the position alone."""
    q, qd, efforts = trial.states

    def conserves(h: Hook) -> bool:
        of_force = isinstance(h, Force) and h.conservative is h.function and not h.states
        return of_force or isinstance(h, PointMass | Inertia) or (isinstance(h, Field) and not h.states)

    others = {a.key for a in trial.scene.attached if not conserves(a.hook)}
    kept = tuple(x for x in trial.scene.effects if x.key not in others)
    seconds = trial.calm_scene.control_dt
    scene = Scene(trial.scene.robot, kept, "dop853", seconds, actuation=trial.scene.actuation)
    batch = BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    good = batch.advance(efforts).numerics == 0
    batch.set_state(batch.q, -batch.qd)
    good = good & (batch.advance(efforts).numerics == 0) & (trial.calm >= seconds)
    enough(good, "too few motions could be simulated to rounding", 0.25)
    reach = np.linalg.norm(trial.arm.points(q), axis=2).max()
    unit = np.where(trial.arm.prismatic, reach, 1.0)
    gaps = np.where(good[:, None], np.abs((batch.q - q) @ trial.arm.motor_map) / unit, 0.0)
    words = (
        "a motion there and back ends {:.1e} from where it began: a force of the motion itself changes "
        "its sign with the velocities, or a force that is said to follow from the position does not"
    )
    return trial.finding(gaps, words)


INTERVALS = 2
"""With more steps a motion that is too fast for its step could become infinite, which does not scale."""


def _moved(arm: Any, seconds: float, q: Array, qd: Array, efforts: Array) -> Array:
    """Joint positions and rates after some steps of rk8 under 8 m/s^2."""
    batch = BatchSimulator(Scene(arm, (Gravity(8.0),), "rk8", seconds), len(q))
    batch.set_state(q, qd)
    for _ in range(INTERVALS):
        batch.advance(efforts)
    return np.concatenate([batch.q, batch.qd], axis=1)


def _differ(trial: Sample, one: Array, other: Array, words: str) -> Finding:
    """The number of lanes that are finite and differ."""
    sound = np.isfinite(np.concatenate([one, other], axis=1)).all(axis=1)
    enough(sound, "too few motions stay finite at the scene's own step")
    differs = np.asarray((one != other) & sound[:, None]).reshape(len(one), 2, -1)
    by_joint = differs.any(axis=1).astype(float)
    lanes = int(by_joint.any(axis=1).sum())
    return Finding(lanes, trial.worst(by_joint)[1] if lanes else "", words)


def _step(trial: Sample) -> float:
    """The scene's own step, s, rounded to a power of two that scales to the last bit and allows twice it."""
    own = trial.scene.control_dt / trial.scene.substeps
    return float(2.0 ** np.floor(np.log2(np.clip(own, 2.0 * SHORTEST_INTERVAL, 0.5 * LONGEST_INTERVAL))))


@check("scaling of masses", EQUAL_BITS, Mode.STANDARD)
def scaling_of_masses(trial: Sample) -> Finding:
    """Four times the masses and forces give the same motion: a power of two changes no digit."""
    arm = trial.scene.robot
    q, qd, efforts = trial.states
    heavy = dataclasses.replace(arm, masses=tuple(4.0 * m for m in arm.masses))
    _check_numbers(arm, heavy, "m", 4.0)
    one = _moved(arm, _step(trial), q, qd, efforts)
    other = _moved(heavy, _step(trial), q, qd, 4.0 * efforts)
    words = f"{arm.kind}: four times the masses and forces make another motion: a term lacks its mass"
    return _differ(trial, one, other, words)


@check("scaling of lengths and time", EQUAL_BITS, Mode.STANDARD)
def scaling_of_lengths(trial: Sample) -> Finding:
    """Four times the lengths in twice the time are the same motion, under the same gravity."""
    arm = trial.scene.robot
    q, qd, efforts = trial.states
    long = dataclasses.replace(arm, lengths=tuple(4.0 * x for x in arm.lengths))
    _check_numbers(arm, long, "l", 4.0)
    slides = np.array(arm.prismatic)
    if not np.array_equal(q[:1] @ arm.motor_map * slides, q[:1] * slides):
        raise NotApplicable("coordinates mix lengths and angles")
    size, speed = np.where(slides, 4.0, 1.0), np.where(slides, 2.0, 0.5)
    force = np.where(slides, 1.0, 4.0)
    one = _moved(arm, _step(trial), q, qd, efforts)
    other = _moved(long, 2.0 * _step(trial), q * size, qd * speed, efforts * force)
    words = f"{arm.kind}: four times the lengths in twice the time are another motion: a term lacks a length"
    return _differ(trial, one, other / np.concatenate([size, speed]), words)


def _check_numbers(arm: Any, scaled: Any, letter: str, factor: float) -> None:
    """NotApplicable if an arm has parameters beside masses and lengths, which would have to be scaled."""
    before, after = arm.parameter_values(), scaled.parameter_values()
    others = [name for name in before if not (name[0] in "ml" and name[1:].isdigit())]
    if others:
        raise NotApplicable(f"the arm has {', '.join(others)} beside masses and lengths")
    assert all(after[n] == v * (factor if n[0] == letter else 1.0) for n, v in before.items())
