"""Attempts at an interval that instants cut into pieces, under a tolerance.

Each piece is crossed with steps of its own, and judged alone; an error made in a piece grows in those after
it. Where it may grow beyond the tolerance the interval is crossed again, with steps that are all shorter than
the shortest one before: like an interval without instants, whose steps are equal, and judged like it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from redundant_envs.algebra import any_of, logical_not, maximum, minimum, total, where
from redundant_envs.lane import coordinates, jumps
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import Fault
from redundant_envs.lane.memory import SCRATCH, Field, Lane
from redundant_envs.numerics import error_control
from redundant_envs.numerics.error_control import Crossed

BEFORE = "{}_before"
SHORTER = 0.999
"""With steps shorter than the shortest one before, each piece of several steps has at least twice as many."""
OWN = ("error_carried", "shortest_step", "steps_taken")


def fields(dynamics: Dynamics) -> Iterator[Field]:
    """What a lane knows of its attempts."""
    yield Field("attempts", "", "times that the interval was crossed", SCRATCH)
    yield Field("again", "", "the interval has to be crossed again", SCRATCH, truth=True)
    yield Field("longest_step", "s", "longest step allowed in this attempt", SCRATCH)
    yield Field("divisions", "", "steps of the piece", SCRATCH)
    yield Field("shortest_step", "s", "shortest step of pieces with several", SCRATCH)
    yield Field("steps_taken", "", "steps of the pieces before", SCRATCH)
    yield Field("error_carried", "m", "error at the start of the piece", SCRATCH)
    yield Field("unsure", "", "the error of a piece so far may exceed its estimate", SCRATCH, truth=True)
    yield Field("carries_doubt", "", "one did at the start of the piece", SCRATCH, truth=True)
    for q, slides in zip(dynamics.arm.coordinates, dynamics.arm.prismatic, strict=True):
        yield Field(BEFORE.format(q), "m" if slides else "rad", f"{q} after the attempt before", SCRATCH)


def clear(lane: Lane) -> None:
    """Before the first attempt."""
    lane.attempts, lane.longest_step = 0.0, math.inf
    begin(lane)


def begin(lane: Lane) -> None:
    """Before an attempt."""
    lane.piece_end = lane.error = lane.error_carried = lane.steps_taken = 0.0
    lane.divisions, lane.shortest_step = 1.0, math.inf
    lane.unsure = lane.carries_doubt = False


def note(dynamics: Dynamics, lane: Lane) -> None:
    """After a piece, before the next one begins."""
    steps = lane.divisions
    crossed = (lane.piece_end > 0.0) & (lane.h > 0.0)
    length = minimum(lane.shortest_step, lane.h / steps)
    lane.shortest_step = where(crossed & (steps > 1.0), length, lane.shortest_step)
    lane.steps_taken = where(crossed, lane.steps_taken + steps, lane.steps_taken)
    doubts = any_of([steps >= error_control.CHECKED_STEPS, *(lane[name] for name in dynamics.doubts)])
    lane.unsure = lane.unsure | (crossed & doubts)


def carry(lane: Lane, goes_on: Any) -> None:
    """Where a piece begins that has a length: what it takes over from those before."""
    lane.error_carried = where(goes_on, lane.error, lane.error_carried)
    lane.carries_doubt = (goes_on & lane.unsure) | (logical_not(goes_on) & lane.carries_doubt)


def doubt(dynamics: Dynamics, lane: Lane) -> None:
    """After the last piece: whether the lane has to be judged, since an error may have grown over an instant
    or it was so before."""
    note(dynamics, lane)
    impacts = lane.impacts if dynamics.stops else 0.0
    carried = error_control.growth_over_pieces(lane.steps_taken, impacts) * lane.error_carried
    grows = lane.carries_doubt | (carried > lane.tip_tolerance)
    first = lane.attempts == 0.0
    lane.again = ((first & grows) | (logical_not(first) & lane.again)) & (lane.fault == 0.0)
    lane.attempts = lane.attempts + 1.0


def settle(dynamics: Dynamics, lane: Lane) -> None:
    """Whether a lane that has to be judged has crossed the interval; otherwise it begins again."""
    arm, steps, unsure = dynamics.arm, lane.steps_taken, lane.carries_doubt
    norms = zip(coordinates.tip_norms(dynamics, lane), arm.coordinates, strict=True)
    change = total(n * abs(lane[q] - lane[BEFORE.format(q)]) for n, q in norms)
    impacts = lane.impacts if dynamics.stops else 0.0
    kinked = unsure if dynamics.kinks else False
    crossed = Crossed(steps, lane.error, lane.tip_tolerance, change, impacts, unsure, kinked)
    agrees = error_control.growth_allowed(crossed) | error_control.confirmed(crossed)
    lost = total(lane[v] - lane[v] for v in (*arm.coordinates, *arm.rates)) != 0.0  # no finite state
    doubtful = lane.again & ((lane.attempts == 1.0) | logical_not(agrees)) & logical_not(lost)
    last = steps >= error_control.most_steps(impacts)
    lane.fault = where(doubtful & last, float(Fault.TOLERANCE_NOT_REACHED), lane.fault)
    lane.again = doubtful & logical_not(last)
    several = lane.shortest_step < math.inf
    shorter = where(several, SHORTER * lane.shortest_step, 0.5 * lane.interval / maximum(steps, 1.0))
    lane.longest_step = where(lane.again, shorter, lane.longest_step)
    lane.copy(arm.coordinates, to=BEFORE)
    _return_to_start(dynamics, lane)


def _return_to_start(dynamics: Dynamics, lane: Lane) -> None:
    """Where the interval has to be crossed again: the lane as it was before its first piece."""
    names = (*dynamics.kept, *dynamics.counted, "error", "piece_end", *dynamics.passed, *OWN)
    after = lane.get(names)
    lane.copy(dynamics.kept, of=dynamics.origin)
    lane.set((*dynamics.counted, *dynamics.passed), [0.0] * len((*dynamics.counted, *dynamics.passed)))
    begin(lane)
    jumps.strike(dynamics, lane)
    for name, value in zip(names, after, strict=True):
        lane[name] = where(lane.again, lane[name], value)
