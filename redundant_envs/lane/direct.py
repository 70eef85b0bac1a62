"""A control interval without a compiler: on floats as it is written, on arrays and tensors by an interpreter.

On floats it is the reference for compiled code.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from redundant_envs.algebra import where
from redundant_envs.backends.interpreter import evaluate
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import Control, Reason
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane, RunningLane, traced
from redundant_envs.lane.program import Request
from redundant_envs.tracing.flow import LaneFunction


def fields_of(dynamics: Dynamics, parameters: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Parameters of a scene as fields of a lane, some of them replaced, and the fields that follow from
    them."""
    scene = dynamics.scene
    values = {**dynamics.parameters, **(parameters or {})}
    steps = {"h": scene.control_dt / scene.substeps, "interval": scene.control_dt}
    return {**values, **dynamics.prepare(values), **steps}


def cross_interval(interval: Interval, fields: Mapping[str, Any]) -> Mapping[str, Any]:
    """Lanes after a control interval.

    Parameters
    ----------
    interval : Interval
    fields : mapping
        States, parameters (:func:`fields_of`) and commands by the names of their fields, as floats, or arrays
        or tensors with one number for each lane; others are 0.

    Returns
    -------
    mapping
        The new states by their names, and "fault", "error", "evaluations" where the scene has them.
    """
    several = any(getattr(x, "shape", ()) for x in fields.values())
    with np.errstate(all="ignore"):  # infinite limits meet zeros, as in compiled code
        lane: Any = Arrays(interval, fields) if several else Floats(interval, fields)
        for _ in range(interval.dynamics.scene.substeps):
            lane.common_step()
        lane.end()
    return lane.fields  # type: ignore[no-any-return]


class Floats:
    """One lane: its program runs as it is written."""

    def __init__(self, interval: Interval, fields: Mapping[str, Any]) -> None:
        self.interval = interval
        numbers = {n: np.float64(x) for n, x in fields.items()}  # whose division by 0 is no error
        self.fields = RunningLane(interval.layout(), lambda name: numbers.get(name, np.float64(0.0)))
        interval.step.clear(self.fields)

    def common_step(self) -> None:
        """Take a common step, and let the program of the lane cross the interval if that does not serve."""
        interval, lane = self.interval, self.fields
        if not interval.dynamics.local:
            interval.step.common_step(lane)
        elif self._leaves(lane):
            self._run(lane)

    def end(self) -> None:
        """End the interval."""
        interval, lane = self.interval, self.fields
        interval.update_effect_states(lane)
        if interval.dynamics.local:
            interval.undo_given_up(lane)

    def _leaves(self, lane: Lane) -> bool:
        """Take a common step; whether it does not serve the lane."""
        for procedure in common_procedures(self.interval):
            procedure(lane)
        return bool(lane.reason != Reason.NONE)

    def _run(self, lane: Lane) -> None:
        interval = self.interval
        for request in interval.program.cross(lane):
            if request is Request.FORCES:
                interval.boundaries.find_contact_forces(lane)
            elif not lane.due:
                lane.moving = True
                for procedure in trial_procedures(interval):
                    procedure(lane)
            lane.due = False


def common_procedures(interval: Interval) -> list[Callable[[Lane], None]]:
    """What a lane does with all others in a common step, if it may take local steps."""
    features, step, boundaries = interval.dynamics, interval.step, interval.boundaries
    if features.control is Control.ADAPTIVE:
        return [step.start, step.skip_common_step]
    held = [boundaries.release] if features.holding else []
    forces = [boundaries.update_constraint_forces] if features.holding else []
    confirm = [boundaries.confirm_crossings] if features.boundaries else []
    return [step.start, *held, step.common_step, *forces, step.judge, *confirm]


def trial_procedures(interval: Interval) -> list[Callable[[Lane], None]]:
    """What all slots do together in a trial step."""
    forces = [interval.boundaries.find_contact_forces] if interval.dynamics.holding else []
    return [interval.step.trial_step, interval.step.record_step, *forces]


class Traced:
    """Procedures and the program of an interval as graphs with whole functions."""

    def __init__(self, interval: Interval) -> None:
        self.layout = interval.layout()
        self.program = interval.traced_program(self.layout, whole=True) if interval.dynamics.local else {}
        self.names = {self.layout.row_of(name): name for name in self.layout.fields}
        self._known: dict[Any, LaneFunction] = {}

    def procedure(self, procedure: Callable[[Lane], Any]) -> LaneFunction:
        """A procedure of a lane as a function."""
        if procedure not in self._known:
            self._known[procedure] = traced("procedure", self.layout, procedure, whole=True)
        return self._known[procedure]


_traced = functools.lru_cache(maxsize=16)(Traced)


class Arrays:
    """Many lanes: traced procedures and the traced program, by an interpreter."""

    def __init__(self, interval: Interval, fields: Mapping[str, Any]) -> None:
        self.interval, self.traced = interval, _traced(interval)
        self.fields: dict[str, Any] = dict(fields)
        self._call(interval.step.clear)

    def _call(self, *procedures: Callable[[Lane], Any]) -> None:
        """Apply procedures to all lanes, one after the other."""
        for procedure in procedures:
            self._apply(self.traced.procedure(procedure))

    def _apply(self, function: LaneFunction) -> None:
        found = evaluate((v for _, _, v in function.stores), self._load)
        for (space, row, _), value in zip(function.stores, found, strict=True):
            self.fields[self.traced.names[space, row]] = value

    def _load(self, location: tuple[str, int]) -> Any:
        return self.fields.get(self.traced.names[location], 0.0)

    def _some(self, name: str) -> bool:
        value = self.fields[name] > 0.0
        return bool(value.any() if hasattr(value, "any") else value)

    def common_step(self) -> None:
        """Take a common step, and let programs cross the interval where that does not serve."""
        interval = self.interval
        if not interval.dynamics.local:
            self._call(interval.step.common_step)
            return
        self._call(*common_procedures(interval))
        served = dict(self.fields)
        leaves = self.fields["reason"] != float(Reason.NONE)
        self.fields |= {"entered": where(leaves, 1.0, 0.0), "state": -2.0, "complete": 0.0}
        self.fields |= {"moving": 0.0, "touching": 0.0}
        self._apply(self.traced.program[None])
        if interval.dynamics.boundaries:
            self._apply(self.traced.program[Request.STEP])
        while self._some("moving") or self._some("touching"):
            while self._some("touching"):
                self._call(interval.boundaries.find_contact_forces)
                self._apply(self.traced.program[Request.FORCES])
            self._call(*trial_procedures(interval))
            self._apply(self.traced.program[Request.STEP])
        for name, before in served.items():
            if self.fields[name] is not before:
                self.fields[name] = where(leaves, self.fields[name], before)

    def end(self) -> None:
        """End the interval."""
        self._call(self.interval.update_effect_states)
        if self.interval.dynamics.local:
            self._call(self.interval.undo_given_up)
