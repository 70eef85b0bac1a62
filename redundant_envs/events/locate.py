"""How a lane finds an event in time: what a trial step shows of it.

A trial step goes to the end of the planned step. If it has an event, trial steps from the same start end ever
nearer to it: this keeps the method's own order, and nothing is interpolated. The last 2e-8 of the planned
step to a stop are a Taylor step, exact to rounding: positions here, velocities when the accelerations there
are known. Sides are 1 at the upper limit, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from redundant_envs.algebra import any_of, logical_not, maximum, minimum, where
from redundant_envs.events.boundary import ROUNDING, BoundedCoordinate, pick
from redundant_envs.events.brackets import Search, Sought, TaylorStep, Trial
from redundant_envs.events.crossings import Crossing, Overshoot, most_pull
from redundant_envs.events.first_event import Encounter, Event
from redundant_envs.tracing.ways import branches

TOGETHER_SHARE = 1e-13
"""Fraction of the control interval: impacts of two coordinates that are no farther apart count as one impact
of both. So the result does not depend on the number of steps in an interval."""


class Aim(NamedTuple):
    """An event that may be sought from now on.

    Attributes
    ----------
    exists : whether there is one
    chosen : for each boundary, whether the event is there; by default it is the first
    target, side : number of the boundary, and side of the limit
    turns : whether it is a turn
    h : length of the first trial step towards it, s
    """

    exists: Any
    chosen: list[Any]
    target: Any
    side: Any
    turns: Any
    h: Any


def earliest_event(trial: Trial) -> Aim:
    """The first event of all boundaries in a step to the end of the planned one."""
    time, chosen = trial.events[0].time, [True]
    for event in trial.events[1:]:
        sooner = event.time < time
        chosen = [*(other & logical_not(sooner) for other in chosen), sooner]
        time = where(sooner, event.time, time)
    free = pick(chosen, [e.motion.free for e in trial.encounters])
    return Aim(
        exists=time <= trial.h, chosen=chosen,
        target=pick(chosen, [e.number for e in trial.encounters]),
        side=pick(chosen, [event.side for event in trial.events]),
        turns=pick(chosen, [event.turns for event in trial.events]) & free,
        h=minimum(maximum(time, 0.0), trial.h),
    )  # fmt: skip


@branches
def came_before(trial_h: Any, left: Any, low: Any, e: Encounter, event: Event) -> Any:
    """Whether an event came before the end of a trial step.

    Parameters
    ----------
    trial_h, left : length of the step, and of the planned one, s
    low : lower end of the bracket of the sought event, s
    e, event : the coordinate at its boundary, and its first event
    """
    s, side = e.motion, e.motion.side_beyond
    passed = event.turns | ((side != 0.0) & (side * (s.position - s.limit(side)) > s.closeness))
    pulled = (e.pull > 0.0) & (trial_h - low > ROUNDING * left)
    return passed if s.free else pulled


def other_event(trial: Trial, search: Search, sought: Sought) -> Aim:
    """An event at another boundary than the sought one, before the end of a trial step."""
    late = [
        came_before(trial.h, trial.left, search.low, e, event) & logical_not(is_sought)
        for e, event, is_sought in zip(trial.encounters, trial.events, sought.chosen, strict=True)
    ]
    chosen = [is_late & logical_not(any_of(late[:k])) for k, is_late in enumerate(late)]
    free = pick(chosen, [e.motion.free for e in trial.encounters])
    turns = pick(chosen, [event.turns for event in trial.events])
    sides = [side_of(e, event) for e, event in zip(trial.encounters, trial.events, strict=True)]
    return Aim(
        exists=any_of(late), chosen=chosen,
        target=pick(chosen, [e.number for e in trial.encounters]),
        side=pick(chosen, sides), turns=turns,
        h=shorter(free, pick(chosen, [event.time for event in trial.events]), trial.h),
    )  # fmt: skip


@branches
def side_of(e: Encounter, event: Event) -> Any:
    """Side of the limit near which a coordinate turns, or which it is beyond."""
    return event.side if event.turns else e.motion.side_beyond


@branches
def shorter(free: Any, time: Any, h: Any) -> Any:
    """Length of a trial step towards an event before the end of a step: the same step is never repeated."""
    return time if free and time < h else 0.5 * h


@branches
def may_hide_event(h: Any, e: Encounter, overshoot: Overshoot) -> Any:
    """Whether a step may hide an event of a coordinate that is larger than rounding.

    A free coordinate may reach its limit and leave it; the stop of a resting one may have to pull before the
    end, though not at the end. In either case a step of half the length follows.
    """
    if e.motion.free:
        return e.crossing == Crossing.UNCLEAR
    moves = most_pull(e.motion, overshoot) * e.mobility * (h * h)
    return logical_not(e.pull > 0.0) & (moves > e.motion.closeness)


@branches
def position_at_event(s: BoundedCoordinate, position: Any, arrives: Any, stop: Any, interval: Any) -> Any:
    """Position of a free coordinate at an event, m: ``position``, or exactly its stop.

    It is at ``stop`` if it ``arrives`` there, and at one of its stops if it would reach it within a
    negligible part of the control ``interval``, or is beyond it.
    """
    if arrives:
        return stop
    near = s.closeness + TOGETHER_SHARE * interval * abs(s.velocity)
    if position > s.upper or (position >= s.upper - near and s.velocity > 0.0):
        return s.upper
    if position < s.lower or (position <= s.lower + near and -s.velocity > 0.0):
        return s.lower
    return position


def positions_after(trial: Trial, sought: Sought, rest_of_way: TaylorStep, slide: Any) -> list[Any]:
    """Positions at an event: after a trial step and the Taylor step of ``slide`` that follows it."""
    positions = []
    for e, is_sought, arrives in zip(trial.encounters, sought.chosen, rest_of_way.arrives, strict=True):
        s = e.motion
        moved = s.position + slide * s.velocity
        stop = where(is_sought, sought.limit, s.limit(s.velocity))
        there = position_at_event(s, moved, arrives, stop, trial.interval) if s.bounces else moved
        positions.append(where(s.free, there, moved) if s.bounces else moved)
    return positions
