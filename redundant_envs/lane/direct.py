"""A control interval run on floats, arrays or tensors, with the procedures that the back end compiles.

It is the reference for compiled code, and gradients are taken through it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import GIVEN_UP, Control, Reason
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane, RunningLane
from redundant_envs.lane.program import Request


def fields_of(dynamics: Dynamics, parameters: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Parameters of a scene as fields of a lane, some of them replaced, and the fields that follow from
    them."""
    scene = dynamics.scene
    values = {**dynamics.parameters, **(parameters or {})}
    steps = {"h": scene.control_dt / scene.substeps, "interval": scene.control_dt}
    return {**values, **dynamics.prepare(values), **steps}


def cross_interval(interval: Interval, fields: Mapping[str, Any]) -> Lane:
    """A lane after a control interval, on floats: its program runs as it is written.

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
    lane = RunningLane(interval.layout(), lambda name: fields.get(name, 0.0))
    interval.step.clear(lane)
    for _ in range(interval.dynamics.scene.substeps):
        if not interval.features.local:
            interval.step.common_step(lane)
        elif begin(interval, lane):
            run(interval, lane)
    interval.update_effect_states(lane)
    if interval.features.local:
        interval.undo(lane, lane.fault >= GIVEN_UP)
    return lane


def begin(interval: Interval, lane: Lane) -> bool:
    """Take a common step; whether it does not serve the lane."""
    features, step, boundaries = interval.features, interval.step, interval.boundaries
    step.start(lane)
    if features.control is Control.ADAPTIVE:
        step.skip_common_step(lane)
        return bool(lane.reason != Reason.NONE)
    if features.holding:
        boundaries.release(lane)
    step.common_step(lane)
    if features.holding:
        boundaries.update_constraint_forces(lane)
    step.judge(lane)
    if features.boundaries:
        boundaries.confirm_crossings(lane)
    return bool(lane.reason != Reason.NONE)


def run(interval: Interval, lane: Lane) -> None:
    """Let the program of a lane cross the interval."""
    for request in interval.program.cross(lane):
        if request is Request.FORCES:
            interval.boundaries.find_contact_forces(lane)
        elif not lane.due:
            lane.moving = True
            interval.step.trial_step(lane)
            interval.step.record_step(lane)
            if interval.features.holding:
                interval.boundaries.find_contact_forces(lane)
        lane.due = False
