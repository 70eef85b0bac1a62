"""A case that has been played, its counts, and the report of a broken promise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from redundant_envs.scene import Scene

from .cases import Array, Case
from .playing import Make, Step


@dataclass(frozen=True)
class Violation:
    """A broken promise: its call, its lane (-1: none), and by how much it was missed."""

    invariant: str
    call: int
    lane: int
    found: str


@dataclass
class Tally:
    """Counts of a run."""

    scenes: int = 0
    intervals: int = 0
    events: int = 0
    flagged: int = 0
    judged: int = 0
    """Unflagged intervals with a tolerance where the references agree."""
    books: int = 0
    """Intervals whose energies were compared."""
    refused: int = 0
    episodes: int = 0
    early_ends: int = 0
    failures: dict[str, int] = field(default_factory=dict)

    def add(self, other: Tally) -> None:
        for name, value in vars(other).items():
            if name == "failures":
                for invariant, count in value.items():
                    self.failures[invariant] = self.failures.get(invariant, 0) + count
            else:
                setattr(self, name, getattr(self, name) + value)


@dataclass
class Played:
    """A case, its results, and the factory of its simulators (tests tamper with them)."""

    case: Case
    steps: list[Step]
    make: Make
    tally: Tally

    @property
    def scene(self) -> Scene:
        return Scene.from_dict(self.case["scene"])

    def intervals(self) -> Iterator[tuple[int, Step]]:
        return ((k, s) for k, s in enumerate(self.steps) if s.status)


def same(one: Array, other: Array) -> Any:
    """Entries in which two arrays have the same bits; all NaN count as equal."""
    if one.dtype.kind != "f":
        return one == other
    whole = {8: np.int64, 4: np.int32}[one.dtype.itemsize]
    bits = np.ascontiguousarray(one).view(whole) == np.ascontiguousarray(other).view(whole)
    return bits | (np.isnan(one) & np.isnan(other))
