"""A control interval run on floats, arrays or tensors, with the procedures that the back end compiles.

It is the reference for compiled code, and gradients are taken through it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from redundant_envs.algebra import logical_not, where
from redundant_envs.simulator.dynamics import Dynamics
from redundant_envs.simulator.interval import Interval
from redundant_envs.simulator.lane import Lane
from redundant_envs.simulator.setting import GIVEN_UP, Plan, Reason

TOLD = ("error", "fault", "evaluations", "impacts", "next_step", "divisions")
"""Outputs of local steps beside the state of a lane."""


def some(condition: Any) -> bool:
    """Whether a condition holds in any lane."""
    return bool(condition.any()) if hasattr(condition, "any") else bool(condition)


def fields_of(dynamics: Dynamics, parameters: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Parameters of a scene as fields of a lane, some of them replaced, and the fields that follow from
    them."""
    scene = dynamics.scene
    values = {**dynamics.parameters, **(parameters or {})}
    steps = {"h": scene.control_dt / scene.substeps, "interval": scene.control_dt}
    return {**values, **dynamics.prepare(values), **steps}


def cross_interval(interval: Interval, fields: Mapping[str, Any]) -> Lane:
    """Lanes after a control interval.

    Parameters
    ----------
    interval : Interval
    fields : mapping
        States, parameters (:func:`fields_of`) and commands by the names of their fields; others are 0.

    Returns
    -------
    Lane
        With the new states, and "fault", "error", "evaluations" where the scene has them.
    """
    lane = Lane(interval.layout(), lambda name: fields.get(name, 0.0))
    interval.clear(lane)
    for _ in range(interval.dynamics.scene.substeps):
        if interval.local:
            _local_step(interval, lane)
        else:
            interval.common_step(lane)
    interval.renew(lane)
    if interval.local:
        interval.undo(lane, lane.fault >= GIVEN_UP)
    return lane


def _local_step(interval: Interval, lane: Lane) -> None:
    """A common step, and local steps for the lanes that it does not serve."""
    interval.start(lane)
    if interval.plan is Plan.ADAPTIVE:
        interval.refuse(lane)
    else:
        if interval.stops:
            interval.release(lane)
        interval.common_step(lane)
        if interval.stops:
            interval.press(lane)
        interval.judge(lane)
        if interval.boundaries:
            interval.meet(lane)
    leaves = lane.reason != Reason.NONE
    if not some(leaves):
        return
    own = Lane(interval.layout(), lane.__getitem__)
    own.entered, own.due, own.complete, own.phase = leaves, False, False, 0.0
    interval.enter(own)
    if interval.boundaries and some(own.due):
        interval.decide(own)
    while some(leaves & logical_not(own.complete)):
        while interval.stops and some(own.touching):
            interval.look_at_contacts(own)
            interval.resolve_contacts(own)
        interval.trial_step(own)
        interval.look(own)
        if interval.stops:
            interval.look_at_contacts(own)
        interval.decide(own)
    for name in (*interval.kept, *TOLD):
        if name in lane:
            lane[name] = where(leaves, own[name], lane[name])
