"""A control interval of a lane: the step that all lanes take together, and the program of the others.

A lane leaves the common step for three reasons: an error above its tolerance, a boundary that it meets, and
the integrator dop853, whose steps are always local.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from redundant_envs.algebra import gives_of, where
from redundant_envs.effects.hooks import CONTROL_DT
from redundant_envs.lane import attempts, jumps
from redundant_envs.lane.boundaries import Boundaries
from redundant_envs.lane.common_step import CommonStep
from redundant_envs.lane.coordinates import known_numbers
from redundant_envs.lane.dynamics import INTERVALS, Dynamics
from redundant_envs.lane.features import GIVEN_UP, MOST_LOGGED, WATCHED, Control
from redundant_envs.lane.memory import ENGINE, LOG, PARAMETER, SCRATCH, STATE, Field, Lane, Layout, TracedLane
from redundant_envs.lane.program import LaneProgram, Request
from redundant_envs.lane.step_control import CLASSES
from redundant_envs.quantities import check_names
from redundant_envs.tracing.flow import LaneFunction
from redundant_envs.tracing.graph import Graph
from redundant_envs.tracing.program import Machine

ANSWERED = {None: "entered", Request.STEP: "due", Request.FORCES: "touching"}
"""The field that is true when the program of a lane may go on after a request."""
FIRST = "first"
"""Key of what a program does after its first trial step, if the common step was that: a part of what it does
after any, and half as long."""
ARGUMENTS = dict.fromkeys(("ax", "ay"), f"of {ENGINE}: minus the gravity vector, m/s^2")
"""Quantities that are no fields in every scene, and whose names they are."""
CONDITIONS = {
    "entered": "has just left the common step",
    "due": "has made the trial step that it asked for",
    "moving": "asks for a trial step",
    "touching": "asks for the forces at its stops",
    "complete": "has crossed its interval, or given it up",
}
"""Fields about the program of a lane."""


class Interval:
    """The lanes of a scene in a control interval: their procedures and fields."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self.boundaries = Boundaries(dynamics)
        self.step = CommonStep(dynamics, self.boundaries)
        self.program = LaneProgram(self.boundaries, CLASSES[dynamics.control](self.step))

    def fields(self) -> Iterator[Field]:
        """Fields of the lanes, without those that only the program of a lane sets."""
        dynamics = self.dynamics
        yield from motion_fields(dynamics)
        if dynamics.instants:
            yield Field("piece_end", "s", "end of the present piece of the interval", SCRATCH)
            for a in dynamics.instants:
                yield Field(a.passed, "", "1 from the instant on, 0 before", SCRATCH)
        if dynamics.attempts > 1:
            yield from attempts.fields(dynamics)
        evaluations = Field("evaluations", "", "evaluations of the right-hand side", SCRATCH)
        if not dynamics.local:
            if dynamics.counts_evaluations:
                yield evaluations
            return
        for name in dynamics.active:
            yield Field(name, "", "side of the stop a slider rests at: 1 upper, -1 lower, 0 none", STATE)
        if dynamics.control is Control.ADAPTIVE:
            yield Field("next_step", "s", "length of the next step", STATE)
        yield from copies(dynamics.kept, "{}_start", "before the common step")
        if dynamics.origin != "{}_start":
            yield from copies(dynamics.kept, dynamics.origin, "when the interval began")
        yield from copies(dynamics.states, "{}_trial", "at the start of the trial step")
        yield evaluations
        yield Field("reason", "", "why the lane leaves the common step (Reason)", SCRATCH)
        yield Field("error_start", "m", "error before the common step", SCRATCH)
        yield Field("min_steps", "", "least number of steps allowed; 0 where one may serve", SCRATCH)
        yield Field("state", "", "where the program of the lane waits", SCRATCH)
        for name, doc in (CONDITIONS | dynamics.doubts).items():
            yield Field(name, "", doc, SCRATCH, truth=True)
        if dynamics.logs:
            yield Field("span_start", "s", "when the common step began", SCRATCH, book=True)
        for b in dynamics.boundaries:
            for name in WATCHED:
                doc = f"{name} acceleration at the stages, or pull of the stop"
                yield Field(f"{name}_{b.name}", "m/s^2 or N", doc, SCRATCH)
            if b.guards:
                continue
            yield Field(f"crossing_{b.name}", "", "how the trial step meets a limit (Crossing)", SCRATCH)
            yield Field(f"turning_{b.name}", "s", "when the coordinate turns in the trial step", SCRATCH)
        for b in dynamics.laws:
            yield Field(b.side, "", "which law of a force holds: 1 above, -1 below, 0 between", SCRATCH)
            yield Field(f"{b.side}_start", "", f"{b.side} before the common step", SCRATCH)
        yield from guard_fields(dynamics)
        if dynamics.stops:
            yield from stop_fields(dynamics)
        elif dynamics.sticking:
            yield from slopes(dynamics)

    def update_effect_states(self, lane: Lane) -> None:
        """At the end of an interval: update the states of effects that were constant in it."""
        dynamics = self.dynamics
        x = dynamics.quantities(lane.get(dynamics.states), known_numbers(dynamics, lane))
        dynamics.set_field(x)
        changes = dynamics.changes(x, "update", lane)
        lane.set(changes, changes.values())
        jumps.exchange(dynamics, lane, x)
        if dynamics.draws:
            lane[INTERVALS] = lane[INTERVALS] + 1.0

    def doubt(self, lane: Lane) -> None:
        """After the last piece: whether the lane has to be judged."""
        attempts.doubt(self.dynamics, lane)

    def settle(self, lane: Lane) -> None:
        """Then: whether the interval is crossed, or has to be crossed again."""
        attempts.settle(self.dynamics, lane)

    def initial_states(self, lane: Lane) -> dict[str, Any]:
        """Values that states of effects have at the start of a motion, of those whose values are computed."""
        dynamics = self.dynamics
        x = dynamics.quantities(lane.get(dynamics.states), known_numbers(dynamics, lane))
        return dynamics.initial_states(x, lane)

    def undo(self, lane: Lane, failed: Any) -> None:
        """Return lanes that failed to their states at the start of the interval."""
        for name in self.dynamics.kept:
            lane[name] = where(failed, lane[self.dynamics.origin.format(name)], lane[name])

    def end(self, lane: Lane) -> None:
        """End an interval; a lane that has given it up returns to its state at the start."""
        self.update_effect_states(lane)
        if self.dynamics.local:
            self.undo(lane, lane.fault >= GIVEN_UP)

    def traced_program(self, layout: Layout, whole: bool = False) -> dict[Any, LaneFunction]:
        """The program of a lane as functions: at its beginning (None), after each request, and after a common
        step that is its first trial step (:data:`FIRST`).

        The layout gets the fields that only the program sets; ``whole`` is for :class:`Graph`.
        """
        lane = TracedLane(layout, Graph(), declares=True)
        made: dict[Any, LaneFunction] = {}
        machine = Machine(self.program.cross, lane, Request, whole)
        for request, answered in ANSWERED.items():
            if request not in machine.graphs:
                continue
            written = machine.after(request, answered)
            if request is not Request.FORCES:  # which the program itself asks for again
                written[answered] = 0.0
            name = "begin_program" if request is None else f"after_{request.name.lower()}"
            made[request] = layout.function(name, written)
        skips = self.dynamics.control is Control.ADAPTIVE and self.dynamics.sticking
        if self.dynamics.boundaries and not skips:  # what sticks is decided before any first step then
            written = machine.after(Request.STEP, "due", first=True)
            made[FIRST] = layout.function("after_common_step", {**written, "due": 0.0})
        return made

    def layout(self) -> Layout:
        """The fields of the lanes, and the rows that hold them."""
        dynamics, layout = self.dynamics, Layout(self.fields())
        known = (*dynamics.states, *dynamics.numbers, *dynamics.commands)
        owners = ARGUMENTS | {name: layout.fields[name].whose for name in known}
        arm = dynamics.arm
        more = (arm.held_dynamics, arm.slider_mobility, arm.column_norms, arm.mobility_bounds)
        given = {name for f in (*arm.functions, *filter(None, more)) for name in gives_of(f)}
        angles = {name for pair in arm.sincos.values() for name in pair}
        kept_alike = {name for f in arm.prepared for name in gives_of(f)}  # under the same names
        check_names(f"{arm.kind}.functions", (given | angles) - kept_alike, owners)
        return layout


def motion_fields(dynamics: Dynamics) -> Iterator[Field]:
    """State, parameters and what every interval has."""
    arm, of_arm = dynamics.arm, f"the arm {dynamics.arm.kind}"
    owners = dict.fromkeys(dynamics.numbers, of_arm) | dict.fromkeys((*ARGUMENTS, CONTROL_DT), ENGINE)
    for effect in dynamics.scene.effects:
        names = (*effect.parameters(), *effect.states(arm))
        owners |= {f"{effect.key}.{name}": f"the effect {type(effect).__name__}" for name in names}
    units = ["m" if slides else "rad" for slides in arm.prismatic]
    for name, unit in zip(arm.coordinates, units, strict=True):
        yield Field(name, unit, "generalized coordinate", STATE, owner=of_arm)
    for name, unit in zip(arm.rates, units, strict=True):
        yield Field(name, f"{unit}/s", "generalized velocity", STATE, owner=of_arm)
    for name, state in dynamics.effect_states.items():
        yield Field(name, state.unit, f"state {state.name}", STATE, owner=owners[name])
    for name in dynamics.draw_fields:
        doc = "control intervals since draws began" if name == INTERVALS else "word of the key of draws"
        yield Field(name, "", doc, STATE)
    if dynamics.track_work:
        yield Field("work", "J", "work of motors and of forces without a potential", STATE, book=True)
    yield Field("h", "s", "length of the common step", SCRATCH if dynamics.instants else PARAMETER)
    yield Field("interval", "s", "control interval", PARAMETER)
    for name in (*dynamics.parameters, *dynamics.prepared):
        doc = "parameter of the scene" if name in dynamics.parameters else "follows from parameters alone"
        yield Field(name, "SI", doc, PARAMETER, owner=owners.get(name, ENGINE))
    for name, unit in zip(dynamics.commands, dynamics.scene.command_units(), strict=True):
        yield Field(name, unit, "command of a motor", SCRATCH)
    yield Field("error", "m", "estimated tip error of the interval so far", SCRATCH)
    yield Field("fault", "", "faults of the interval", SCRATCH)


def stop_fields(dynamics: Dynamics) -> Iterator[Field]:
    """Impacts, and the contacts with stops."""
    rates = dynamics.arm.rates
    yield Field("impacts", "", "impacts of the interval", SCRATCH)
    yield Field("impacts_start", "", "before the common step", SCRATCH)
    yield from slopes(dynamics)
    for b in dynamics.stops:
        if b in dynamics.holding:
            yield Field(f"force_{b.name}", "N", "that holds the slider", SCRATCH)
            yield Field(f"force_trial_{b.name}", "N", "at the start of the trial step", SCRATCH)
        elif b.joint is None:
            yield Field(f"acceleration_{b.name}", "m/s^2", "of the gap", SCRATCH)
            yield Field(f"arrived_{b.name}", "", "is at its stop, but for rounding", SCRATCH, truth=True)
            for v in rates:
                yield Field(f"normal_{v}_{b.name}", "", f"rate of the gap per {v}", SCRATCH)
        for v in rates:
            yield Field(f"mobility_{v}_{b.name}", "", f"{v} per impulse along {b.name}", SCRATCH)
        yield Field(f"happened_{b.name}", "", "resolution of the contact (Happening)", SCRATCH, book=True)
        yield Field(f"speed_{b.name}", "m/s", "into the stop, before an impact", SCRATCH, book=True)
    if dynamics.compares_bounces:
        yield Field("lowest_bounce", "m", "height of a bounce below which it ends in rest", SCRATCH)
        yield Field("bounces_end", "s", "when all bounces that were left out would be over", SCRATCH)
        yield Field("bounce_missed", "", "there was an impact before", SCRATCH, truth=True)
    if dynamics.logs:
        yield Field("logged_start", "", "events kept before the common step", SCRATCH, book=True)
        yield Field("logged", "", "events kept", STATE, book=True)
        for n in range(MOST_LOGGED):
            for name, unit in (("time", "s"), ("kind", ""), ("speed", "m/s")):
                yield Field(f"log_{name}_{n}", unit, f"{name} of event {n}", LOG)


def slopes(dynamics: Dynamics) -> Iterator[Field]:
    """How fast states change where forces at stops, or those that hold joints, have been asked for."""
    for v in dynamics.states[dynamics.count :]:
        yield Field(f"{v}_slope", "", f"time derivative of {v}", SCRATCH, book=v == "work")


def guard_fields(dynamics: Dynamics) -> Iterator[Field]:
    """Which laws of guards hold, and which joints stick."""
    for b in dynamics.sticking:
        yield Field(b.rest, "", f"position at which {b.name} sticks", STATE)
        yield Field(f"force_{b.name}", "N m or N", "that holds the joint", SCRATCH)
        yield Field(f"alpha_{b.name}", "", "acceleration of the joint", SCRATCH)
    for b, _ in dynamics.gripped:
        yield Field(f"limit_{b.name}", "N m or N", "of the friction at rest", SCRATCH)
    for b in dynamics.guards:
        yield Field(b.side, "", "which law holds: 1 or -1; 0 of a joint that sticks", SCRATCH)
        yield Field(b.pull, "", "value of the guard, positive where the law does not hold", SCRATCH)
        yield from copies((b.side, b.pull), "{}_start", "before the common step")
        yield Field(f"{b.pull}_trial", "", "at the start of the trial step", SCRATCH)
        yield Field(f"middle_{b.name}", "", "in the middle of the step", SCRATCH)
        yield Field(f"inner_{b.name}", "", "the greatest at a stage between the ends of the step", SCRATCH)
    if dynamics.weighs_laws:
        yield Field("departure", "m/s", "by which laws that hold no more lead off the motion", SCRATCH)
        yield Field("target", "", "number of the boundary whose event is sought", SCRATCH)
        for b in dynamics.guards:
            yield Field(b.left, "", "has passed 0 where the trial step starts", SCRATCH, truth=True)
    if dynamics.impulses_change_laws:
        yield Field("resolving", "", "contacts are being resolved", SCRATCH, truth=True)


def copies(names: Iterable[str], form: str, doc: str) -> Iterator[Field]:
    """Scratch fields that hold earlier values of others."""
    for name in names:
        yield Field(form.format(name), "", f"{name} {doc}", SCRATCH, book=name == "work")
