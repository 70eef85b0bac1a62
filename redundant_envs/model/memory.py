"""The numbers of all lanes of a simulator: one array for each lifetime, in blocks of 8 lanes."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from threading import get_ident
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.effects.hooks import Impact
from redundant_envs.simulator.lane.dynamics import INTERVALS, Dynamics
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, STATE, Layout
from redundant_envs.support.values import shown

Array = NDArray[np.float64]
KEPT = (STATE, LOG, PARAMETER)
IN_USE, NOBODY = -1, 0  # instead of the version of a memory, and of a thread
P = ParamSpec("P")
R = TypeVar("R")


def aligned(*shape: int) -> Array:
    """Zeros whose memory begins at a cache line: a vector that straddles two lines is read twice."""
    size = int(np.prod(shape))
    raw = np.zeros(size + LANES)
    first = (-raw.ctypes.data % 64) // 8
    return raw[first : first + size].reshape(shape)


def alone(method: Callable[Concatenate[Any, P], R], inner: bool = True) -> Callable[Concatenate[Any, P], R]:
    """A method that may run in one thread at a time, as all of these together of one ``_memory``: another
    thread gets :class:`InUse`. An ``inner`` one may be called by others of them. A thread is not stopped
    between the look at ``free`` and its change: CPython switches threads at calls and loops only."""

    @functools.wraps(method)
    def guarded(self: Any, *args: P.args, **kwargs: P.kwargs) -> R:
        memory, thread = self._memory, get_ident()
        if memory.free == IN_USE:
            if memory.user != thread or not inner:
                raise InUse
            return method(self, *args, **kwargs)
        memory.free, memory.user = IN_USE, thread
        try:
            return method(self, *args, **kwargs)
        finally:
            memory.free, memory.user = memory.version, NOBODY

    return guarded


def first(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """The same for a method that no other one calls: :class:`InUse` in the same thread, too, where a handler
    of a signal would call it in the middle of another one."""
    return alone(method, inner=False)


class InUse(RuntimeError):
    """A simulator or an environment is used by two threads at once, or by a thread and its signal handler."""

    def __init__(self) -> None:
        super().__init__(
            "another thread uses this simulator or environment, or did when this process was forked, or a "
            "signal handler has interrupted its use; give each thread its own, or share a threading.Lock"
        )


class Memory:
    """The numbers of ``count`` lanes. Lanes beyond these pad the last block; they hold the nominal scene at
    rest. All lanes share one block of parameters until they are given different ones. A copy has arrays of
    its own."""

    def __init__(
        self, dynamics: Dynamics, layout: Layout, count: int, more: dict[str, float], drawn: bool = False
    ) -> None:
        """``more`` are parameters beside the scene's; ``drawn`` if episodes draw some, never shared."""
        _check_size(layout, count)
        self.dynamics, self.layout, self.count = dynamics, layout, count
        self._places: dict[tuple[str, ...], tuple[str, NDArray[np.intp]]] = {}
        self.user = get_ident()  # the thread that uses these numbers, in a method of :func:`alone`
        self.free = IN_USE  # or the version, if no thread uses these numbers
        self.blocks = -(-count // LANES)
        self.shared = True  # whether all lanes have the same parameters, in one block
        self.version = 0  # grows when an array is replaced by another one
        self.arrays: dict[str, Array] = {
            str(life): aligned(1 if life is PARAMETER else self.blocks, layout.size(life), LANES)
            for life in KEPT
        }
        self.index, self.drawn = np.arange(count), drawn
        scene, initial = dynamics.scene, dict(dynamics.effect_states.initial)
        steps = {"interval": scene.control_dt}
        if layout.fields["h"].lifetime is PARAMETER:  # else each piece of an interval has its own steps
            steps["h"] = scene.control_dt / scene.substeps
        stops = scene.attached.of(Impact)
        nearest = [0.0] * dynamics.count
        for a in stops:  # at 0, or at the stop that is nearest
            low, high = (dynamics.parameters.values[a.parameter(end)] for end in (a.hook.lower, a.hook.upper))
            nearest[a.hook.joint] = min(max(0.0, low), high)
        if stops:
            q = dynamics.arm.coordinates_of_joints(*nearest)
            initial |= dict(zip(dynamics.arm.coordinates, q if isinstance(q, tuple) else (q,), strict=True))
        for name, value in {**dynamics.parameters.values, **steps, **more, **initial}.items():
            self.column(name)[:] = value
        self.prepare()
        if drawn:
            self.part()
        self.free, self.user = self.version, NOBODY

    @property
    def _memory(self) -> Memory:
        return self

    @alone
    def __getstate__(self) -> dict[str, Any]:
        arrays = {name: array.copy() for name, array in self.arrays.items()}
        return {**self.__dict__, "free": self.version, "user": NOBODY, "arrays": arrays}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.arrays = {name: _aligned_copy(array) for name, array in state["arrays"].items()}

    def column(self, name: str) -> Array:
        """A field of all blocks, (blocks, 8); of shared parameters (1, 8)."""
        space, row = self.layout.row_of(name)
        return self.arrays[space][:, row]

    def __contains__(self, name: str) -> bool:
        return name in self.layout and self.layout.fields[name].lifetime in KEPT

    def _place_of(self, names: tuple[str, ...]) -> tuple[str, NDArray[np.intp]]:
        """The array of some fields of one lifetime, and their rows in it."""
        if names not in self._places:
            places = [self.layout.row_of(name) for name in names]
            (space,) = {space for space, _ in places} or {str(STATE)}
            self._places[names] = space, np.array([row for _, row in places], np.intp)
        return self._places[names]

    @alone
    def read(self, names: Sequence[str], index: NDArray[Any] | None = None) -> Array:
        """Numbers of one lifetime, of some lanes, as a new array (lanes, names)."""
        space, rows = self._place_of(tuple(names))
        if self.shared and space == str(PARAMETER):
            return np.tile(self.arrays[space][0, rows, 0], (self.count if index is None else len(index), 1))
        if index is not None and LANES * len(index) < self.count:  # a few of many
            block, lane = np.divmod(index, LANES)
            return self.arrays[space][block[:, None], rows, lane[:, None]]  # type: ignore[no-any-return]
        numbers = self.arrays[space][:, rows].swapaxes(0, 1).reshape(len(rows), self.blocks * LANES)
        return (numbers[:, : self.count] if index is None else numbers.take(index, axis=1)).T.copy()

    @alone
    def write(self, names: Sequence[str], values: Any, index: NDArray[Any] | None = None) -> bool:
        """Set numbers of one lifetime from what broadcasts to (lanes, names); false if parameters stay."""
        lanes, (space, rows) = self.index if index is None else index, self._place_of(tuple(names))
        table = np.broadcast_to(np.asarray(values, dtype=np.float64), (len(lanes), len(names)))
        if space == str(PARAMETER):
            bits = np.ascontiguousarray(table).view(np.int64)
            if (bits == self.read(names, lanes).view(np.int64)).all():
                return False
            if self.shared and len(lanes) == self.count and (bits == bits[:1]).all():
                self.arrays[space][0, rows] = table[:1].T
                return True
            self.part()
        block, lane = np.divmod(lanes, LANES)
        self.arrays[space][block[:, None], rows, lane[:, None]] = table
        return True

    def part(self) -> None:
        """Give each lane parameters of its own."""
        if self.shared:
            shared = self.arrays[str(PARAMETER)]
            broadcast = np.broadcast_to(shared, (self.blocks, *shared.shape[1:]))
            self.arrays[str(PARAMETER)] = _aligned_copy(broadcast)
            self.shared = False
            self.version += 1

    @alone
    def prepare(self) -> None:
        """Recompute the fields that follow from the parameters alone; to be called after these are set."""
        values = {name: self.column(name) for name in self.dynamics.parameters.values}
        with np.errstate(all="ignore"):  # both sides of a choice are computed, as in compiled code
            prepared = self.dynamics.parameters.prepare(values)
        for name, value in prepared.items():
            self.column(name)[:] = value

    def forget(self, index: NDArray[Any]) -> None:
        """Begin a new motion: release sliders that a stop holds, and choose the steps again."""
        names = [n for n in self.layout.rows[STATE] if n.startswith("active_stop_") or n == "next_step"]
        self.write(names, 0.0, index)

    def begin(self, index: NDArray[Any]) -> None:
        """Begin a new motion: reset fields but positions and velocities; computed states to 0."""
        self.forget(index)
        zero = dict.fromkeys((name for name in ("work", INTERVALS) if name in self), 0.0)
        for name, initial in {**self.dynamics.effect_states.initial, **zero}.items():
            self.write((name,), initial, index)

    @alone
    def save(self) -> dict[str, Array]:
        """Copies of all numbers, in one dimension."""
        states, log, parameters = (self.arrays[str(life)].reshape(-1) for life in KEPT)
        return {"states": np.concatenate([states, log]), "parameters": parameters.copy()}

    @alone
    def restore(self, states: Array, parameters: Array) -> None:
        """Restore numbers of :meth:`save`, of as many lanes."""
        state, log = self.arrays[str(STATE)], self.arrays[str(LOG)]
        state[:], log[:] = states[: state.size].reshape(state.shape), states[state.size :].reshape(log.shape)
        blocks = parameters.reshape(-1, self.layout.size(PARAMETER), LANES)
        alike = (blocks.view(np.int64) == blocks[:1, :, :1].view(np.int64)).all()
        self.arrays[str(PARAMETER)] = _aligned_copy(blocks)
        self.shared = len(blocks) == 1 and bool(self.blocks > 1 or alike)
        if self.drawn:
            self.part()
        self.version += 1


def memory_of_machine() -> int:
    """Bytes of memory; a terabyte where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # Windows
        return 10**12


def _check_size(layout: Layout, count: int) -> None:
    """ValueError if this machine cannot hold so many lanes: the system may end a process that tries."""
    of_lane, machine = 8 * sum(map(layout.size, KEPT)), memory_of_machine()
    if count * of_lane > machine:
        raise ValueError(
            f"num_envs is {shown(count)}; each takes {of_lane} bytes, and this machine has "
            f"{machine / 1e9:.0f} GB: give at most {machine // of_lane}"
        )


def _aligned_copy(array: Array) -> Array:
    copy = aligned(*array.shape)
    copy[:] = array
    return copy
