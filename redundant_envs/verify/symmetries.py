"""Is a motion reversible, and does it scale as mechanics requires?"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.effects import Gravity
from redundant_envs.effects.hooks import Field, Force, Hook, Inertia, PointMass
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, Scene
from redundant_envs.verify.checks import Array, Sample, check, enough
from redundant_envs.verify.promises import EQUAL_BITS, Finding, Mode, NotApplicable, at_most

BACK = at_most(1e-9, "rad or reaches")  # ten thousand times the error of dop853, there and back


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
    return trial.finding(gaps, "a motion there and back ends {:.1e} from where it began")


INTERVALS = 2  # with more a motion too fast for its step could become infinite, which does not scale


class Scales(NamedTuple):
    """Factors between two motions that are the same in other units."""

    time: float
    q: Array | float
    qd: Array | float
    efforts: Array | float


def scaled(trial: Sample, field: str, scales: Scales, words: str) -> Finding:
    """The number of lanes that differ, of those that are finite, after some steps of rk8 with four times the
    masses or lengths. The step is the scene's own, rounded to a power of two, which changes no digit."""
    arm: Any = trial.scene.robot
    other = dataclasses.replace(arm, **{field: tuple(4.0 * x for x in getattr(arm, field))})
    before, after = arm.parameter_values(), other.parameter_values()
    if more := [name for name in before if not (name[0] in "ml" and name[1:].isdigit())]:
        raise NotApplicable(f"the arm has {', '.join(more)} beside masses and lengths")
    assert all(after[n] == v * (4.0 if n[0] == field[0] else 1.0) for n, v in before.items())
    own = trial.scene.control_dt / trial.scene.substeps
    step = float(2.0 ** np.floor(np.log2(np.clip(own, 2.0 * SHORTEST_INTERVAL, 0.5 * LONGEST_INTERVAL))))
    (q, qd, efforts), ends = trial.states, []
    for moving, by in ((arm, Scales(1.0, 1.0, 1.0, 1.0)), (other, scales)):
        batch = BatchSimulator(Scene(moving, (Gravity(8.0),), "rk8", by.time * step), len(q))
        batch.set_state(q * by.q, qd * by.qd)
        for _ in range(INTERVALS):
            batch.advance(efforts * by.efforts)
        ends.append(np.stack([batch.q / by.q, batch.qd / by.qd], axis=1))
    sound: Array = np.isfinite(ends).all(axis=(0, 2, 3))  # type: ignore[assignment]
    enough(sound, "too few motions stay finite at the scene's own step")
    by_joint = ((ends[0] != ends[1]).any(axis=1) & sound[:, None]).astype(float)
    lanes = int(by_joint.any(axis=1).sum())
    return Finding(lanes, trial.worst(by_joint)[1] if lanes else "", f"{arm.kind}: {words}")


@check("scaling of masses", EQUAL_BITS, Mode.STANDARD)
def scaling_of_masses(trial: Sample) -> Finding:
    """Four times the masses and forces give the same motion."""
    words = "four times the masses and forces make another motion: a term lacks its mass"
    return scaled(trial, "masses", Scales(1.0, 1.0, 1.0, 4.0), words)


@check("scaling of lengths and time", EQUAL_BITS, Mode.STANDARD)
def scaling_of_lengths(trial: Sample) -> Finding:
    """Four times the lengths in twice the time are the same motion, under the same gravity."""
    q, slides = trial.states[0][:1], np.array(trial.scene.robot.prismatic)
    if not np.array_equal(q @ trial.scene.robot.motor_map * slides, q * slides):
        raise NotApplicable("coordinates mix lengths and angles")
    factors = np.where(slides, 4.0, 1.0), np.where(slides, 2.0, 0.5), np.where(slides, 1.0, 4.0)
    words = "four times the lengths in twice the time are another motion: a term lacks a length"
    return scaled(trial, "lengths", Scales(2.0, *factors), words)
