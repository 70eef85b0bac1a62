"""The program of a batch: advance all lanes by a control interval under given efforts."""

from typing import Any

from redundant_envs.compiler.tracing.flow import Kernel
from redundant_envs.language.algebra import where
from redundant_envs.simulator.batch.blocks import MEMORY, Block, Blocks, Ends, limited
from redundant_envs.simulator.batch.slots import advance
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.faults import GIVEN_UP, Control, Fault, angle_fault
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane

COLUMNS = {"error": "f64", "finite": "i8", "evaluations": "i64", "events": "i64", "numerics": "i8"}
"""Outputs of the kernel for each lane, and the types of these arrays."""


def begin_kernel(dynamics: Dynamics) -> Kernel:
    """A kernel that fills ``initial`` (lanes, states) with the states of effects whose values at the start of
    a motion are computed, and changes nothing else."""
    interval, names = Interval(dynamics), dynamics.effect_states.computed
    p = Kernel("begin", {**MEMORY, "initial": "f64"})
    blocks = Blocks(p, interval, interval.layout())

    def initial(lane: Lane) -> dict[Any, Any]:
        values = interval.initial_states(lane)
        return {("initial", "f64", k, len(names)): values[name] for k, name in enumerate(names)}

    function = blocks.function("initial_states", initial)
    with p.each(blocks.count) as number:
        block = blocks.block(number, 0)
        p.call(function, **block.pointers, initial=p["initial"] + block.first * len(names))
    return p


@limited()
def advance_kernel(dynamics: Dynamics) -> tuple[Kernel, Blocks]:
    """A kernel from ``efforts`` (lanes, joints) to :data:`COLUMNS`; ValueError for too many operations."""
    interval = Interval(dynamics)
    features = interval.features
    p = Kernel("advance", {**MEMORY, "efforts": "f64", **COLUMNS})
    blocks = Blocks(p, interval, interval.layout())
    gives_up = features.local and (bool(features.boundaries) or features.control is Control.ADAPTIVE)
    columns: dict[str, Any] = {}

    def end(lane: Lane) -> dict[Any, Any]:
        interval.update_effect_states(lane)
        motion = lane.get((*dynamics.states[: 2 * dynamics.count], *dynamics.effect_states))
        defect = interval.step.defect(motion)
        fault: Any = 0.0
        given_up: Any = False
        if features.local:
            fault, given_up = lane.fault, lane.fault >= GIVEN_UP
            defect = where(given_up, 0.0, defect)
        if features.counts_evaluations:
            columns["evaluations"] = lane.evaluations
        if features.stops:
            columns["events"] = where(given_up, 0.0, lane.impacts)
        if gives_up:
            interval.undo(lane, given_up)
        features.log.end(lane, given_up)
        if dynamics.method.error5:
            columns["error"] = lane.error
        columns["finite"] = defect == 0.0
        non_finite = where(defect == 0.0, 0.0, float(Fault.NON_FINITE))
        columns["numerics"] = non_finite + fault + angle_fault(dynamics.arm, lane)
        return {(name, COLUMNS[name], 0, 0): value for name, value in columns.items()}

    def outputs(block: Block) -> dict[str, Any]:
        return {name: p[name] + block.first for name in COLUMNS if name in columns}

    advance(blocks, Ends(lambda lane: None, {"efforts": ("f64", dynamics.commands)}, end, outputs))
    blocks.prune()
    return p, blocks
