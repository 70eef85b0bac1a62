"""Fields that each of several objects has, declared once: in the class of these objects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import overload

from redundant_envs.lane.memory import SCRATCH, Field, Lifetime


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

    def own(self, *names: str) -> Iterator[Field]:
        """Some of its fields, as lanes declare them."""
        return (getattr(type(self), name).field(self) for name in names)


class Own:
    """A field that each object of a class has: with ``force = Own("N", "that holds the slider")`` in the
    class, ``lane[stop.force]`` is the force of one stop."""

    def __init__(
        self, unit: str, doc: str, lifetime: Lifetime = SCRATCH, truth: bool = False, book: bool = False
    ) -> None:
        """``{}`` in ``doc`` stands for the name of the owner; for the others see :class:`Field`."""
        self.unit, self.doc, self.lifetime, self.truth, self.book = unit, doc, lifetime, truth, book

    def __set_name__(self, kind: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, owner: None, kind: type) -> Own: ...
    @overload
    def __get__(self, owner: Owner, kind: type) -> FieldName: ...
    def __get__(self, owner: Owner | None, kind: type) -> Own | FieldName:
        return self if owner is None else FieldName(f"{self.name}_{owner.name}")

    def field(self, owner: Owner) -> Field:
        """The field of one object."""
        name, doc = f"{self.name}_{owner.name}", self.doc.format(owner.name)
        return Field(name, self.unit, doc, self.lifetime, self.truth, self.book)


def copies(names: tuple[str, ...], form: str, doc: str) -> Iterator[Field]:
    """Scratch fields that hold earlier values of others."""
    for name in names:
        yield Field(form.format(name), "", f"{name} {doc}", SCRATCH, book=name == "work")
