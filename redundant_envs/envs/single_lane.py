"""The one lane of a single environment: the same kernel, with buffers that are reused from step to step."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.batch.blocks import LANES
from redundant_envs.batch.environment import Autoreset
from redundant_envs.envs.outputs import Columns, Outputs
from redundant_envs.lane.episode import TABLES, TIP
from redundant_envs.model.programs import Part

FORMATS = {"flags": "?", "counts": "q", "values": "d"}
"""Numbers of the tables as :mod:`struct` reads them; a row has one for each lane of a block."""


class SingleLane:
    """Calls of an environment's kernel for one lane, whose memory is that of ``part``.

    ``observed`` and ``actions`` are numbers of an observation and of an action.
    """

    def __init__(
        self, part: Part, columns: Columns, observed: int, actions: int, episode_keys: NDArray[np.uint32]
    ) -> None:
        self.columns = columns
        self._part = part
        action = np.zeros(actions, dtype=np.float32)
        self._action: Any = action.data  # faster to write than the array itself
        obs = np.zeros((LANES, observed), dtype=np.float32)
        self._obs = obs[0]
        self._buffer, self.outputs = _in_one_buffer(columns)
        self._ends = _reader(columns, ("terminated", "reward"))
        self._shown = _reader(columns, [column for column, *_ in columns.places_shown])
        self._points = _reader(columns, (*TIP, *columns.goal))
        self._operation = -1
        self._entry, self._address = part.entry, part.address
        tables = dict(zip(TABLES, self.outputs, strict=True))
        part.set(
            actions=action, obs=obs, stride=LANES, last_obs=obs, episode_keys=episode_keys, any_due=0,
            autoreset=Autoreset.DISABLED, **tables, **{f"last_{name}": t for name, t in tables.items()},
        )  # fmt: skip

    def run(self, operation: int) -> NDArray[np.float32]:
        """Run an operation of the kernel; returns the observation."""
        if operation != self._operation:
            self._part.set(operation=operation)
            self._operation = operation
        self._part.set_pointers()
        self._part()
        return self._obs.copy()

    def step(self, action: NDArray[np.float32], operation: int) -> NDArray[np.float32]:
        """One control step, by the operation STEP or CHECKED_STEP; returns the observation."""
        self._action[:] = action
        if operation != self._operation or self._part.moved:
            return self.run(operation)
        self._entry(self._address)
        return self._obs.copy()

    def ends(self) -> tuple[bool, float]:
        """Whether the episode was terminated, and the reward, of the last step."""
        return self._ends.unpack_from(self._buffer)  # type: ignore[return-value]

    def shown(self) -> tuple[Any, ...]:
        """Values for ``info``, in its order."""
        return self._shown.unpack_from(self._buffer)

    def points(self) -> tuple[float, ...]:
        """Tip and goal, m."""
        return self._points.unpack_from(self._buffer)  # type: ignore[return-value]


def _in_one_buffer(columns: Columns) -> tuple[bytearray, Outputs]:
    """Tables for the lanes of a block side by side in memory, so that one call reads all of them."""
    sizes = [len(names) * LANES * struct.calcsize(FORMATS[t]) for t, names in columns.tables.items()]
    buffer = bytearray(sum(sizes))
    arrays, start = [], 0
    kinds = (np.bool_, np.int64, np.float64)
    for names, size, kind in zip(columns.tables.values(), sizes, kinds, strict=True):
        part: Any = np.frombuffer(memoryview(buffer)[start : start + size], dtype=kind)
        arrays.append(part.reshape(len(names), LANES))
        start += size
    return buffer, Outputs(*arrays)


def _reader(columns: Columns, names: Any) -> struct.Struct:
    """Reads some quantities of the first lane; they must be in the order of the tables."""
    form = ["="]
    for table, present in columns.tables.items():
        letter = FORMATS[table]
        rest = (LANES - 1) * struct.calcsize(letter)
        for name in present:
            form.append(f"{letter}{rest}x" if name in names else f"{rest + struct.calcsize(letter)}x")
    return struct.Struct("".join(form))
