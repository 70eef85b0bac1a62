"""Fields of lanes: declared once, with unit, lifetime and a sentence, by the class that owns them.

A field that every lane has once is an :class:`EngineField` of :class:`EngineFields`, and read as
``lane.error``. One that each of several objects has is an :class:`Own` of their class, and read as
``lane[stop.force]``. Names that follow from an arm, an effect or a task are plain text.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, overload


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
    at_reset: bool = False  # whether only the beginning of an episode reads it
    owner: str = ENGINE  # who has given it its name

    @property
    def whose(self) -> str:
        """Whose name it is, and what it means."""
        return f"of {self.owner}: {self.doc}"


class Layout:
    """Fields, and the rows that hold them."""

    def __init__(self, fields: Iterable[Variable]) -> None:
        self.fields: dict[str, Variable] = {}
        self.rows: dict[Lifetime, dict[str, int]] = {lifetime: {} for lifetime in Lifetime}
        for f in fields:
            self.add(f)

    def add(self, f: Variable) -> None:
        """Declare one more field."""
        if f.name in self.fields:
            raise ValueError(
                f"{f.name!r} is a name {self.fields[f.name].whose}, and {f.whose}; rename one of them"
            )
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
        """Memory and row of each field, by name."""
        return {name: self.row_of(name) for name in self.fields}

    def size(self, lifetime: Lifetime) -> int:
        """Number of rows of a memory."""
        return len(self.rows[lifetime])


class FieldName(str):
    """Name of a field of a lane, and those of its earlier values."""

    __slots__ = ()

    @property
    def start(self) -> FieldName:
        """Before the common step."""
        return FieldName(f"{self}_start")

    @property
    def trial(self) -> FieldName:
        """At the start of the trial step."""
        return FieldName(f"{self}_trial")


class Owner:
    """An object with fields of its own, whose names end with its name."""

    name: str

    def own(self, *names: str) -> Iterator[Variable]:
        """Some of its fields, as lanes declare them."""
        return (getattr(type(self), name).field(self) for name in names)


class Declared:
    """A field, as a class declares it; for the arguments see :class:`Variable`."""

    def __init__(
        self, unit: str, doc: str, lifetime: Lifetime = SCRATCH, truth: bool = False, book: bool = False
    ) -> None:
        self.unit, self.doc, self.lifetime, self.truth, self.book = unit, doc, lifetime, truth, book

    def __set_name__(self, kind: type, name: str) -> None:
        self.name = name


class Own(Declared):
    """A field that each object of a class has: with ``force = Own("N", "that holds the slider")`` in the
    class, ``lane[stop.force]`` is the force of one stop. ``{}`` in its sentence is the name of the owner."""

    @overload
    def __get__(self, owner: None, kind: type) -> Own: ...
    @overload
    def __get__(self, owner: Owner, kind: type) -> FieldName: ...
    def __get__(self, owner: Owner | None, kind: type) -> Own | FieldName:
        return self if owner is None else FieldName(f"{self.name}_{owner.name}")

    def field(self, owner: Owner) -> Variable:
        """The field of one object."""
        name, doc = f"{self.name}_{owner.name}", self.doc.format(owner.name)
        return Variable(name, self.unit, doc, self.lifetime, self.truth, self.book)


def copies(names: tuple[str, ...], form: str, doc: str) -> Iterator[Variable]:
    """Scratch fields that hold earlier values of others."""
    for name in names:
        yield Variable(form.format(name), "", f"{name} {doc}", SCRATCH, book=name == "work")


class EngineField(Declared):
    """A field that a lane has once: a descriptor of :class:`~redundant_envs.simulator.lane.memory.Lane`."""

    @overload
    def __get__(self, lane: None, kind: type) -> EngineField: ...
    @overload
    def __get__(self, lane: object, kind: type) -> Any: ...
    def __get__(self, lane: Any, kind: type) -> Any:
        return self if lane is None else lane[self.name]

    def __set__(self, lane: Any, value: Any) -> None:
        lane[self.name] = value

    def field(self, lifetime: Lifetime | None = None) -> Variable:
        """Its declaration, with another lifetime than usual."""
        return Variable(self.name, self.unit, self.doc, lifetime or self.lifetime, self.truth, self.book)
