"""A control interval without a compiler: on floats as it is written, on arrays by an interpreter."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.compiler.tracing.flow import LaneFunction
from redundant_envs.compiler.tracing.graph import COMPARISONS, Operation, Value, reached
from redundant_envs.language import algebra
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.faults import GIVEN_UP, Control, Reason
from redundant_envs.simulator.lane.interval import FIRST, Interval
from redundant_envs.simulator.lane.memory import Lane, traced
from redundant_envs.simulator.lane.program import Request

Procedure = Callable[[Lane], Any]
Fields = Mapping[str, Any]
OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "neg": operator.neg,
    "abs": abs, "sqrt": algebra.sqrt, "floor": algebra.floor, "exp": algebra.exp, "expm1": algebra.expm1,
    "log": algebra.log, "philox": algebra.philox,
    "sin": lambda x: algebra.sincos(x)[0], "cos": lambda x: algebra.sincos(x)[1],
    **COMPARISONS, "and": operator.and_, "or": operator.or_, "xor": operator.xor,
    "not": algebra.logical_not, "select": algebra.where,
}  # fmt: skip
"""Operations of a graph that is recorded with whole functions (:class:`Graph`)."""


def fields_of(dynamics: Dynamics, parameters: Fields | None = None) -> dict[str, Any]:
    """Parameters of a scene, some replaced, as fields of a lane, and the fields that follow from them."""
    values = {**dynamics.parameters.values, **(parameters or {})}
    steps = {"h": dynamics.scene.control_dt / dynamics.scene.substeps, "interval": dynamics.scene.control_dt}
    return {**values, **dynamics.parameters.prepare(values), **steps}


def cross_interval(interval: Interval, fields: Fields) -> Fields:
    """Lanes after a control interval: the new states by their names, and "fault", "error", "evaluations"
    where the scene has them. ``fields`` are states, parameters (:func:`fields_of`) and commands: floats, or
    arrays or tensors with one number for each lane; others are 0."""
    several = any(getattr(x, "shape", ()) for x in fields.values())
    with np.errstate(all="ignore"):  # infinite limits meet zeros, as in compiled code
        return _cross_together(interval, fields) if several else _cross_alone(interval, fields)


def _cross_alone(interval: Interval, fields: Fields) -> Any:
    """One lane: its program runs as it is written."""
    numbers = {n: np.float64(x) for n, x in fields.items()}  # whose division by 0 is no error
    layout = interval.layout()
    interval.declare_program(layout)
    lane = Lane(layout, lambda name: numbers.get(name, np.float64(0.0)))
    interval.step.clear(lane)
    for _ in range(interval.pieces.attempts):
        for begins in common_steps(interval):
            for procedure in (*begins, *common_procedures(interval)):
                procedure(lane)
            if not interval.features.local or lane.reason == Reason.NONE:
                continue
            for request in interval.program.cross(lane):
                if request is Request.FORCES:
                    interval.boundaries.find_contact_forces(lane)
                elif not lane.due:
                    lane.moving = True
                    for procedure in trial_procedures(interval):
                        procedure(lane)
                lane.due = False
        if interval.pieces.attempts > 1:
            interval.pieces.doubt(lane)
            interval.pieces.settle(lane)
            if not lane.again:
                break
    interval.end(lane)
    return lane


def common_steps(interval: Interval) -> list[Sequence[Procedure]]:
    """The common steps of an interval: for each what a lane does before it, if a piece begins there."""
    later: list[Sequence[Procedure]] = [()] * (interval.dynamics.scene.substeps - 1)
    return [interval.pieces.begins, *later] * interval.pieces.count


def common_procedures(interval: Interval) -> list[Procedure]:
    """What a lane does with all others in a common step."""
    features, step, boundaries = interval.features, interval.step, interval.boundaries
    if not features.local:
        return [step.common_step]
    if features.control is Control.ADAPTIVE:
        return [step.start, step.skip_common_step]
    held = [boundaries.release] if features.holding else []
    forces = [boundaries.update_constraint_forces] if features.holding else []
    confirm = [boundaries.confirm_crossings] if features.bounded else []
    return [step.start, *held, step.common_step, *forces, step.judge, *confirm]


def trial_procedures(interval: Interval) -> list[Procedure]:
    """What all slots do together in a trial step."""
    forces = [interval.boundaries.find_contact_forces] if interval.features.resolves else []
    return [interval.step.trial_step, interval.step.record_step, *forces]


def evaluate(
    results: Iterable[Value], load: Callable[[tuple[str, int]], Any],
    operations: Mapping[str, Callable[..., Any]] = OPERATIONS,
) -> list[Any]:  # fmt: skip
    """Values of a graph; ``load`` returns the number at a memory location."""
    results = list(results)
    known: dict[Operation, Any] = {}
    for node in reached(results):
        arguments = [known[a] if isinstance(a, Operation) else a for a in node.arguments]
        if node.name == "load":
            known[node] = load(node.extra)
        elif node.name == "stage":
            known[node] = node.extra.function(*arguments)
        elif node.name in ("result", "word"):
            known[node] = arguments[0][node.extra]
        else:
            known[node] = operations[node.name](*arguments)
    return [known[r] if isinstance(r, Operation) else r for r in results]


@functools.lru_cache(maxsize=16)
def graphs_of(interval: Interval) -> tuple[Any, ...]:
    """Procedures and the program of an interval as graphs with whole functions; and the names of all rows."""
    layout = interval.layout()
    program = interval.traced_program(layout, whole=True) if interval.features.local else {}
    procedure = functools.cache(lambda procedure: traced("procedure", layout, procedure, whole=True))
    return procedure, program, {layout.row_of(name): name for name in layout.fields}


def _cross_together(interval: Interval, start: Fields, records: Sequence[Steps] = ()) -> dict[str, Any]:
    """Many lanes: traced procedures and the traced program, by an interpreter; ``records`` are those of the
    pieces of an interval, if there are any."""
    fields, (traced_procedure, program, names) = dict(start), graphs_of(interval)

    def call(*parts: Procedure | LaneFunction) -> None:
        for part in parts:
            stores = (part if isinstance(part, LaneFunction) else traced_procedure(part)).stores
            values = evaluate((v for _, _, v in stores), lambda place: fields.get(names[place], 0.0))
            for (space, row, _), value in zip(stores, values, strict=True):
                fields[names[space, row]] = value

    def some(name: str) -> bool:
        value = fields[name] > 0.0
        return bool(value.any() if hasattr(value, "any") else value)

    def go_on(part: LaneFunction, record: Steps | None) -> None:
        before = dict(fields)
        call(part)
        if record:
            record.tried(before, fields)

    def cross_locally(record: Steps | None) -> None:
        """The programs of the lanes that leave the common step."""
        served, leaves = dict(fields), fields["reason"] != float(Reason.NONE)
        fields.update({"entered": algebra.where(leaves, 1.0, 0.0), "state": -2.0, "complete": 0.0})
        fields.update({"moving": 0.0, "touching": 0.0})
        go_on(program[None], record)
        if FIRST in program:
            go_on(program[FIRST], record)
        while some("moving") or some("touching"):
            while some("touching"):
                call(interval.boundaries.find_contact_forces, program[Request.FORCES])
            call(*trial_procedures(interval))
            go_on(program[Request.STEP], record)
        for name, before in served.items():
            if fields[name] is not before:
                fields[name] = algebra.where(leaves, fields[name], before)
        if record:
            record.crossed(fields)

    call(interval.step.clear)
    for _ in range(interval.pieces.attempts):
        for begins, record in itertools.zip_longest(common_steps(interval), records):
            call(*begins)
            if interval.pieces.begins and not some("h"):  # all wait at the end; numbers may divide by h
                continue
            call(*common_procedures(interval))
            if interval.features.local:
                cross_locally(record)
        if interval.pieces.attempts > 1:
            call(interval.pieces.doubt, interval.pieces.settle)
            if not some("again"):
                break
    call(interval.end)
    return fields


def steps_taken(interval: Interval, fields: Fields) -> list[NDArray[np.float64]]:
    """The steps in each piece of an interval, from the fields at its start: arrays (lanes,) or floats.

    A piece has (1 + laws, steps, lanes) numbers: shares of the piece, 0 where a lane takes no step any more,
    and the side of each law of :attr:`Features.sides`. A lane that gives the interval up takes none.
    """
    lanes = next(x.size for x in fields.values() if isinstance(x, np.ndarray))
    pieces = [Steps(lanes, interval.features.sides) for _ in range(interval.pieces.count)]
    with np.errstate(all="ignore"):  # infinite limits meet zeros, as in compiled code
        end = _cross_together(interval, {**dict.fromkeys(interval.features.sides, 0.0), **fields}, pieces)
    return [piece.shares(np.broadcast_to(end["fault"] < float(GIVEN_UP), lanes)) for piece in pieces]


class Steps:
    """The steps that lanes take in a piece of an interval."""

    def __init__(self, lanes: int, sides: tuple[str, ...]) -> None:
        self._sides = sides
        self._counts, self._span = np.zeros(lanes, int), np.ones(lanes)
        self._rows = np.zeros((8, 1 + len(sides), lanes))

    def shares(self, crossed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The steps as :func:`steps_taken` has them; those of lanes that have not crossed it are left out."""
        most = max(int(self._counts.max(initial=0)), 1)  # a step without a length has the shape of all lanes
        rows = np.moveaxis(self._rows[:most], 1, 0).copy()
        rows[0] = np.where(crossed & (np.arange(most)[:, None] < self._counts), rows[0] / self._span, 0.0)
        return rows

    def tried(self, before: Fields, after: Fields) -> None:
        """Record a trial step of lanes that have left the common step, from their fields before and after the
        program has judged it: it counts, or not, or all begins anew."""
        left, elapsed = after["reason"] != float(Reason.NONE), after["elapsed"]
        self._counts = np.where(left & (elapsed == 0.0), 0, self._counts)
        if "elapsed" in before:
            self._take(left & (elapsed > before["elapsed"]), before["step"], before, "{}")

    def crossed(self, lane: Fields) -> None:
        """Record the common step of the lanes that it has served."""
        goes_on = lane["h"] > 0.0
        served = goes_on & (lane["reason"] == float(Reason.NONE))
        self._counts = np.where(served, 0, self._counts)
        self._take(served, lane["h"], lane, "{}_start")
        self._span = np.where(goes_on, lane["h"], self._span)

    def _take(self, lanes: NDArray[np.bool_], length: Any, lane: Fields, form: str) -> None:
        here = np.flatnonzero(np.broadcast_to(lanes, self._counts.shape))
        if here.size and self._counts.max() == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        for k, x in enumerate((length, *(lane[form.format(side)] for side in self._sides))):
            self._rows[self._counts[here], k, here] = np.broadcast_to(x, self._counts.shape)[here]
        self._counts[here] += 1
