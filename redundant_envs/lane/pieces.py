"""Pieces of a control interval: from its start to the first instant of an effect, from there to the next, to
its end.

All lanes take them together, each with its own length; where instants of a lane fall together, or do not
happen, its last pieces have length 0.
"""

from __future__ import annotations

from typing import Any

from redundant_envs.algebra import where
from redundant_envs.effects.attached import RENEWAL
from redundant_envs.lane import attempts, jumps
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import Lane


def goes_on(lane: Lane) -> Any:
    """Whether the present piece of a lane has a length."""
    return lane.h > 0.0


def span(dynamics: Dynamics, lane: Lane) -> Any:
    """What is crossed at once, s: an interval, or the present piece of it."""
    if not dynamics.instants:
        return lane.interval
    substeps = dynamics.scene.substeps
    return lane.h if substeps == 1 else lane.h * float(substeps)


def allowed_error(dynamics: Dynamics, lane: Lane) -> Any:
    """The error that the interval may have at the end of its present piece, m: its tolerance, times the share
    of the interval that is crossed then."""
    if not dynamics.instants:
        return lane.tip_tolerance
    return lane.tip_tolerance * (lane.piece_end / lane.interval)


def clear(dynamics: Dynamics, lane: Lane) -> None:
    """Before an interval: none of it is crossed, and no instant has passed."""
    lane.piece_end = 0.0
    for name in dynamics.passed:
        lane[name] = 0.0


def begin(dynamics: Dynamics, lane: Lane, numbers: dict[str, Any]) -> None:
    """Begin the next piece: let the instants at its start happen, and determine its length; ``numbers`` are
    those that the equations take beside the state."""
    if dynamics.attempts > 1:
        attempts.note(dynamics, lane)
    start, interval = lane.piece_end, lane.interval
    end = interval
    happens: dict[str, Any] = {}
    for a in dynamics.instants:
        time, here = lane[a.instant], lane[a.passed] == 0.0
        happens[a.passed] = here & (time >= 0.0) & (time <= start) & (time < interval)
        end = where((time > start) & (time < end), time, end)
    x = dynamics.quantities(lane.get(dynamics.states), numbers)
    dynamics.guard_values(x, begins=True)  # the laws of the piece before need not hold any more
    for name, value in dynamics.changes(x, RENEWAL, lane).items():
        lane[name] = where(happens[dynamics.renewed[name]], value, lane[name])
    jumps.strike(dynamics, lane, happens)
    for passed, now in happens.items():
        lane[passed] = where(now, 1.0, lane[passed])
    lane.piece_end = end
    length = end - start
    if dynamics.attempts > 1:
        attempts.carry(lane, length > 0.0)
    lane.h = length if dynamics.scene.substeps == 1 else length / float(dynamics.scene.substeps)
    for name in dynamics.doubts:
        lane[name] = False
    if dynamics.logs:
        lane.span_start = start if dynamics.controlled else start - lane.h
