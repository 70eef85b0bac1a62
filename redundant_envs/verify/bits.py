"""Are bits independent of the batch, the index in it, neighbours, threads, copies and snapshots?"""

import contextlib
import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np

from redundant_envs.model.batch import BatchSimulator, draws_of
from redundant_envs.verify.checks import Array, Sample, check
from redundant_envs.verify.promises import EQUAL_BITS, Finding, Mode

LANES = np.arange(67)  # eight full blocks of lanes, and one that is not full
INTERVALS = range(3)


def batch_of(trial: Sample, lanes: Array = LANES, threads: int = 1) -> BatchSimulator:
    """A batch whose lanes have the states with these indices, in this order."""
    q, qd, _ = trial.states
    batch = BatchSimulator(trial.scene, len(lanes), threads, track_work=True)
    if batch.simulator.dynamics.draws:  # those of a lane follow it to another index
        batch.set_draws(draws_of(0, lanes))
    batch.set_state(q[lanes % len(q)], qd[lanes % len(q)])
    return batch


def run(trial: Sample, batch: Any, lanes: Array = LANES, steps: Any = INTERVALS, without: Any = ()) -> Array:
    """Numbers of some intervals as whole ones, which show every bit, (lanes, ...), under efforts of the
    states, or NaN for those ``without``."""
    tables = []
    for step in steps:
        efforts = np.roll(trial.states[2], step, axis=0)[lanes % trial.count]
        efforts[np.asarray(without, int)] = np.nan
        batch.advance(efforts)
        tables += [batch.q, batch.qd, batch.z, batch.work[:, None]]
    table = np.concatenate(tables, axis=1)
    table[np.isnan(table)] = np.nan  # one of many
    return table.view(np.int64)


def alone(trial: Sample) -> Array:
    """The bits that all others are compared with."""
    return run(trial, batch_of(trial))


def differing(trial: Sample, bits: Array, what: str, lanes: Array = LANES) -> Finding:
    """Number of lanes whose bits differ from those of the same states in :func:`alone`."""
    other = (bits != trial.shared(alone)[lanes]).any(axis=1)
    count = int(other.sum())
    where = f"state {lanes[int(np.argmax(other))]}" if count else ""
    return Finding(count, where, f"{count} of {len(lanes)} lanes have other bits {what}")


@check("bits: batch, place and threads", EQUAL_BITS)
def place(trial: Sample) -> Finding:
    """A lane has the same bits at another index, in batches of 1, of 8 and of 9, and with more threads."""
    order = np.random.default_rng(trial.seed).permutation(LANES)
    orders, threads = (order, order[:1], order[1:9], order[9:18], LANES, LANES), (1, 1, 1, 1, 2, 3)
    runs = [run(trial, batch_of(trial, *how), how[0]) for how in zip(orders, threads, strict=True)]
    what = "at another index or batch size, or with more threads"
    return differing(trial, np.concatenate(runs), what, np.concatenate(orders))


@check("bits: neighbours", EQUAL_BITS)
def neighbours(trial: Sample) -> Finding:
    """A lane has the same bits beside others, some of which are not finite."""
    batch, lanes, others = batch_of(trial), LANES[::2], LANES[1::2]
    batch.set_state(batch.q[others[::-1]], 1e200 * batch.qd[others], others)
    return differing(trial, run(trial, batch, without=others)[lanes], "beside other neighbours", lanes)


@check("bits: parameters of lanes", EQUAL_BITS, Mode.STANDARD)
def parameters(trial: Sample) -> Finding:
    """Lanes whose own numbers are equal to those of the scene have the same bits."""
    batch, masses = batch_of(trial), np.array(trial.scene.robot.masses)
    batch.set_parameters({"masses": 1.5 * masses}, [0])
    batch.set_parameters({"masses": masses}, [0])
    return differing(trial, run(trial, batch), "with parameters of their own")


def _continued(trial: Sample, remade: Callable[[BatchSimulator], Any], what: str) -> Finding:
    batch = batch_of(trial)
    tables = [run(trial, batch, steps=INTERVALS[:1]), run(trial, remade(batch), steps=INTERVALS[1:])]
    return differing(trial, np.concatenate(tables, axis=1), what)


@check("bits: copies", EQUAL_BITS)
def copies(trial: Sample) -> Finding:
    """A copy, and a pickle of it, continue to the same bits, whatever happens to the original."""

    def copied(batch: BatchSimulator) -> Any:
        clone = copy.deepcopy(batch)
        batch.set_state(0.0 * batch.q + trial.states[0][:1], -batch.qd)
        with contextlib.suppress(pickle.PicklingError, AttributeError, TypeError):  # of what a user has made
            clone = pickle.loads(pickle.dumps(clone))
        return clone

    return _continued(trial, copied, "in a copy")


@check("bits: snapshots", EQUAL_BITS)
def snapshots(trial: Sample) -> Finding:
    """A snapshot is restored by a batch that has advanced, and by a new one with other numbers."""

    def restored(batch: BatchSimulator) -> BatchSimulator:
        snapshot = batch.save()
        batch.advance(-trial.states[2][LANES % trial.count])
        batch.restore(snapshot)
        return batch

    def taken_over(batch: BatchSimulator) -> BatchSimulator:
        snapshot = batch.save()
        other = batch_of(trial, LANES[::-1])
        other.advance(None)
        other.set_parameters({"masses": 1.5 * np.array(trial.scene.robot.masses)}, [0])
        other.restore(snapshot)
        return other

    findings = [_continued(trial, way, "after a snapshot is restored") for way in (restored, taken_over)]
    return max(findings, key=lambda finding: finding.found)
