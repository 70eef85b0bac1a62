"""A control interval of a lane: the step that all lanes take together, and the program of the others."""

from collections.abc import Iterator
from typing import Any

from redundant_envs.compiler.tracing.flow import LaneFunction
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.program import Machine
from redundant_envs.language.algebra import gives_of
from redundant_envs.language.quantities import check_names
from redundant_envs.simulator.lane import jumps
from redundant_envs.simulator.lane.boundaries import Boundaries
from redundant_envs.simulator.lane.common_step import CommonStep
from redundant_envs.simulator.lane.dynamics import ARGUMENTS, INTERVALS, Dynamics
from redundant_envs.simulator.lane.faults import GIVEN_UP, Control
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import Layout, Variable, copies, engine, variables
from redundant_envs.simulator.lane.memory import Lane, TracedLane, function_of
from redundant_envs.simulator.lane.pieces import pieces_of
from redundant_envs.simulator.lane.program import LaneProgram, Request
from redundant_envs.simulator.lane.step_control import CLASSES

ANSWERED = {None: "entered", Request.STEP: "due", Request.FORCES: "touching"}
"""The field that is true when the program of a lane may go on after a request."""
FIRST = "first"
"""Key of what a program does after its first trial step, if the common step was that: a part of what it does
after any, and half as long."""


class Interval:
    """The lanes of a scene in a control interval: their procedures and fields."""

    def __init__(self, dynamics: Dynamics, watches: bool = False) -> None:
        """``watches`` is for :class:`Features`."""
        self.dynamics, self.features = dynamics, Features(dynamics, watches)
        self.pieces = pieces_of(self.features)
        self.boundaries = Boundaries(self.features, self.pieces)
        self.step = CommonStep(self.boundaries)
        self.program = LaneProgram(self.boundaries, CLASSES[self.features.control](self.step))

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes, without those that only the program of a lane sets."""
        dynamics, features = self.dynamics, self.features
        yield from dynamics.fields(self.pieces.length)
        yield from self.pieces.fields()
        yield from features.watch.fields(features.local)
        if not features.local:
            if features.counts_evaluations:
                yield from engine("evaluations")
            return
        for stop in features.holding:
            yield from stop.own_variables("active_stop")
        if features.control is Control.ADAPTIVE:
            yield from engine("next_step")
        yield from copies(features.saved, "{}_start", "before the common step")
        if features.origin != "{}_start":
            yield from copies(features.saved, features.origin, "when the interval began")
        yield from copies(dynamics.states, "{}_trial", "at the start of the trial step")
        yield from engine("evaluations", "reason", "error_start", "min_steps", "state")
        yield from engine("entered", "due", "moving", "touching", "complete")
        yield from variables(features.doubts, "why an error may exceed its estimate", truth=True)
        yield from features.log.fields()
        for b in features.boundaries:
            yield from b.watched_fields()
        parts: list[Any] = [*features.laws, features.stiction, *features.guards]
        for part in parts:
            yield from part.fields()
        if dynamics.bounds_late_switch:
            yield from engine("departure", "target")
            for guard in features.guards:
                yield from guard.own_variables("left")
        if self.boundaries.impulses_change_laws:
            yield from engine("resolving")
        if features.stops:
            yield from engine("impacts", "impacts_start")
        if features.resolves:
            yield from copies(dynamics.states[dynamics.count :], "{}_slope", "differentiated by time")
        for impacting in features.stops:
            yield from impacting.fields()
        yield from features.bounces.fields()
        yield from features.log.fields_of_events()

    def update_effect_states(self, lane: Lane) -> None:
        """At the end of an interval: update the states of effects that were constant in it."""
        x = self.features.quantities(lane)
        self.dynamics.set_field(x)
        changes = self.dynamics.changes(x, "update", lane)
        lane.set(changes, changes.values())
        jumps.exchange(self.features, lane, x)
        if self.dynamics.draws:
            lane[INTERVALS] = lane[INTERVALS] + 1.0

    def initial_states(self, lane: Lane) -> dict[str, Any]:
        """Values that states of effects have at the start of a motion, of those whose values are computed."""
        return self.dynamics.initial_states(self.features.quantities(lane), lane)

    def undo(self, lane: Lane, failed: Any) -> None:
        """Return lanes that failed to their states at the start of the interval."""
        lane.set_where(failed, lane.values(self.features.saved, of=self.features.origin))

    def end(self, lane: Lane) -> None:
        """End an interval; a lane that has given it up returns to its state at the start."""
        self.update_effect_states(lane)
        if self.features.local:
            self.undo(lane, lane.fault >= GIVEN_UP)

    def declare_program(self, layout: Layout) -> None:
        """Declare the fields that only the program of a lane sets."""
        for variable in self.program.fields():
            if layout.fields.get(variable.name) != variable:
                layout.add(variable)

    def traced_program(self, layout: Layout, whole: bool = False) -> dict[Any, LaneFunction]:
        """The program of a lane as functions: at its beginning (None), after each request, and after a common
        step that is its first trial step (:data:`FIRST`). The layout gets fields that only it sets; ``whole``
        is for :class:`Graph`."""
        self.declare_program(layout)
        functions: dict[Any, LaneFunction] = {}
        machine = Machine(self.program.cross, TracedLane(layout, Graph()), Request, whole)
        for request, answered in ANSWERED.items():
            if request not in machine.graphs:
                continue
            written = machine.after(request, answered)
            if request is not Request.FORCES:  # which the program itself asks for again
                written[answered] = 0.0
            name = "begin_program" if request is None else f"after_{request.name.lower()}"
            functions[request] = function_of(layout, name, written)
        skips = self.features.control is Control.ADAPTIVE and self.features.sticking
        if self.features.boundaries and not skips:  # what sticks is decided before any first step then
            written = machine.after(Request.STEP, "due", first=True)
            functions[FIRST] = function_of(layout, "after_common_step", {**written, "due": 0.0})
        return functions

    def layout(self) -> Layout:
        dynamics, arm, layout = self.dynamics, self.dynamics.arm, Layout(self.fields())
        known = (*dynamics.states, *dynamics.parameters.numbers, *dynamics.commands)
        owners = ARGUMENTS | {name: layout.fields[name].whose for name in known}
        more = (arm.held_dynamics, arm.slider_mobility, arm.column_norms, arm.mobility_bounds)
        outputs = {name for f in (*arm.functions, *filter(None, more)) for name in gives_of(f)}
        kept_alike = {name for f in arm.prepared for name in gives_of(f)}  # under the same names
        check_names(f"{arm.kind}.functions", outputs.union(*arm.sincos.values()) - kept_alike, owners)
        return layout
