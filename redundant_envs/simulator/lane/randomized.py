"""Numbers of a lane that every episode draws anew, and all that follows from them alone."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping

from redundant_envs.language.algebra import logical_not, where
from redundant_envs.scenes.numbers import ends_of, entries_of
from redundant_envs.scenes.ranges import Range
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.fields import PARAMETER, Variable, variables
from redundant_envs.simulator.lane.memory import Lane

PURPOSE = 1 << 31
"""Bit of the second word of Philox's counter in which these draws differ from all others, whose second word
is 0 or a count of control steps."""
Stream = tuple[tuple[int, int], list[str]]
"""Two words of Philox's counter, to the first of which the number of a group of four draws is added, and the
fields of the draws."""


class Randomized:
    """The ranges of a scene, and of the task of its environments, in a lane."""

    def __init__(self, dynamics: Dynamics, of_task: Mapping[str, float]) -> None:
        self.dynamics = dynamics
        self.drawn: dict[Range, list[str]] = entries_of(dynamics.scene, dynamics.scene.randomize, of_task)
        self._nominal = {**dynamics.scene.parameters(), **of_task}
        field_of = dynamics.parameters.field_of
        self.fields_by_name = {one.name: [*map(field_of, names)] for one, names in self.drawn.items()}
        """For every range the fields that it draws."""
        self.entries = [name for names in self.drawn.values() for name in names]

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes: what the draws follow from, and draws of an episode."""
        for name in self.numbers():
            yield Variable(name, "", "of the range of a number", PARAMETER, at_reset=True)
        for name in map(fixed, self.entries):
            doc = "whether an option of a reset has set the number, which then is not drawn"
            yield Variable(name, "", doc, PARAMETER, truth=True, at_reset=True)
        for _, draws in self.streams():
            yield from variables(draws, "uniform draw in (0, 1)")

    def numbers(self) -> dict[str, float]:
        """Numbers of the ranges by their fields: those of distributions, and the scene's own for factors."""
        found: dict[str, float] = {}
        for one, names in self.drawn.items():
            found |= {_of(one, part): value for part, value in one.distribution.numbers().items()}
            found |= {f"nominal {name}": self._nominal[name] for name in names if one.scale}
        return found

    def ends(self) -> dict[str, tuple[float, float]]:
        """The least and the largest value of each scalar parameter that is drawn."""
        return ends_of(self.drawn, self._nominal)

    def streams(self) -> list[Stream]:
        """A stream of draws for each range, which follows from the name alone: no range changes the draws of
        another one."""
        made = []
        for one, names in self.drawn.items():
            digest = hashlib.sha256(one.name.encode()).digest()
            first, second = (int.from_bytes(digest[k : k + 4], "big") for k in (0, 4))
            draws = [_of(one, f"draw {k + 1}") for k in range(1 if one.shared else len(names))]
            made.append(((first & ~0xFF, PURPOSE | second >> 1), draws))
        return made

    def draw(self, lane: Lane) -> None:
        """Set the numbers of the lanes that are ``resetting``."""
        for (one, names), (_, draws) in zip(self.drawn.items(), self.streams(), strict=True):
            formula, parts = one.distribution.formula, one.distribution.numbers()
            given = [lane[_of(one, part)] for part in parts]
            values = [formula(lane[name], *given) for name in draws]
            for k, name in enumerate(names):
                nominal = lane[f"nominal {name}"] if one.scale else 1.0
                value = one.drawn(values[0 if one.shared else k], nominal)
                field = self.dynamics.parameters.field_of(name)
                drawn = lane.resetting & logical_not(lane[fixed(name)])
                lane[field] = where(drawn, value, lane[field])

    def prepare(self, lane: Lane) -> None:
        """What follows from the numbers alone, in the lanes that are ``resetting``."""
        parameters = self.dynamics.parameters
        made = parameters.prepare(lane.values(parameters.values))
        for name, value in made.items():
            lane[name] = where(lane.resetting, value, lane[name])


def fixed(name: str) -> str:
    """The field that says whether an option of a reset has set a number."""
    return f"fixed {name}"


def _of(one: Range, part: str) -> str:
    return f"{part} of {one.name}"
