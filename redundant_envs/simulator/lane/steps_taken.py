"""The steps by which lanes cross a control interval under error control, as data: their lengths, and the laws
that hold in them. Whoever takes the same steps need not estimate an error or search for an event.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.simulator.lane.direct import several_in_steps
from redundant_envs.simulator.lane.faults import GIVEN_UP, Reason
from redundant_envs.simulator.lane.interval import Interval

Fields = Mapping[str, Any]


def steps_taken(interval: Interval, fields: Fields) -> list[NDArray[np.float64]]:
    """The steps in each piece of an interval, from the fields at its start: arrays (lanes,) or floats.

    A piece has (1 + laws, steps, lanes) numbers: shares of the piece, 0 where a lane takes no step any more,
    and the side of each law of :attr:`Features.sides`. A lane that gives the interval up takes none.
    """
    sides = interval.features.sides
    lanes = next(x.size for x in fields.values() if isinstance(x, np.ndarray))
    pieces = [Steps(lanes, sides) for _ in range(interval.pieces.count)]
    with np.errstate(all="ignore"):  # infinite limits meet zeros, as in compiled code
        *_, end = several_in_steps(interval, {**dict.fromkeys(sides, 0.0), **fields}, pieces)
    return [piece.shares(np.broadcast_to(end["fault"] < float(GIVEN_UP), lanes)) for piece in pieces]


class Steps:
    """The steps that lanes take in a piece of an interval."""

    def __init__(self, lanes: int, sides: tuple[str, ...]) -> None:
        self._sides = sides
        self._counts, self._span = np.zeros(lanes, int), np.ones(lanes)
        self._rows = np.zeros((8, 1 + len(sides), lanes))

    def shares(self, crossed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The steps as :func:`steps_taken` has them; those of lanes that have not crossed it are left out."""
        most = max(int(self._counts.max(initial=0)), 1)  # a step without a length has the shape of all lanes
        found = np.moveaxis(self._rows[:most], 1, 0).copy()
        taken = crossed & (np.arange(most)[:, None] < self._counts)
        found[0] = np.where(taken, found[0] / self._span, 0.0)
        return found

    def tried(self, before: Fields, after: Fields) -> None:
        """Record a trial step of lanes that have left the common step, from their fields before and after the
        program has judged it: it counts, or not, or all begins anew."""
        left, elapsed = after["reason"] != float(Reason.NONE), after["elapsed"]
        self._clear(left & (elapsed == 0.0))
        if "elapsed" in before:
            self._take(left & (elapsed > before["elapsed"]), before["step"], before, "{}")

    def crossed(self, lane: Fields) -> None:
        """Record the common step of the lanes that it has served."""
        goes_on = lane["h"] > 0.0
        served = goes_on & (lane["reason"] == float(Reason.NONE))
        self._clear(served)
        self._take(served, lane["h"], lane, "{}_start")
        self._span = np.where(goes_on, lane["h"], self._span)

    def _clear(self, lanes: NDArray[np.bool_]) -> None:
        self._counts = np.where(lanes, 0, self._counts)

    def _take(self, lanes: NDArray[np.bool_], length: Any, lane: Fields, form: str) -> None:
        here = np.flatnonzero(np.broadcast_to(lanes, self._counts.shape))
        if here.size and self._counts.max() == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        for k, x in enumerate((length, *(lane[form.format(side)] for side in self._sides))):
            self._rows[self._counts[here], k, here] = np.broadcast_to(x, self._counts.shape)[here]
        self._counts[here] += 1
