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
from redundant_envs.lane.memory import Lane, traced
from redundant_envs.lane.program import Request
from redundant_envs.tracing.flow import LaneFunction

Procedure = Callable[[Lane], Any]


def fields_of(dynamics: Dynamics, parameters: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Parameters of a scene as fields of a lane, some of them replaced, and the fields that follow from
    them."""
    scene = dynamics.scene
    values = {**dynamics.parameters, **(parameters or {})}
    steps = {"h": scene.control_dt / scene.substeps, "interval": scene.control_dt}
    return {**values, **dynamics.prepare(values), **steps}


def cross_interval(interval: Interval, fields: Mapping[str, Any]) -> Mapping[str, Any]:
    """Lanes after a control interval: the new states by their names, and "fault", "error", "evaluations"
    where the scene has them.

    ``fields`` are states, parameters (:func:`fields_of`) and commands by the names of their fields: floats,
    or arrays or tensors with one number for each lane; others are 0.
    """
    several = any(getattr(x, "shape", ()) for x in fields.values())
    with np.errstate(all="ignore"):  # infinite limits meet zeros, as in compiled code
        return Lanes(interval, fields).cross() if several else crossed(interval, fields)


def crossed(interval: Interval, fields: Mapping[str, Any]) -> Any:
    """One lane after a control interval: its program runs as it is written."""
    numbers = {n: np.float64(x) for n, x in fields.items()}  # whose division by 0 is no error
    lane = Lane(interval.layout(), lambda name: numbers.get(name, np.float64(0.0)), declares=True)
    interval.step.clear(lane)
    for _ in range(interval.dynamics.scene.substeps):
        for procedure in common_procedures(interval):
            procedure(lane)
        if not interval.dynamics.local or lane.reason == Reason.NONE:
            continue
        for request in interval.program.cross(lane):
            if request is Request.FORCES:
                interval.boundaries.find_contact_forces(lane)
            elif not lane.due:
                lane.moving = True
                for procedure in trial_procedures(interval):
                    procedure(lane)
            lane.due = False
    interval.end(lane)
    return lane


def common_procedures(interval: Interval) -> list[Procedure]:
    """What a lane does with all others in a common step."""
    dynamics, step, boundaries = interval.dynamics, interval.step, interval.boundaries
    if not dynamics.local:
        return [step.common_step]
    if dynamics.control is Control.ADAPTIVE:
        return [step.start, step.skip_common_step]
    held = [boundaries.release] if dynamics.holding else []
    forces = [boundaries.update_constraint_forces] if dynamics.holding else []
    confirm = [boundaries.confirm_crossings] if dynamics.boundaries else []
    return [step.start, *held, step.common_step, *forces, step.judge, *confirm]


def trial_procedures(interval: Interval) -> list[Procedure]:
    """What all slots do together in a trial step."""
    forces = [interval.boundaries.find_contact_forces] if interval.dynamics.holding else []
    return [interval.step.trial_step, interval.step.record_step, *forces]


@functools.lru_cache(maxsize=16)
def graphs_of(interval: Interval) -> tuple[Any, ...]:
    """Procedures and the program of an interval as graphs with whole functions; and the names of all rows."""
    layout = interval.layout()
    program = interval.traced_program(layout, whole=True) if interval.dynamics.local else {}
    procedure = functools.cache(lambda procedure: traced("procedure", layout, procedure, whole=True))
    return procedure, program, {layout.row_of(name): name for name in layout.fields}


class Lanes:
    """Many lanes: traced procedures and the traced program, by an interpreter."""

    def __init__(self, interval: Interval, fields: Mapping[str, Any]) -> None:
        self.interval, self.fields = interval, dict(fields)
        self.procedure, self.program, self.names = graphs_of(interval)

    def cross(self) -> dict[str, Any]:
        """The lanes after a control interval."""
        interval = self.interval
        self._call(interval.step.clear)
        for _ in range(interval.dynamics.scene.substeps):
            self._call(*common_procedures(interval))
            if interval.dynamics.local:
                self._cross_alone()
        self._call(interval.end)
        return self.fields

    def _call(self, *parts: Procedure | LaneFunction) -> None:
        """Apply procedures, or functions of the program, to all lanes, one after the other."""
        fields, names = self.fields, self.names
        for part in parts:
            stores = (part if isinstance(part, LaneFunction) else self.procedure(part)).stores
            found = evaluate((v for _, _, v in stores), lambda place: fields.get(names[place], 0.0))
            for (space, row, _), value in zip(stores, found, strict=True):
                fields[names[space, row]] = value

    def _some(self, name: str) -> bool:
        value = self.fields[name] > 0.0
        return bool(value.any() if hasattr(value, "any") else value)

    def _cross_alone(self) -> None:
        """Let programs cross the interval where the common step does not serve."""
        interval, program = self.interval, self.program
        served = dict(self.fields)
        leaves = self.fields["reason"] != float(Reason.NONE)
        self.fields |= {"entered": where(leaves, 1.0, 0.0), "state": -2.0, "complete": 0.0}
        self.fields |= {"moving": 0.0, "touching": 0.0}
        self._call(program[None])
        if interval.dynamics.boundaries:
            self._call(program[Request.STEP])
        while self._some("moving") or self._some("touching"):
            while self._some("touching"):
                self._call(interval.boundaries.find_contact_forces, program[Request.FORCES])
            self._call(*trial_procedures(interval), program[Request.STEP])
        for name, before in served.items():
            if self.fields[name] is not before:
                self.fields[name] = where(leaves, self.fields[name], before)
