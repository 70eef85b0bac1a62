"""Outputs of a step for each lane beside its observation: flags, counts and values, by name."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.lane.episode import ENDS, GOAL, TIP, Episode

INFO_NAMES = {
    "saturated": "saturated_actions",
    "steps": "episode_steps",
    "evaluations_sum": "evaluations",
    "events_sum": "events",
    "error_most": "error_estimate",
}
DRAWN = "parameters"
"""Name in ``info`` of the numbers that the episode has drawn."""
SUM = re.compile(r"(.*?)(?:_term)?_sum$")
"""Names of sums over the episode, of terms of the reward."""


class Outputs(NamedTuple):
    """Tables with a row for each quantity and a column for each lane."""

    flags: NDArray[np.bool_]
    counts: NDArray[np.int64]
    values: NDArray[np.float64]

    @classmethod
    def made(cls, columns: Columns, lanes: int, make: Callable[..., Any] = np.empty) -> Outputs:
        """Tables for a number of lanes."""
        flags, counts, values = columns.heights
        return cls(make((flags, lanes), np.bool_), make((counts, lanes), np.int64), make((values, lanes)))

    def lanes(self, chosen: Any) -> Outputs:
        """The columns of some lanes."""
        return Outputs(self.flags[:, chosen], self.counts[:, chosen], self.values[:, chosen])


class Columns:
    """Rows of the quantities of an episode in :class:`Outputs`."""

    def __init__(self, episode: Episode) -> None:
        self.tables = episode.tables
        self.heights = [len(names) for names in self.tables.values()]
        self.goal = episode.goal
        self._places = {
            name: (k, row) for k, t in enumerate(self.tables.values()) for row, name in enumerate(t)
        }
        hidden = (*ENDS, *TIP, *GOAL, *episode.drawn)
        self.drawn_fields, named = episode.drawn, episode.randomized.fields_by_name
        self.drawn = {name: len(fields) for name, fields in named.items()}
        """Numbers that every episode draws, and how many entries each has: their fields are in this order."""
        self.places_shown = [(name, *place) for name, place in self._places.items() if name not in hidden]
        """Quantities in ``info``: quantity, table, row."""
        labels = {**INFO_NAMES, **episode.task.labels}
        shown = (labels.get(n) or SUM.sub(r"return_\1", n) for n, *_ in self.places_shown)
        self.names = [*shown]  # names of these in ``info``
        if self.drawn:
            self.names.append(DRAWN)
        self._names_and_masks = tuple(name for n in self.names for name in (n, f"_{n}"))
        self._unread = dict.fromkeys(self._names_and_masks, UNREAD)

    def of(self, out: Outputs, name: str) -> Any:
        """A quantity of all lanes."""
        table, row = self._places[name]
        return out[table][row]

    def points(self, out: Outputs, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Two coordinates of all lanes, (lanes, 2)."""
        return np.stack([self.of(out, name) for name in names], axis=1)

    def infos(self, out: Outputs) -> Info:
        """Values of all lanes for the ``infos`` of a vector environment, read when they are used, and with
        each a mask of the lanes that have it: all."""
        infos = Info(self._unread)
        infos.unread = self._all_shown, self._names_and_masks, out
        return infos

    def _all_shown(self, out: Outputs) -> list[NDArray[Any]]:
        rows = [out[table][row] for _, table, row in self.places_shown]
        masks = np.ones((len(self.names), out.flags.shape[1]), np.bool_)  # one call, not many
        if self.drawn:
            found = self.drawn_of([self.of(out, field) for field in self.drawn_fields])
            nested = {f"_{name}": masks[-1].copy() for name in found}  # as Gymnasium nests a dict in infos
            rows.append({**found, **nested})
        return [x for pair in zip(rows, masks, strict=True) for x in pair]

    def drawn_of(self, values: Iterable[Any]) -> dict[str, Any]:
        """The numbers that episodes have drawn, by name, from the values of their fields, of one lane or of
        all."""
        rest = iter(values)
        rows = {name: [*itertools.islice(rest, count)] for name, count in self.drawn.items()}
        return {name: row[0] if len(row) == 1 else np.stack(row, axis=-1) for name, row in rows.items()}

    def info(self, out: Outputs, lane: int) -> dict[str, Any]:
        """Values for a lane's ``info``, as Python numbers."""
        tables = [table[:, lane].tolist() for table in out]
        values = (tables[table][row] for _, table, row in self.places_shown)
        found = dict(zip(self.names, values, strict=False))
        if self.drawn:
            found[DRAWN] = self.drawn_of(float(self.of(out, field)[lane]) for field in self.drawn_fields)
        return found


class _Unread:
    def __repr__(self) -> str:
        return "<not read>"


UNREAD = _Unread()
"""What an :class:`Info` holds before it is read: no number, and no JSON, so a program that reads a dict past
its methods fails and gets no wrong number."""


class Info(dict[str, Any]):
    """``info`` of a step: a dict whose values are read from the numbers of the step when it is first used.

    Its keys are there from the beginning, so length and membership are those of any dict. Every method that
    could show or change a value first reads all of them. ``__iter__`` is one of these: ``dict(info)`` and
    ``**info`` read a dict past its methods only if it has the ``__iter__`` of dict. Copies and pickles are
    plain dicts.
    """

    __slots__ = ("unread",)
    unread: tuple[Callable[[Any], Sequence[Any]], tuple[str, ...], Any] | None
    """How the values are read, their names, and what they are read from; None once they are."""

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _read(info: Info) -> None:
    """Read the values if they are unread."""
    try:
        unread = info.unread
    except AttributeError:  # one that a program has made
        return
    if unread is not None:
        read, names, numbers = unread
        dict.update(info, zip(names, read(numbers)))  # noqa: B905 - strict takes time, and they are as many
        info.unread = None


def _reads_first(name: str) -> Callable[..., Any]:
    """A method of dict that first reads what is unread."""
    method = getattr(dict, name)

    @functools.wraps(method)
    def reading(self: Info, *given: Any, **named: Any) -> Any:
        _read(self)
        if given and type(given[0]) is Info:  # such as the other side of a comparison
            _read(given[0])
        return method(self, *given, **named)

    return reading


for _name in (
    "__getitem__", "__setitem__", "__delitem__", "__iter__", "__reversed__", "__eq__", "__ne__", "__or__",
    "__ror__", "__ior__", "__repr__", "clear", "copy", "get", "items", "pop", "popitem", "setdefault",
    "update", "values",
):  # fmt: skip
    setattr(Info, _name, _reads_first(_name))
