"""Episodes of a task: efforts from actions, reward and faults after an interval, observation, new starts."""

import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property, reduce
from typing import Any

from redundant_envs.effects.hooks import Sensing
from redundant_envs.effects.obstacles import closest_names
from redundant_envs.language import algebra
from redundant_envs.language.algebra import (
    any_of,
    logical_not,
    maximum,
    minimum,
    numbered,
    total,
    where,
)
from redundant_envs.language.quantities import Quantities, check_names
from redundant_envs.scenes.numbers import ends_of, entries_of
from redundant_envs.scenes.ranges import Range
from redundant_envs.scenes.scene import identifier
from redundant_envs.simulator.lane.dynamics import INTERVALS, Dynamics
from redundant_envs.simulator.lane.faults import GIVEN_UP, Fault, angle_fault, either, is_observable
from redundant_envs.simulator.lane.fields import PARAMETER, STATE, Layout, Variable, copies, engine, variables
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.sensing import measured, reads_nonsense
from redundant_envs.tasks.base import Task, depth_beyond, range_of_starts, spring_limits, start_position
from redundant_envs.tasks.checks import taken_by

BEGUN = "{}_begun"
TIP, GOAL = ("tip_x", "tip_y"), ("goal_x", "goal_y")
"""Achieved and desired goal, the last columns of the outputs."""
ENDS = ("terminated", "truncated", "reward")
"""Outputs about the end of a step. They stay when a new episode begins in the same step."""
COUNTS = ("steps", "saturated", "numerics")
"""What every lane remembers of its episode."""
SPENT = ("evaluations_sum", "events_sum", "error_most")
"""What lanes with steps of their own remember beside it."""
TABLES = {"flags": "i8", "counts": "i64", "values": "f64"}
"""Tables that a step of an environment fills, and the types of their numbers."""
PURPOSE = 1 << 31
"""Bit of the second word of Philox's counter in which these draws differ from all others, whose second word
is 0 or a count of control steps."""
Stream = tuple[tuple[int, int], list[str]]
"""Two words of Philox's counter, to the first of which the number of a group of four draws is added, and the
fields of the draws."""


class Episode:
    """Episodes of the lanes of an environment, around their motion."""

    def __init__(
        self, dynamics: Dynamics, task: Task, observed_numbers: tuple[str, ...] = (), decides: bool = False
    ) -> None:
        """``observed_numbers`` are fields that an observation shows after the quantities of the task; with
        ``decides`` an action may last for several control steps."""
        self.decides = decides
        scene = dynamics.scene
        self.task, self.dynamics, self.arm = task, dynamics, dynamics.arm
        self.functions = (*dynamics.field, *dynamics.clearances, *task.functions(scene))
        """Functions of the field and of distances from obstacles, and those of the task."""
        self.interval = Interval(dynamics, self._asks_for_closest())
        self.features = self.interval.features
        self.actions = tuple(f"action{k + 1}" for k in range(len(dynamics.commands)))
        self.controlled = scene.effort_units()
        self.efforts = tuple(f"effort_share{k + 1}" for k in range(len(self.controlled))) or self.actions
        """Fields of the efforts that pictures show, and that functions of the task take as action1, ...: the
        actions, or what the controller of a mode of actions asks for at the end of a step."""
        starts = (f"u{k + 1}" for k in range(dynamics.count))
        self.draws = (*starts, *(f"draw{k + 1}" for k in range(task.draws)))
        """Uniform draws of an episode: of the start of each joint, then those of the task."""
        self.terms: tuple[str, ...] = task.reward_terms(scene)
        self.returns = tuple(f"{t}_sum" for t in self.terms)
        self.counted_once = self.returns if decides and task.goal_conditioned else ()
        """Sums of terms of which the last control step of a decision alone counts, as in its reward."""
        self.goal = GOAL if set(GOAL) <= set(task.memory) else ()
        self.held_outputs = (*ENDS, *task.held_outputs)
        self.placements = task.placements(scene)
        self.randomized = Randomized(dynamics, task.parameters(), self.placements)
        self.drawn = tuple(itertools.chain(*self.randomized.fields_by_name.values()))
        """Fields of the numbers that every episode draws anew."""
        of_effects = [name for name in (*scene.parameters(), *scene.states()) if "." in name]
        self.aliases = {**{identifier(name): name for name in of_effects}, **task.aliases(scene)}
        """What functions of the task call numbers and states of effects -> their fields."""
        self.observed_numbers = observed_numbers
        self.observed = (*task.observation(scene), *observed_numbers)
        self.sensors = bool(scene.attached.of(Sensing))
        """Whether observations follow from readings of sensors."""
        has = {"events_sum": bool(self.features.stops), "error_most": scene.tolerance is not None}
        counts = self.features.counts_evaluations
        spent = (name for name in SPENT if counts and has.get(name, True))
        self.counts: tuple[str, ...] = (*self.returns, *spent, *COUNTS)
        """What a lane remembers of its episode beside its state and the task's memory."""

    def _asks_for_closest(self) -> bool:
        """Whether the task takes, shows or remembers how near the arm came to an obstacle within a step."""
        task = self.task
        taken = {name for f in self.functions for name in algebra.arguments_of(f)}
        taken |= {*task.metrics, *task.updates.values(), *task.moves.values()}
        return not taken.isdisjoint(closest_names(self.dynamics.scene.attached))

    @cached_property
    def replaces_goal(self) -> bool:
        """Whether every step computes the goal anew, wherever it was."""
        scene, moves = self.dynamics.scene, self.task.moves
        return any(n in moves and n not in taken_by(moves[n], self.task, scene) for n in self.goal)

    @cached_property
    def tables(self) -> dict[str, tuple[str, ...]]:
        beyond = ("beyond_limit",) if spring_limits(self.dynamics.scene) else ()
        totals = [n for n in SPENT if n in self.counts and n != "error_most"]
        most = ("error_most",) if "error_most" in self.counts else ()
        measured = (m for m in self.task.metrics if m not in self.task.flags)
        return {
            "flags": ("terminated", "truncated", *(m for m in self.task.metrics if m in self.task.flags)),
            "counts": ("numerics", "saturated", "steps", *totals),
            "values": ("reward", *measured, *beyond, *most, *self.returns, *self.drawn, *TIP, *self.goal),
        }

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes, those of the interval included."""
        task, owner = self.task, f"the task {type(self.task).__name__}"
        yield from self.interval.fields()
        if not self.features.local:
            yield from copies(self.features.saved, "{}_start", "when the interval began")
        yield from variables(task.parameters(), "number", PARAMETER, owner=owner)
        yield from engine("limit")
        yield from variables(task.memory, "memory", STATE, owner=owner)
        yield from variables(self.returns, "sum of a reward term over the episode", STATE)
        begun = map(BEGUN.format, self.counted_once)
        yield from variables(begun, "the same before a decision", STATE)
        yield from engine(*self.counts[len(self.returns) :], *ENDS)
        yield from variables(task.held_outputs, "held output", STATE, owner=owner)
        yield from variables(self.actions, "action in [-1, 1] of the last step, which pictures show", STATE)
        if self.controlled:
            yield from variables(
                self.efforts, "effort at the end of the last step, as a share of its limit", STATE
            )
        yield from variables(self.draws, "uniform draw in (0, 1)")
        yield from self.randomized.fields()
        yield from engine("resetting", *(("over", "refused") if self.decides else ()))

    def layout(self) -> Layout:
        self.interval.layout()  # refuses an arm whose quantities are not its own
        layout = Layout(self.fields())
        shown = dict.fromkeys((*TIP, *GOAL), "of the engine: every step has it beside info")
        shown |= {name: layout.fields[name].whose for name in (*self.counts, *ENDS)}
        check_names(f"{type(self.task).__name__}.metrics", self.task.metrics, shown)
        return layout

    def quantities(self, lane: Lane, known: Mapping[str, Any], functions: Any = None) -> Quantities:
        """Quantities of the arm and the task."""
        if functions is None:
            functions = (*self.dynamics.functions, *self.functions)
        names = (*self.dynamics.parameters.numbers, *self.task.parameters(), "interval", "steps")
        numbers, angles = {n: lane[n] for n in names}, {**self.arm.sincos, **self.task.angles}
        return Quantities({**numbers, **known}, functions, angles, (), self.aliases)

    def quantities_now(self, lane: Lane) -> Quantities:
        """The same after an interval."""
        states = (*self.dynamics.states, *self.dynamics.effect_states.updated)
        memory = (*self.task.memory, *self.actions, *self.features.watch.closest)
        known = lane.values((*states, *memory))
        if self.controlled:
            known |= zip(
                numbered("action{}", len(self.efforts)), self.efforts_asked(lane, known), strict=True
            )
        return self.quantities(lane, known)

    def efforts_asked(self, lane: Lane, known: Mapping[str, Any]) -> list[Any]:
        """Efforts that the controller of a mode of actions asks for at the end of an interval, as shares."""
        commands = lane.values(self.dynamics.commands) | dict.fromkeys(self.dynamics.passed, 0.0)
        x = self.quantities(lane, {**known, **commands})
        self.dynamics.set_field(x)
        efforts = self.dynamics.scene.attached.efforts_behind(self.controlled[0].rpartition(".")[0], x)
        return [effort / lane[limit] for effort, limit in zip(efforts, self.controlled, strict=True)]

    # ---- a control step --------------------------------------------------------------------------------

    def command(self, lane: Lane) -> None:
        """Commands from actions: saturated and counted; a non-finite action commands none and is recorded."""
        if not self.features.local:
            lane.copy(self.features.saved, to="{}_start")
        defect, count = self.take_actions(lane)
        self.set_commands(lane)
        lane.numerics = where(defect == 0.0, 0.0, float(Fault.BAD_ACTION))
        lane.saturated = lane.saturated + where(defect == 0.0, count, 0.0)

    def take_actions(self, lane: Lane) -> tuple[Any, Any]:
        """Actions as they are used; 0 if all are finite, and how many of them were saturated."""
        count: Any = 0.0
        defect: Any = 0.0
        for name in self.actions:
            action = lane[name]
            clipped = minimum(maximum(action, -1.0), 1.0)
            count = count + where(clipped != action, 1.0, 0.0)
            defect = defect + (action - action)
            lane[name] = where(action - action == 0.0, clipped, 0.0)
        return defect, count

    def set_commands(self, lane: Lane) -> None:
        for command, action, unit in zip(
            self.dynamics.commands, self.actions, self.dynamics.scene.action_units(), strict=True
        ):
            lane[command] = lane[action] * lane[unit]

    def decide(self, lane: Lane) -> None:
        """Begin a decision, which lasts for several control steps: its action counts once."""
        defect, count = self.take_actions(lane)
        lane.refused = where(defect == 0.0, 0.0, float(Fault.BAD_ACTION))
        lane.saturated = lane.saturated + where(defect == 0.0, count, 0.0)
        lane.over, lane.reward, lane.numerics = False, 0.0, 0.0
        lane.set(self.task.summed, [0.0] * len(self.task.summed))
        lane.copy(self.counted_once, to=BEGUN)

    def begin_step_of_decision(self, lane: Lane) -> None:
        if not self.features.local:
            lane.copy(self.features.saved, to="{}_start")
        self.set_commands(lane)

    def finish_step_of_decision(self, lane: Lane) -> None:
        """After a control step of a decision: rewards, but for those of goals, and costs are summed, faults
        collected; a lane whose episode has ended stays as it is."""
        over, memory = lane.over, (*self.task.memory, *self.task.held_outputs)
        efforts = self.efforts if self.controlled else ()
        before = lane.values((*memory, *self.counts, *ENDS, *efforts))
        lane.numerics = lane.refused
        lane.copy(self.counted_once, of=BEGUN)
        self.finish_control_step(lane)
        self.interval.undo(lane, over)
        lane.numerics = either(before["numerics"], lane.numerics)
        if not self.task.goal_conditioned:
            lane.reward = before["reward"] + lane.reward
        for name in self.task.summed:
            lane[name] = before[name] + lane[name]
        lane.set_where(over, before)
        lane.over = (lane.terminated > 0.0) | (lane.truncated > 0.0)

    def finish_control_step(self, lane: Lane) -> None:
        """After an interval: faults, task memory, reward, ends of episodes; a faulty lane is undone."""
        interval, task, states = self.interval, self.task, self.dynamics.states
        interval.update_effect_states(lane)
        defect = interval.step.defect(lane.get((*states, *self.dynamics.effect_states.updated)))
        if self.sensors:
            x = self.quantities_now(lane)
            defect = defect + where(reads_nonsense(self.dynamics.scene.attached, x), math.nan, 0.0)
            lane.next_part()
        fastest = reduce(maximum, (abs(lane[v]) for v in self.arm.rates))
        observable = is_observable(self.arm, lane, fastest)
        code = lane.numerics + where((defect == 0.0) & observable, 0.0, float(Fault.NON_FINITE))
        if self.features.local:
            code = code + where(lane.fault >= GIVEN_UP, lane.fault, 0.0)
        fast = where(logical_not(code > 0.0) & (fastest > lane["speed_bound"]), float(Fault.SPEED_BOUND), 0.0)
        if task.speed_bound_ends:
            code = code + fast
        faulty = code > 0.0
        interval.undo(lane, faulty)
        if task.moves:
            x = self.quantities_now(lane)
            for name, source in task.moves.items():
                lane[name] = where(faulty, lane[name], x[source])
        x = self.quantities_now(lane)
        taking = [f for f in task.reward_functions(self.dynamics.scene) if "paid" in algebra.arguments_of(f)]
        earned = [t for t in self.terms if not any(t in algebra.gives_of(f) for f in taking)]
        x["ended"] = code
        if taking:
            x["paid"] = total(lane[f"{t}_sum"] + x[t] for t in earned)
        if self.controlled:
            lane.set(self.efforts, x.each(numbered("action{}", len(self.efforts))))
        lane.reward = total(x.each(self.terms))
        for t in self.terms:
            lane[f"{t}_sum"] = lane[f"{t}_sum"] + x[t]
        lane.set(task.updates, x.each(task.updates.values()))
        numerics = code if task.speed_bound_ends else code + fast
        if self.features.local:
            numerics = numerics + where(lane.fault < GIVEN_UP, lane.fault, 0.0)
        lane.numerics = numerics + angle_fault(self.arm, lane)
        lane.steps = lane.steps + 1.0
        ended = any_of([faulty, *(x[name] > 0.0 for name in task.ends)])
        lane.terminated = where(ended, 1.0, 0.0)
        lane.truncated = where(lane.steps >= lane.limit, 1.0, 0.0)
        lane.set(task.held_outputs, x.each(task.held_outputs))
        if "evaluations_sum" in lane:
            lane.evaluations_sum = lane.evaluations_sum + lane.evaluations
        if "events_sum" in lane:
            lane.events_sum = lane.events_sum + lane.impacts
        if "error_most" in lane:
            lane.error_most = maximum(lane.error_most, lane.error)

    # ---- observation -----------------------------------------------------------------------------------

    def observe(self, lane: Lane) -> dict[Any, Any]:
        """Observations, from readings of sensors, and outputs: functions of the state and the goal alone."""
        memory = (*self.task.memory, *self.counts, *self.held_outputs, *self.drawn)
        states = (*self.dynamics.states, *self.dynamics.effect_states.updated)
        known = lane.values((*states, *self.task.memory))
        x = self.quantities(lane, known)
        read = measured(self.dynamics.scene.attached, self.arm, x)
        seen = self.quantities(lane, {**known, **read}) if read else x
        count = len(self.observed)
        of_task = self.observed[: count - len(self.observed_numbers)]
        values = [*(seen[name] for name in of_task), *(lane[name] for name in self.observed_numbers)]
        shown = {("obs", "f32", k, count): value for k, value in enumerate(values)}
        for table, element in TABLES.items():
            for k, name in enumerate(self.tables[table]):
                if name == "beyond_limit":
                    limits = spring_limits(self.dynamics.scene)
                    depths = (depth_beyond(x[f"phi{j + 1}"], lane[a], lane[b]) for j, a, b in limits)
                    value = reduce(maximum, depths)
                elif name == "numerics" and self.sensors:  # also for a start whose readings are not finite
                    bad = reads_nonsense(self.dynamics.scene.attached, x) & (lane.numerics == 0.0)
                    value = where(bad, float(Fault.NON_FINITE), lane.numerics)
                else:
                    value = lane[name] if name in memory else x[name]
                shown[table, element, k, 0] = value > 0.0 if table == "flags" else value
        return shown

    # ---- a new episode ---------------------------------------------------------------------------------

    def reset(self, lane: Lane) -> None:
        """A new episode in the lanes that are ``resetting``, from their draws and their numbers."""
        task, arm = self.task, self.arm
        drawn = [m for m in task.memory if m not in task.updates]
        x = self._begun(lane)
        values = {name: x[name] for name in (*arm.coordinates, *drawn)}
        remembered = [m for m in (*task.memory, *self.counts) if m not in drawn]
        zero = [*arm.rates, *remembered, *self.features.active, *self.held_outputs]
        zero += ["next_step"] if "next_step" in lane else []
        zero += [INTERVALS] if self.dynamics.draws else []
        values |= self.dynamics.effect_states.initial
        lane.set_where(lane.resetting, {**values, **dict.fromkeys(zero, 0.0)})
        self.begin_states(lane)

    def _begun(self, lane: Lane) -> Quantities:
        """Quantities of a start, from the draws of the episode."""
        functions = (
            *(f for f in self.dynamics.functions if "phi1" not in algebra.gives_of(f)), *self.functions,
            *self.task.begin_functions(self.dynamics.scene), self.arm.coordinates_of_joints,
        )  # fmt: skip
        draws = {name: lane[name] for name in self.draws[self.dynamics.count :]}
        for joint in range(self.dynamics.count):  # uniform in its range of starts, inside the lane's limits
            low, high = range_of_starts(self.task, self.dynamics.scene, joint, lane.__getitem__)
            draws[f"phi{joint + 1}"] = start_position(lane[f"u{joint + 1}"], low, high)
        return self.quantities(lane, draws, functions)

    def place(self, lane: Lane) -> None:
        """Numbers of effects that the task sets, in the lanes that are ``resetting``."""
        x = self._begun(lane)
        for number, quantity in self.placements.items():
            here = lane.resetting & logical_not(lane[fixed(number)])
            lane.set_where(here, {self.dynamics.parameters.field_of(number): x[quantity]})

    def begin_states(self, lane: Lane) -> None:
        """States of effects whose values at a start are computed, in the lanes that are ``resetting``."""
        lane.set_where(lane.resetting, self.interval.initial_states(lane))


class Randomized:
    """The ranges of a scene, and of the task of its environments, in a lane; and the numbers that it sets."""

    def __init__(self, dynamics: Dynamics, of_task: Mapping[str, float], placed: Iterable[str]) -> None:
        self.dynamics = dynamics
        self.drawn: dict[Range, list[str]] = entries_of(dynamics.scene, dynamics.scene.randomize, of_task)
        self._nominal = {**dynamics.scene.parameters(), **of_task}
        field_of = dynamics.parameters.field_of
        self.fields_by_name = {one.name: [*map(field_of, names)] for one, names in self.drawn.items()}
        self.fields_by_name |= {name: [field_of(name)] for name in placed}
        """For every range the fields that it draws, and for every number that the task sets its field."""
        self.entries = [*(name for names in self.drawn.values() for name in names), *placed]

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes: what the draws follow from, and draws of an episode."""
        yield from variables(self.numbers(), "of the range of a number", PARAMETER)
        doc = "whether an option of a reset has set the number, which then is not drawn"
        yield from variables(map(fixed, self.entries), doc, PARAMETER, truth=True)
        for _, draws in self.streams():
            yield from variables(draws, "uniform draw in (0, 1)")

    def numbers(self) -> dict[str, float]:
        """Numbers of the ranges by their fields: those of distributions, and the scene's own for factors."""
        values: dict[str, float] = {}
        for one, names in self.drawn.items():
            values |= {_of(one, part): value for part, value in one.distribution.numbers().items()}
            values |= {f"nominal {name}": self._nominal[name] for name in names if one.scale}
        return values

    def ends(self) -> dict[str, tuple[float, float]]:
        """The least and the largest value of each scalar parameter that is drawn."""
        return ends_of(self.drawn, self._nominal)

    def streams(self) -> list[Stream]:
        """A stream of draws for each range, from its name alone: no range changes the draws of another."""
        streams = []
        for one, names in self.drawn.items():
            digest = hashlib.sha256(one.name.encode()).digest()
            first, second = (int.from_bytes(digest[k : k + 4], "big") for k in (0, 4))
            draws = [_of(one, f"draw {k + 1}") for k in range(1 if one.shared else len(names))]
            streams.append(((first & ~0xFF, PURPOSE | second >> 1), draws))
        return streams

    def draw(self, lane: Lane) -> None:
        """Set the numbers of the lanes that are ``resetting``."""
        for (one, names), (_, draws) in zip(self.drawn.items(), self.streams(), strict=True):
            formula, parts = one.distribution.formula, one.distribution.numbers()
            numbers = [lane[_of(one, part)] for part in parts]
            values = [formula(lane[name], *numbers) for name in draws]
            for k, name in enumerate(names):
                nominal = lane[f"nominal {name}"] if one.scale else 1.0
                value = one.drawn(values[0 if one.shared else k], nominal)
                drawn = lane.resetting & logical_not(lane[fixed(name)])
                lane.set_where(drawn, {self.dynamics.parameters.field_of(name): value})

    def prepare(self, lane: Lane) -> None:
        """What follows from the numbers alone, in the lanes that are ``resetting``."""
        parameters = self.dynamics.parameters
        lane.set_where(lane.resetting, parameters.prepare(lane.values(parameters.values)))


def fixed(name: str) -> str:
    """The field that says whether an option of a reset has set a number."""
    return f"fixed {name}"


def _of(one: Range, part: str) -> str:
    return f"{part} of {one.name}"
