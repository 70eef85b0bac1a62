"""Outputs of a step for each lane beside its observation: flags, counts and values, by name."""

import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.simulator.lane.episode import ENDS, GOAL, TIP, Episode
from redundant_envs.support.values import shown

INFO_NAMES = {
    "saturated": "saturated_actions",
    "steps": "episode_steps",
    "evaluations_sum": "evaluations",
    "events_sum": "events",
    "error_most": "error_estimate",
}
ALL = "all"  # the value of info_keys that asks for every name
RETURN, SUM = "return_", re.compile(r"(.*?)(?:_term)?_sum$")
"""How sums of terms of the reward begin in ``info``, and how the quantities are named."""
DRAWN = "parameters"  # in info, the numbers that the episode has drawn


class Outputs(NamedTuple):
    """Tables with a row for each quantity and a column for each lane."""

    flags: NDArray[np.bool_]
    counts: NDArray[np.int64]
    values: NDArray[np.float64]

    @classmethod
    def allocate(cls, columns: "Columns", lanes: int, make: Callable[..., Any] = np.empty) -> "Outputs":
        flags, counts, values = columns.heights
        return cls(make((flags, lanes), np.bool_), make((counts, lanes), np.int64), make((values, lanes)))

    def lanes(self, chosen: Any) -> "Outputs":
        return Outputs(self.flags[:, chosen], self.counts[:, chosen], self.values[:, chosen])


class Columns:
    """Rows of the quantities of an episode in :class:`Outputs`; ``info_keys`` as in :func:`checked_keys`."""

    def __init__(self, episode: Episode, info_keys: Any = None) -> None:
        self.tables = episode.tables
        self.heights = [len(names) for names in self.tables.values()]
        self.goal = episode.goal
        self._places = {name: (k, i) for k, t in enumerate(self.tables.values()) for i, name in enumerate(t)}
        self.drawn_fields, named = episode.drawn, episode.randomized.fields_by_name
        self.drawn = {name: len(fields) for name, fields in named.items()}
        """Numbers that every episode draws, and how many entries each has: their fields are in this order."""
        labels = {**INFO_NAMES, **episode.task.labels}
        quantities = [name for name in self._places if name not in (*ENDS, *TIP, *GOAL, *episode.drawn)]
        shown = {labels.get(name) or SUM.sub(rf"{RETURN}\1", name): name for name in quantities}
        self.names = [*shown, DRAWN] if self.drawn else [*shown]
        asked = checked_keys(info_keys, self.names)
        self.names = [name for name in self.names if name in asked]  # in info
        self.shown = {name: shown[name] for name in self.names if name != DRAWN}  # quantities of these names
        self.shows_drawn = DRAWN in asked
        self._of_vectors = [(name, f"_{name}", *self._places[field]) for name, field in self.shown.items()]

    def of(self, out: Outputs, name: str) -> Any:
        """A quantity of all lanes."""
        table, row = self._places[name]
        return out[table][row]

    def points(self, out: Outputs, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Two coordinates of all lanes, (lanes, 2)."""
        return np.stack([self.of(out, name) for name in names], axis=1)

    def infos(self, out: Outputs, mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Values of all lanes for the ``infos`` of a vector, and with each a mask of lanes that have it."""
        infos: dict[str, Any] = {}
        for name, masked, table, row in self._of_vectors:
            infos[name] = out[table][row]
            infos[masked] = mask.copy()
        if self.shows_drawn:
            parameters = self.drawn_of([self.of(out, field) for field in self.drawn_fields])
            nested = {f"_{name}": mask.copy() for name in parameters}  # as Gymnasium nests a dict in infos
            infos[DRAWN], infos[f"_{DRAWN}"] = {**parameters, **nested}, mask.copy()
        return infos

    def drawn_of(self, values: Iterable[Any]) -> dict[str, Any]:
        """The numbers that episodes have drawn, by name, from values of their fields, of one lane or all."""
        rest = iter(values)
        rows = {name: [*itertools.islice(rest, count)] for name, count in self.drawn.items()}
        return {name: row[0] if len(row) == 1 else _together(row) for name, row in rows.items()}

    def info(self, out: Outputs, lane: int) -> dict[str, Any]:
        """Values for a lane's ``info``, as Python numbers."""
        return self.all_info(out.lanes([lane]))[0]

    def all_info(self, out: Outputs) -> list[dict[str, Any]]:
        """:meth:`info` of every lane."""
        rows = [self.of(out, name).tolist() for name in self.shown.values()]
        lanes = zip(*rows, strict=True) if rows else [()] * out.flags.shape[1]
        infos = [dict(zip(self.shown, values, strict=True)) for values in lanes]
        if self.shows_drawn:
            fields = [self.of(out, field).tolist() for field in self.drawn_fields]
            for info, values in zip(infos, zip(*fields, strict=True), strict=True):
                info[DRAWN] = self.drawn_of(values)
        return infos


def _together(row: list[Any]) -> Any:
    """The entries of a name: those of one lane are numbers, and those of all arrays."""
    return np.stack(row, axis=-1) if isinstance(row[0], np.ndarray) else row


def checked_keys(info_keys: Any, valid: Sequence[str]) -> Sequence[str]:
    """Names of ``info`` that a user asked for: a list of them, "all", or None for all but the sums of reward
    terms, which would take a third of the time of all."""
    if info_keys is None:
        return [name for name in valid if not name.startswith(RETURN)]
    if isinstance(info_keys, str) and info_keys == ALL:
        return valid
    if not isinstance(info_keys, list | tuple):  # what a spec keeps
        raise ValueError(
            f"info_keys is {shown(info_keys)}; give a list of names, such as ['is_success'], or 'all'"
        )
    for key in info_keys:
        if key not in valid:
            raise ValueError(f"info_keys has {shown(key)}; valid: {', '.join(valid)}")
        if info_keys.count(key) > 1:
            raise ValueError(f"info_keys has {key} twice; name it once")
    return info_keys
