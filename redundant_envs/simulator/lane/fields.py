"""Fields of lanes: declared once, with unit, lifetime and a sentence, by the class that owns them.

A field that every lane has once is an :class:`EngineField` of :class:`EngineFields`, and read as
``lane.error``. One that each of several objects has is an :class:`Own` of their class, and read as
``lane[stop.force]``. Names that follow from an arm, an effect or a task are plain text.
"""

import enum
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any


class Lifetime(enum.StrEnum):
    """How long a field is kept; also the name of the memory that holds it."""

    STATE = "state"  # from interval to interval: saved, restored and reset
    PARAMETER = "parameter"  # set by a user, or following from such numbers; shared until lanes differ
    SCRATCH = "scratch"  # within an interval
    LOG = "log"  # results of an interval, to be read after it


STATE, PARAMETER, SCRATCH, LOG = Lifetime
ENGINE = "the engine"
"""Owner of the names that every lane has, whatever its arm, effects and task."""


@dataclass(frozen=True)
class Variable:
    """A number that every lane has: the declaration of a field."""

    name: str
    unit: str
    doc: str
    lifetime: Lifetime
    truth: bool = False  # whether it holds a condition, as 1 or 0
    book: bool = False  # whether it is a record of the motion, which does not depend on it
    owner: str = ENGINE  # who has given it its name

    @property
    def whose(self) -> str:
        """Whose name it is, and what it means."""
        return f"of {self.owner}: {self.doc}"


class Layout:
    def __init__(self, fields: Iterable[Variable]) -> None:
        self.fields: dict[str, Variable] = {}
        self.rows: dict[Lifetime, dict[str, int]] = {lifetime: {} for lifetime in Lifetime}
        for f in fields:
            self.add(f)

    def add(self, f: Variable) -> None:
        if f.name in self.fields:
            first = self.fields[f.name].whose
            raise ValueError(f"{f.name!r} is a name {first}, and {f.whose}; rename one of them")
        self.fields[f.name] = f
        self.rows[f.lifetime][f.name] = len(self.rows[f.lifetime])

    def __contains__(self, name: str) -> bool:
        return name in self.fields

    def row_of(self, name: str) -> tuple[str, int]:
        """Memory and row of a field; an unknown name lists those there are."""
        if name not in self.fields:
            raise AttributeError(f"a lane has no field {name!r}; it has {', '.join(self.fields)}")
        lifetime = self.fields[name].lifetime
        return str(lifetime), self.rows[lifetime][name]

    def places(self) -> dict[str, tuple[str, int]]:
        return {name: self.row_of(name) for name in self.fields}

    def size(self, lifetime: Lifetime) -> int:
        return len(self.rows[lifetime])


class FieldDeclaration:
    """A field, as a class declares it; for the arguments see :class:`Variable`."""

    def __init__(
        self, unit: str, doc: str, lifetime: Lifetime = SCRATCH, truth: bool = False, book: bool = False
    ) -> None:
        self.declared = Variable("", unit, doc, lifetime, truth, book)

    def __set_name__(self, kind: type, name: str) -> None:
        self.name = name


class Own(FieldDeclaration):
    """A field that each object of a class has, and that ends with its name: with ``force = Own("N", "...")``
    in the class, ``lane[stop.force]`` is the force of one stop."""

    def __get__(self, owner: Any, kind: type) -> Any:
        return self if owner is None else f"{self.name}_{owner.name}"


def variables(
    names: Iterable[str], doc: str, lifetime: Lifetime = SCRATCH, unit: str = "", **more: Any
) -> Iterator[Variable]:
    """Fields of a kind, without a unit, or with several; ``more`` as for :class:`Variable`."""
    return (Variable(name, unit, doc, lifetime, **more) for name in names)


def copies(names: Iterable[str], form: str, doc: str) -> Iterator[Variable]:
    """Scratch fields that hold other values of fields."""
    for name in names:
        yield Variable(form.format(name), "", f"{name} {doc}", SCRATCH, book=name == "work")


class EngineField(FieldDeclaration):
    """A field that a lane has once: a descriptor of :class:`~redundant_envs.simulator.lane.memory.Lane`."""

    def __get__(self, lane: Any, kind: type) -> Any:
        return self if lane is None else lane[self.name]

    def __set__(self, lane: Any, value: Any) -> None:
        lane[self.name] = value


class EngineFields:
    """The fields that a lane has once, whatever its arm, effects and task, by what sets them."""

    __slots__ = ()

    # ---- the interval
    interval = EngineField("s", "control interval", PARAMETER)
    h = EngineField("s", "length of the common step", PARAMETER)
    tip_tolerance = EngineField("SI", "parameter of the scene", PARAMETER)
    least_step_rate = EngineField("SI", "follows from parameters alone", PARAMETER)
    work = EngineField("J", "work of motors and of forces without a potential", STATE, book=True)
    error = EngineField("m", "estimated tip error of the interval so far")
    fault = EngineField("", "faults of the interval")
    evaluations = EngineField("", "evaluations of the right-hand side")

    # ---- its pieces, and attempts at all of them
    piece_end = EngineField("s", "end of the present piece of the interval")
    attempts = EngineField("", "times that the interval was crossed")
    again = EngineField("", "the interval has to be crossed again", truth=True)
    longest_step = EngineField("s", "longest step allowed in this attempt")
    divisions = EngineField("", "steps of the piece")
    shortest_step = EngineField("s", "shortest step of pieces with several")
    steps_taken = EngineField("", "steps of the pieces before")
    error_carried = EngineField("m", "error at the start of the piece")
    unsure = EngineField("", "the error of a piece so far may exceed its estimate", truth=True)
    carries_doubt = EngineField("", "one did at the start of the piece", truth=True)

    # ---- the common step
    reason = EngineField("", "why the lane leaves the common step (Reason)")
    error_start = EngineField("m", "error before the common step")
    min_steps = EngineField("", "least number of steps allowed; 0 where one may serve")
    impacts_start = EngineField("", "before the common step")

    # ---- the program of a lane
    state = EngineField("", "where the program of the lane waits")
    entered = EngineField("", "has just left the common step", truth=True)
    due = EngineField("", "has made the trial step that it asked for", truth=True)
    moving = EngineField("", "asks for a trial step", truth=True)
    touching = EngineField("", "asks for the forces at its stops", truth=True)
    complete = EngineField("", "has crossed its interval, or given it up", truth=True)
    next_step = EngineField("s", "length of the next step", STATE)
    steps_left = EngineField("", "planned steps that are left, or have been tried")
    left = EngineField("s", "left of the planned step where the trial step starts")
    error_trial = EngineField("m", "error at the start of the trial step")
    elapsed = EngineField("s", "time since the interval, or its piece, began")
    changes = EngineField("", "resolutions of contacts")
    at_stop = EngineField("", "contacts, or which joints stick, have to be resolved", truth=True)
    step = EngineField("s", "length of the trial step")
    searched = EngineField("", "trial steps in search of an event")
    for_turn = EngineField("", "seeks a turn, and no event", truth=True)
    target = EngineField("", "number of the boundary whose event is sought")
    side = EngineField("", "of its limit; of a release, that on which the trial step before ended")
    low = EngineField("s", "trial step before the event")
    high = EngineField("s", "trial step after it")
    gap_low = EngineField("", "value at the end of the one before")
    gap_high = EngineField("", "value at the end of the one after")
    tries = EngineField("", "trial steps of this search")

    # ---- laws, contacts and their log
    departure = EngineField("m/s", "by which laws that hold no more lead off the motion")
    resolving = EngineField("", "contacts are being resolved", truth=True)
    impacts = EngineField("", "impacts of the interval")
    lowest_bounce = EngineField("m", "height of a bounce below which it ends in rest")
    bounces_end = EngineField("s", "when all bounces that were left out would be over")
    bounce_missed = EngineField("", "there was an impact before", truth=True)
    span_start = EngineField("s", "when the common step began", book=True)
    logged_start = EngineField("", "events kept before the common step", book=True)
    logged = EngineField("", "events kept", STATE, book=True)

    # ---- the episode
    limit = EngineField("", "control steps of an episode", PARAMETER)
    steps = EngineField("", "control steps of the episode before this one", STATE)
    saturated = EngineField("", "entries of actions outside [-1, 1] in the episode", STATE)
    numerics = EngineField("", "faults of the last step", STATE)
    evaluations_sum = EngineField("", "evaluations of the equations of motion in the episode", STATE)
    events_sum = EngineField("", "events at stops in the episode", STATE)
    error_most = EngineField("", "largest estimated error of a control step in the episode, m", STATE)
    reward = EngineField("", "of the last step", STATE)
    terminated = EngineField("", "of the last step", STATE)
    truncated = EngineField("", "of the last step", STATE)
    over = EngineField(
        "", "the episode has ended before the last control step of the decision", STATE, truth=True
    )
    refused = EngineField("", "fault of the action of the decision", STATE)
    resetting = EngineField("", "a new episode begins", truth=True)


def engine(*names: str) -> Iterator[Variable]:
    """Declarations of some of these fields."""
    return (replace(getattr(EngineFields, name).declared, name=name) for name in names)
