"""Is momentum kept, is a motion reversible, and does it scale as mechanics requires?"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from redundant_envs.effects import Effect, Gravity
from redundant_envs.effects.hooks import Field, Force, Hook, Inertia, PointMass
from redundant_envs.language.algebra import numbered
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import LONGEST_INTERVAL, SHORTEST_INTERVAL, Scene
from redundant_envs.verify.checks import Array, Sample, check, enough, ratio
from redundant_envs.verify.conservation import crossed
from redundant_envs.verify.equations import equations_at, from_points, slopes
from redundant_envs.verify.promises import EQUAL_BITS, Finding, Mode, NotApplicable, at_most

ADRIFT = 1e-9
"""Largest change of a momentum, in units of the sum of the sizes of its parts: forty times the error of
dop853 over a control interval, as for the energy balance."""
MOVE, RIGID = 0.5, 1e-9
"""If a joint moves the whole arm by the first number, rad or m, its inertia changes by at most the second."""
BACK = at_most(1e-9, "rad or reaches")  # ten thousand times the error of dop853, there and back


def effects_with(trial: Sample, fits: Callable[[Hook], bool]) -> tuple[Effect, ...]:
    """The effects of the scene of which all hooks fit."""
    others = {a.key for a in trial.scene.attached if not fits(a.hook)}
    return tuple(x for x in trial.scene.effects if x.key not in others)


@check("momentum", at_most(ADRIFT))
def momentum(trial: Sample) -> Finding:
    """Without a field, and with motors at all joints but the first, the momentum along that is kept: it turns
    the whole arm about the base, or slides it, which changes no inertia."""
    (q, qd, _), efforts, robot = trial.states, trial.joint_efforts, trial.scene.robot
    turned = slopes(robot, numbered("phi{}", len(robot.joints)), q[:1])[0]
    base = np.linalg.inv(turned)[:, 0]  # coordinates per unit of the first joint
    e, elsewhere = trial.shared(from_points), equations_at(trial, q + MOVE * base)
    if not ratio(elsewhere.M - e.M, e.scale[:, :, None] * e.scale[:, None, :]).max() <= RIGID:
        raise NotApplicable("the first joint moves the masses against each other")
    effects = effects_with(trial, lambda h: isinstance(h, PointMass | Inertia))
    scene = Scene(robot, effects, control_dt=trial.calm_scene.control_dt)
    end = crossed(scene, q, qd, np.where(np.arange(q.shape[1]) == 0, 0.0, efforts))
    ends = (e, qd), (equations_at(trial, end.q), end.qd)
    before, then = ((at.M * base * rates[:, :, None]).reshape(len(q), -1) for at, rates in ends)
    good = end.good & np.isfinite(then).all(axis=1)
    enough(good, "too few motions without a field could be simulated to rounding")
    size = np.maximum(np.abs(before).sum(axis=1), np.abs(then).sum(axis=1))
    gaps = np.where(good, ratio(then.sum(axis=1) - before.sum(axis=1), size), 0.0)
    words = "the momentum about the base changes by {:.1e} of its parts without a moment there"
    return trial.finding(gaps, f"{trial.arm.kind}: {words}: M, h or Q is wrong")


@check("time reversal", BACK, Mode.STANDARD)
def time_reversal(trial: Sample) -> Finding:
    """With reversed velocities an arm returns to its start, under the same efforts, and with those effects of
    the scene that conserve energy and depend on the position alone."""

    def conserves(h: Hook) -> bool:
        of_force = isinstance(h, Force) and h.conservative is h.function and not h.states
        return of_force or isinstance(h, PointMass | Inertia) or (isinstance(h, Field) and not h.states)

    (q, qd, _), efforts, seconds = trial.states, trial.joint_efforts, trial.calm_scene.control_dt
    effects = effects_with(trial, conserves)
    scene = Scene(trial.scene.robot, effects, "dop853", seconds, actuation=trial.scene.actuation)
    batch = BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    good = (batch.advance(efforts).numerics == 0) & (trial.calm >= seconds)
    batch.set_state(batch.q, -batch.qd)
    good &= batch.advance(efforts).numerics == 0
    enough(good, "too few motions could be simulated to rounding", 0.25)
    unit = np.where(trial.arm.prismatic, np.linalg.norm(trial.arm.points(q), axis=2).max(), 1.0)
    gaps = np.where(good[:, None], np.abs((batch.q - q) @ trial.arm.motor_map) / unit, 0.0)
    words = (
        "a motion there and back ends {:.1e} from where it began: a force of the motion itself changes "
        "its sign with the velocities, or a force that is said to follow from the position does not"
    )
    return trial.finding(gaps, words)


INTERVALS = 2  # with more a motion too fast for its step could become infinite, which does not scale


def scaled(trial: Sample, field: str, time: float, factors: tuple[Any, Any, Any], words: str) -> Finding:
    """The number of lanes that differ, of those that are finite, after some steps of rk8 with four times the
    masses or lengths. ``factors`` are those of q, qd and efforts. The step is the scene's own, rounded to a
    power of two, which changes no digit."""
    arm: Any = trial.scene.robot
    if more := [name for name in arm.parameter_values() if not (name[0] in "ml" and name[1:].isdigit())]:
        raise NotApplicable(f"the arm has {', '.join(more)} beside masses and lengths")
    other = dataclasses.replace(arm, **{field: tuple(4.0 * x for x in getattr(arm, field))})
    substep = trial.scene.control_dt / trial.scene.substeps
    step = float(2.0 ** np.floor(np.log2(np.clip(substep, 2.0 * SHORTEST_INTERVAL, 0.5 * LONGEST_INTERVAL))))
    (q, qd, _), efforts, ends = trial.states, trial.joint_efforts, []
    for moving, times, (by_q, by_qd, by_effort) in ((arm, 1.0, (1.0, 1.0, 1.0)), (other, time, factors)):
        batch = BatchSimulator(Scene(moving, (Gravity(8.0),), "rk8", times * step), len(q))
        batch.set_state(q * by_q, qd * by_qd)
        for _ in range(INTERVALS):
            batch.advance(efforts * by_effort)
        ends.append(np.stack([batch.q / by_q, batch.qd / by_qd], axis=1))
    sound: Array = np.isfinite(ends).all(axis=(0, 2, 3))  # type: ignore[assignment]
    enough(sound, "too few motions stay finite at the scene's own step")
    by_joint = ((ends[0] != ends[1]).any(axis=1) & sound[:, None]).astype(float)
    lanes = int(by_joint.any(axis=1).sum())
    return Finding(lanes, trial.worst(by_joint)[1] if lanes else "", f"{arm.kind}: {words}")


@check("scaling of masses", EQUAL_BITS, Mode.STANDARD)
def scaling_of_masses(trial: Sample) -> Finding:
    """Four times the masses and forces give the same motion."""
    words = "four times the masses and forces make another motion: a term lacks its mass"
    return scaled(trial, "masses", 1.0, (1.0, 1.0, 4.0), words)


@check("scaling of lengths and time", EQUAL_BITS, Mode.STANDARD)
def scaling_of_lengths(trial: Sample) -> Finding:
    """Four times the lengths in twice the time are the same motion, under the same gravity."""
    q, slides = trial.states[0][:1], np.array(trial.scene.robot.prismatic)
    if not np.array_equal(q @ trial.scene.robot.motor_map * slides, q * slides):
        raise NotApplicable("coordinates mix lengths and angles")
    factors = np.where(slides, 4.0, 1.0), np.where(slides, 2.0, 0.5), np.where(slides, 1.0, 4.0)
    words = "four times the lengths in twice the time are another motion: a term lacks a length"
    return scaled(trial, "lengths", 2.0, factors, words)
