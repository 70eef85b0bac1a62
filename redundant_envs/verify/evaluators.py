"""Do the evaluators of a scene agree: compiled code, NumPy, single numbers, torch?"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import SHORTEST_INTERVAL, Scene
from redundant_envs.simulator.lane.direct import cross_interval, fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.verify.checks import Array, Sample, check, ratio
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, at_most

AGREE = at_most(1e-10)  # of the largest of a kind: joined products round by 1e-15, which impacts amplify
NUDGE, STEADY = 1e-13, 1e-11  # relative change of rates at the start, of states at the end where judged
LANES, SINGLES = 16, 4
MAX_STEPS = 4  # number of equal steps that are compared: without a compiler each takes some milliseconds
MAX_EVALUATIONS = 24 * 12  # most evaluations of a compared lane that chooses its steps


class Ended(NamedTuple):
    """Ends of intervals by compiled code."""

    scene: Scene  # the trial's, with a calm interval of few equal steps
    lanes: Array  # the states of the trial that are compared
    states: Array  # (lanes, 2 joints)
    started: dict[str, Array]  # states of effects, and what their draws follow from, at the start


def compiled(trial: Sample) -> Ended:
    """States at the end of an interval by compiled code, for those whose interval needs few evaluations."""
    calm_scene = trial.calm_scene
    steps = min(calm_scene.substeps, MAX_STEPS)
    seconds = max(calm_scene.control_dt / calm_scene.substeps * steps, SHORTEST_INTERVAL)
    scene = dataclasses.replace(calm_scene, control_dt=seconds, substeps=steps)
    q, qd, efforts = trial.states
    batch = BatchSimulator(scene, len(q), track_work=True)
    dynamics, ends = batch.simulator.dynamics, []
    for rates in (qd * (1.0 + NUDGE), qd):
        batch.set_state(q, rates)
        table = np.concatenate([batch.z, batch.draws], axis=1)
        status = batch.advance(efforts)
        ends.append(np.concatenate([batch.q, batch.qd], axis=1))
    nudged, own_end = ends
    # Steps too long for a stiff scene make any two evaluators differ.
    size = np.abs(own_end).reshape(len(q), 2, -1).max(axis=2).repeat(q.shape[1], axis=1)
    steady = (ratio(nudged - own_end, size) < STEADY).all(axis=1)
    short = (status.evaluations <= MAX_EVALUATIONS) & (trial.calm >= scene.control_dt)
    lanes = np.flatnonzero(short & steady & (status.numerics == 0))[:LANES]
    if not len(lanes):
        reason = f"every interval takes more than {MAX_EVALUATIONS} evaluations, or magnifies rounding"
        raise NotApplicable(reason)
    names = (*dynamics.effect_states, *dynamics.draw_fields)
    return Ended(scene, lanes, own_end[lanes], dict(zip(names, table.T, strict=True)))


def direct(trial: Sample, lanes: Array, convert: Callable[[Array], Any]) -> Array:
    """The same by running the procedures, without compilation, on numbers of another kind."""
    ended = trial.shared(compiled)
    dynamics = Dynamics(ended.scene)
    q, qd, efforts = (x[lanes] for x in trial.states)
    states = dynamics.states[: 2 * q.shape[1]]
    columns = np.concatenate([q, qd, efforts], axis=1).T
    fields = fields_of(dynamics) | {n: convert(x[lanes]) for n, x in ended.started.items()}
    fields |= zip((*states, *dynamics.commands), map(convert, columns), strict=True)
    lane = cross_interval(Interval(dynamics), fields)
    return np.stack([np.broadcast_to(np.asarray(lane[s]), len(lanes)) for s in states], axis=1)


def agreement(trial: Sample, actual: Array, other: str) -> Finding:
    """The largest difference of an evaluator from compiled code."""
    expected = trial.shared(compiled).states[: len(actual)]
    joints = len(trial.arm.joints)
    size = np.abs(expected).reshape(len(expected), 2, joints).max(axis=(0, 2))
    gaps = ratio(actual - expected, np.repeat(size, joints))
    words = f"compiled code and {other} are {{:.1e}} apart after an interval"
    return trial.finding(gaps, words, (*trial.arm.coordinates, *trial.arm.rates))


@check("evaluators: NumPy", AGREE, Mode.STANDARD)
def arrays(trial: Sample) -> Finding:
    """Compiled code and the same procedures on arrays end an interval in the same state."""
    return agreement(trial, direct(trial, trial.shared(compiled).lanes, np.ascontiguousarray), "NumPy")


@check("evaluators: single numbers", AGREE, Mode.STANDARD)
def singles(trial: Sample) -> Finding:
    """Compiled code and the same procedures on single numbers end an interval in the same state."""
    lanes = trial.shared(compiled).lanes[:SINGLES]
    rows = [direct(trial, lanes[k : k + 1], lambda x: np.float64(x[0])) for k in range(len(lanes))]
    return agreement(trial, np.concatenate(rows), "single numbers")


@check("evaluators: torch", AGREE, Mode.FULL)
def tensors(trial: Sample) -> Finding:
    """Compiled code and the same procedures on torch tensors end an interval in the same state."""
    from redundant_envs.compiler.backends.torch import number

    return agreement(trial, direct(trial, trial.shared(compiled).lanes, number), "torch")
