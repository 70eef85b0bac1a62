"""Outputs of a step for each lane beside its observation: flags, counts and values, by name."""

from __future__ import annotations

import re
from collections.abc import Callable
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
        flags, counts, values = (len(names) for names in columns.tables.values())
        return cls(make((flags, lanes), np.bool_), make((counts, lanes), np.int64), make((values, lanes)))

    def lanes(self, chosen: Any) -> Outputs:
        """The columns of some lanes."""
        return Outputs(self.flags[:, chosen], self.counts[:, chosen], self.values[:, chosen])


class Columns:
    """Rows of the quantities of an episode in :class:`Outputs`."""

    def __init__(self, episode: Episode) -> None:
        self.tables = episode.tables
        self.goal = episode.goal
        self._places = {
            name: (k, row) for k, t in enumerate(self.tables.values()) for row, name in enumerate(t)
        }
        hidden = (*ENDS, *TIP, *GOAL)
        self.places_shown = [(name, *place) for name, place in self._places.items() if name not in hidden]
        """Quantities in ``info``: quantity, table, row."""
        labels = {**INFO_NAMES, **episode.task.labels}
        shown = (labels.get(n) or SUM.sub(r"return_\1", n) for n, *_ in self.places_shown)
        self.names = [*shown]  # names of these in ``info``

    def of(self, out: Outputs, name: str) -> Any:
        """A quantity of all lanes."""
        table, row = self._places[name]
        return out[table][row]

    def points(self, out: Outputs, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Two coordinates of all lanes, (lanes, 2)."""
        return np.stack([self.of(out, name) for name in names], axis=1)

    def info(self, out: Outputs, lane: int) -> dict[str, Any]:
        """Values for a lane's ``info``, as Python numbers."""
        tables = [table[:, lane].tolist() for table in out]
        values = (tables[table][row] for _, table, row in self.places_shown)
        return dict(zip(self.names, values, strict=True))
