"""Compiled programs of scenes, and calls of their kernels."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import dataclasses
import functools
import hashlib
import itertools
import os
import threading
import time
import weakref
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from queue import Empty, SimpleQueue
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from redundant_envs.compiler.backends import cache, llvm
from redundant_envs.compiler.backends.loaded import loaded_code
from redundant_envs.compiler.tracing.flow import LANES, Program
from redundant_envs.compiler.tracing.graph import uncollected
from redundant_envs.model.memory import Memory, aligned, alone
from redundant_envs.scenes.scene import Scene
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.simulator.batch.advance import advance_kernel, begin_kernel
from redundant_envs.simulator.batch.blocks import Blocks
from redundant_envs.simulator.batch.environment import EnvironmentKernel, goal_reward_kernel
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import Layout
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.tasks.base import Task

Traced = tuple[Program, Blocks]
Results = SimpleQueue[BaseException | None]
FEW = 4  # lanes up to which a program computes only these: half a block, a whole vector of many processors
KEPT_SIMULATORS = 64  # traced once for all their users; the least recently used ones are dropped
_kept: OrderedDict[tuple[Any, ...], Simulator] = OrderedDict()
WAITED = 0.2  # s; waits follow each other where one without an end takes no interrupt (Windows)
LONG_CALL, LONG_OF_LANE = 20_000_000, 4_000
"""ns of a call, and for each lane, beyond which another thread makes it, so that an interrupt stops it: that
takes some 20 us, and to copy the numbers 80 ns for each lane."""
SUBSTEP = 800  # ns that a substep of a block takes at least


class Simulator:
    """A scene in compiled code, and the lanes that it works on. It is traced unless the folder of the user
    has its code, and facts under its ``name``."""

    def __init__(
        self, dynamics: Dynamics, trace: Callable[[], Traced], episode: Episode | None = None, name: str = ""
    ) -> None:
        self.dynamics, self.episode, self._trace = dynamics, episode, trace
        facts = cache.facts(name, self._facts)
        self.program_digest: str = facts["program"]  # scenes share it whose effects have other names
        self.identity: str = facts["identity"]
        """A digest of program and fields: equal for scenes that differ in numbers only, on every machine."""
        self.arguments: dict[str, list[str]] = facts["arguments"]  # names, by kernel
        self.scratch_size, self.queue_size = facts["scratch_size"], facts["queue_size"]

    def _facts(self) -> dict[str, Any]:
        program, blocks = self._traced
        with uncollected():
            digest = cache.identity(program)
        return {
            "program": digest, "identity": cache.with_fields(digest, blocks.layout.places()),
            "arguments": {kernel.name: [*kernel.arguments] for kernel in program.kernels},
            "scratch_size": blocks.scratch_size, "queue_size": blocks.queue_size,
        }  # fmt: skip

    @functools.cached_property
    def features(self) -> Features:
        """What the lanes take care of beside the equations."""
        return Features(self.dynamics)

    @functools.cached_property
    def _traced(self) -> Traced:
        with uncollected():
            program, blocks = self._trace()
            known = self.__dict__.get("program_digest")  # none yet if this trace is to find it
            if known not in (None, cache.identity(program)):  # its code would be kept under a wrong name
                raise RuntimeError(
                    "a function, a class or a number that this simulator follows from was replaced since it "
                    "was made; make a new simulator or environment"
                )
            return program, blocks

    @property
    def program(self) -> Program:
        return self._traced[0]

    @property
    def blocks(self) -> Blocks:
        return self._traced[1]

    @functools.cached_property
    def layout(self) -> Layout:
        """The fields of the lanes, but for those that only the program of a lane sets."""
        return self.episode.layout() if self.episode else Interval(self.dynamics).layout()

    def key(self, lanes: int = LANES) -> str:
        """Name of the program's machine code for the first ``lanes`` of each block."""
        return cache.program_key(self.program_digest, lanes)

    def kernels(self, count: int) -> dict[str, llvm.Entry]:
        """The kernels in machine code for a number of lanes, from this process, the folder of the user, or
        the compiler. For few lanes they leave out the other ones of a block; no bit depends on that."""
        scene, few = self.dynamics.scene, FEW if count <= FEW else 0
        effects = ", ".join(type(e).__name__ for e in scene.effects) or "no effects"
        what = f"{scene.robot.kind} {scene.integrator} with {effects}"
        key, names = self.key(few or LANES), [*self.arguments]
        try:
            return cache.kernels(key, names, lambda: dataclasses.replace(self.program, few=few), what)
        finally:
            self.__dict__.pop("_traced", None)  # a compiler changes graphs


def _kept_or_made(make: Callable[..., Simulator], scene: Scene, *more: Any) -> Simulator:
    """A simulator: of parts of this package a cached one, and one with a name, else a new one without."""
    parts = (scene.robot, *scene.effects, *(part for part in more if not isinstance(part, bool | tuple)))
    loaded = loaded_code(__name__)
    if not loaded.digest or not all(map(loaded.tells, parts)):
        return make(scene.bound_anew(), *more)
    method = METHODS[scene.integrator]  # one from outside has no fixed meaning
    name = repr((scene, *more, llvm.processor()))  # shows the sign of a zero, which equality does not
    key = loaded.digest, method, name
    if key not in _kept:
        text = f"{loaded.digest}\0{method}\0{name}"
        _kept[key] = make(scene.bound_anew(), *more, hashlib.sha256(text.encode()).hexdigest()[:40])
    _kept.move_to_end(key)
    if len(_kept) > KEPT_SIMULATORS:
        _kept.popitem(last=False)
    return _kept[key]


def batch_simulator(scene: Scene, track_work: bool) -> Simulator:
    return _kept_or_made(traced_batch, scene, track_work)


def environment_simulator(
    scene: Scene, task: Task, observed: tuple[str, ...] = (), decides: bool = False
) -> Simulator:
    """The simulator of an environment; ``observed`` are fields of parameters that observations show, and with
    ``decides`` actions last for several control steps."""
    return _kept_or_made(traced_environment, scene, task, observed, decides)


def traced_batch(scene: Scene, track_work: bool, name: str = "") -> Simulator:
    """The simulator of a batch, traced unless there are facts under its ``name``."""
    dynamics = Dynamics(scene, track_work)

    def trace() -> Traced:
        kernel, blocks = advance_kernel(dynamics)
        begins = [begin_kernel(dynamics)] if dynamics.effect_states.computed else []
        return Program([kernel, *begins]), blocks

    return Simulator(dynamics, trace, name=name)


def traced_environment(
    scene: Scene, task: Task, observed: tuple[str, ...] = (), decides: bool = False, name: str = ""
) -> Simulator:
    """The simulator of an environment, traced unless there are facts under its ``name``."""
    episode = Episode(Dynamics(scene), task, observed, decides)

    def trace() -> Traced:
        env = EnvironmentKernel(episode)
        return Program([env.p, *([goal_reward_kernel(task)] if task.goal_functions else [])]), env.blocks

    return Simulator(episode.dynamics, trace, episode, name)


def address(array: NDArray[Any]) -> int:
    """Memory address of a writable array, in a third of the time that ``array.ctypes.data`` takes."""
    if array.flags.c_contiguous and array.flags.writeable and array.size:
        memory: Any = array
        return ctypes.addressof(ctypes.c_char.from_buffer(memory))
    return array.ctypes.data


class Call:
    """A kernel and its arguments, which are kept from call to call."""

    def __init__(self, arguments: Iterable[str], entry: llvm.Entry) -> None:
        self.entry = entry
        self._places = {name: k for k, name in enumerate(arguments)}
        self._frame = np.zeros(len(self._places), dtype=np.int64)
        self.address = self._frame.ctypes.data
        self._alive: dict[str, Any] = {}

    def set(self, **arguments: Any) -> None:
        """Arguments by name: whole numbers and arrays."""
        for name, value in arguments.items():
            self._frame[self._places[name]] = value if isinstance(value, int | np.integer) else address(value)
            self._alive[name] = value

    def put(self, first: str, values: Sequence[int]) -> None:
        """Arguments from ``first`` on, in order: whole numbers, addresses of arrays that live on."""
        place = self._places[first]
        self._frame[place : place + len(values)] = values

    def __call__(self) -> None:
        self.entry(self.address)


class Part(Call):
    """A call for some blocks of a memory: those from ``first`` to ``last``."""

    def __init__(self, simulator: Simulator, name: str, memory: Memory, first: int, last: int) -> None:
        super().__init__(simulator.arguments[name], simulator.kernels(memory.count)[name])
        self.memory, self.first = memory, first
        self.scratch = aligned(simulator.scratch_size)
        self.queue = np.zeros(simulator.queue_size, dtype=np.int64)
        self.set(
            scratch=self.scratch, queue=self.queue, substeps=simulator.dynamics.scene.substeps,
            count=min(last * LANES, memory.count) - first * LANES,
        )  # fmt: skip
        self.version = -1  # that of the memory when the kernel got the addresses of its arrays
        self.set_pointers()

    def set_pointers(self) -> None:
        """Give the kernel the addresses of the memory: parameters get new arrays when lanes differ."""
        if self.version == self.memory.version:
            return
        arrays, self.version = self.memory.arrays, self.memory.version
        first, stride = (0, 0) if self.memory.shared else (self.first, arrays["parameter"][0].size)
        self.set(
            state=arrays["state"][self.first :], log=arrays["log"][self.first :],
            parameter=arrays["parameter"][first:], parameter_stride=stride,
        )  # fmt: skip


class Worker:
    """A thread that runs the calls it is given, one after another, and ends with this object. A call begins
    after 15 us, with an executor of the standard library after 21 (Zen 5, 2026-11-23); a step of 4096 lanes
    takes 200 to 1000 us."""

    def __init__(self) -> None:
        self._asked: SimpleQueue[tuple[Callable[[], object], Results] | None] = SimpleQueue()
        self._results: Results = SimpleQueue()
        threading.Thread(target=_serve, args=[self._asked], name="redundant-envs worker", daemon=True).start()
        weakref.finalize(self, self._asked.put, None)

    def begin(self, call: Callable[[], None]) -> None:
        self._asked.put((call, self._results))

    def finish(self, long: bool = False) -> None:
        """Wait until the call is done, and raise what it has raised. After an interrupt, :meth:`settle`."""
        while True:
            with contextlib.suppress(Empty):
                error = self._results.get(timeout=WAITED if long else None)
                break
        if error:
            raise error

    def settle(self) -> None:
        """Wait until no call is left, of which one may not know whether it was begun or finished."""
        results: Results = SimpleQueue()
        self._asked.put((results.empty, results))
        results.get()
        self._results = results


def _serve(asked: SimpleQueue[Any]) -> None:
    while (request := asked.get()) is not None:
        (call, results), error = request, None
        try:
            call()
        except BaseException as raised:
            error = raised
        results.put(error)


class Team:
    """A kernel on all blocks of a memory, with the given number of threads. A long call can be interrupted,
    and changes nothing then, neither the memory nor the arrays ``also``."""

    def __init__(
        self, simulator: Simulator, name: str, memory: Memory, threads: int, also: Sequence[NDArray[Any]] = ()
    ) -> None:
        cuts = np.linspace(0, memory.blocks, min(threads, memory.blocks) + 1).astype(int).tolist()
        self.parts = [Part(simulator, name, memory, a, b) for a, b in itertools.pairwise(cuts)]
        self._memory, self._also = memory, also
        scene, longest = simulator.dynamics.scene, max(LONG_CALL, LONG_OF_LANE * memory.count)
        least = SUBSTEP * scene.substeps * -(-memory.blocks // len(self.parts))
        self._long = longest if least < longest else 0  # ns of a call that is long
        # ns that the last call took; of the first one, what it may take
        self._took = 0 if scene.tolerance is None or memory.blocks == 1 else self._long
        self._workers: list[Worker] = []
        self._process = os.getpid()

    @property
    def is_long(self) -> bool:
        """Whether the next call may take long."""
        return self._took >= self._long

    def __call__(self) -> None:
        start, long = time.perf_counter_ns(), self.is_long
        for part in self.parts:
            part.set_pointers()
        if long or len(self.parts) > 1:
            self._share_out(long)
        else:
            self.parts[0]()
        self._took = time.perf_counter_ns() - start

    def _share_out(self, long: bool) -> None:
        """Run each part in a thread: the first one in this thread, unless it may have to be interrupted."""
        if self._process != os.getpid():  # threads belong to a process: a forked one starts its own
            self._workers, self._process = [], os.getpid()
        parts = self.parts if long else self.parts[1:]
        self._workers += [Worker() for _ in parts[len(self._workers) :]]
        workers = self._workers[: len(parts)]
        arrays = (*self._memory.arrays.values(), *self._also) if long else ()
        before, stopped = [array.copy() for array in arrays], None
        try:
            for worker, part in zip(workers, parts, strict=True):
                worker.begin(part)
            if not long:
                self.parts[0]()
            for worker in workers:
                worker.finish(long)
        except BaseException as error:
            stopped = error
        while stopped:  # by an interrupt, which may come again and again, or by what a part raises
            try:
                self._settle(arrays, before)
                break
            except BaseException as error:
                stopped = error
        if stopped:
            raise stopped

    def _settle(self, arrays: Sequence[NDArray[Any]], before: Sequence[NDArray[Any]]) -> None:
        """Wait until no part writes to the memory, and undo what those of a long call have done."""
        for part in self.parts if arrays else ():
            part.queue[-1] = 1  # a call that runs ends at once, without a result
        for worker in self._workers:
            worker.settle()
        for array, content in zip(arrays, before, strict=True):
            array[:] = content
        for part in self.parts if arrays else ():
            part.scratch[:] = part.queue[:] = 0  # calls begin anew


class Copied(ABC):
    """Base of objects with a simulator, which copies share; copies create again what they cannot share."""

    made_anew: ClassVar[tuple[str, ...]]
    """Attributes that copies do not take over: compiled code, threads, and views of other arrays."""
    simulator: Simulator
    _memory: Memory

    @staticmethod
    @abstractmethod
    def _found_simulator(state: Mapping[str, Any]) -> Simulator:
        """The simulator that a pickled state needs, in this process."""

    @abstractmethod
    def _connect(self) -> None:
        """Create the attributes that copies do not take over."""

    @alone
    def __getstate__(self) -> dict[str, Any]:
        left = ("simulator", *self.made_anew)
        state = {name: value for name, value in self.__dict__.items() if name not in left}
        return {**state, "_identity": self.simulator.identity}

    def __setstate__(self, state: dict[str, Any]) -> None:
        simulator = self._found_simulator(state)
        if state.get("_identity", "") != simulator.identity:
            raise ValueError(
                "the copy is of a simulator with other equations: its arm, effects or task are not what they "
                "were; go on with the definitions of then, or make a new simulator"
            )
        self._take(state, simulator)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        clone = memo[id(self)] = object.__new__(type(self))
        clone._take(copy.deepcopy(self.__getstate__(), memo), self.simulator)
        return clone

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def _take(self, state: dict[str, Any], simulator: Simulator) -> None:
        self.__dict__.update({name: value for name, value in state.items() if name != "_identity"})
        self.simulator = simulator
        self._connect()
