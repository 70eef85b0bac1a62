"""Compiled programs of scenes, and calls of their kernels."""

from __future__ import annotations

import copy
import ctypes
import dataclasses
import functools
import itertools
import os
import threading
import weakref
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from redundant_envs.backends import cache, llvm
from redundant_envs.batch.advance import advance_kernel
from redundant_envs.batch.blocks import LANES, Blocks
from redundant_envs.batch.environment import EnvironmentKernel, goal_reward_kernel
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.episode import Episode
from redundant_envs.lane.interval import Interval
from redundant_envs.model.memory import Memory, aligned
from redundant_envs.scene import Scene
from redundant_envs.tasks.base import Task
from redundant_envs.tracing.flow import Kernel, Program
from redundant_envs.tracing.graph import uncollected


@dataclass(frozen=True)
class Simulator:
    """A traced scene: its kernels, and the lanes that they work on."""

    dynamics: Dynamics
    blocks: Blocks
    program: Program
    episode: Episode | None = None

    @property
    def interval(self) -> Interval:
        return self.blocks.interval

    @functools.cached_property
    def identity(self) -> str:
        """A digest of the program: equal for scenes that differ in numbers only, and on every machine."""
        with uncollected():
            return cache.identity(self.program)

    @property
    def key(self) -> str:
        """Name of the program's machine code for whole blocks."""
        return cache.program_key(self.identity, LANES)

    def check_same(self, identity: str) -> None:
        """ValueError unless a copy was made of a simulator with this program."""
        if identity != self.identity:
            scene = self.dynamics.scene
            names = ", ".join(type(x).__name__ for x in (scene.robot, *scene.effects))
            raise ValueError(
                f"the copy is of a simulator with other equations: {names}, or the task, are not what they "
                "were when it was made; go on with the definitions of then, or make a new simulator"
            )

    def kernels(self, count: int) -> dict[str, llvm.Entry]:
        """The kernels in machine code for a number of lanes, from this process, the folder of the user, or
        the compiler. For few lanes they leave out the other ones of a block; no bit depends on that."""
        scene = self.dynamics.scene
        effects = ", ".join(type(e).__name__ for e in scene.effects) or "no effects"
        what = f"{scene.robot.kind} {scene.integrator} with {effects}"
        if self.episode:
            what += ", as an environment"
        elif self.dynamics.track_work:
            what += ", and its work"
        program = dataclasses.replace(self.program, lanes=FEW if count <= FEW else LANES)
        if program.lanes == FEW:
            what += f", for at most {FEW}"
        return cache.kernels(cache.program_key(self.identity, program.lanes), program, what)


FEW = 4
"""Lanes up to which a program computes only these: half a block, a whole vector of many processors."""
KEPT_SIMULATORS = 64
"""Simulators that are traced once for all their users; the least recently used ones are dropped."""
_kept: OrderedDict[str, Simulator] = OrderedDict()


def _kept_or_made(make: Callable[[], Simulator], scene: Scene, *more: Any) -> Simulator:
    """A cached simulator, if all parts of the scene are of this package: others may be defined again."""
    parts = (scene.robot, *scene.effects, *(part for part in more if not isinstance(part, bool)))
    if not all(type(part).__module__.partition(".")[0] == "redundant_envs" for part in parts):
        return make()
    name = repr((scene, *more, llvm.processor()))  # a text shows the sign of a zero, which equality does not
    if name not in _kept:
        _kept[name] = make()
    _kept.move_to_end(name)
    if len(_kept) > KEPT_SIMULATORS:
        _kept.popitem(last=False)
    return _kept[name]


def batch_simulator(scene: Scene, track_work: bool) -> Simulator:
    """The simulator of a batch."""
    return _kept_or_made(lambda: traced_batch(scene, track_work), scene, track_work)


def environment_simulator(scene: Scene, task: Task) -> Simulator:
    """The simulator of an environment."""
    return _kept_or_made(lambda: _traced_environment(scene, task), scene, task)


def traced_batch(scene: Scene, track_work: bool) -> Simulator:
    """The simulator of a batch, traced again."""
    dynamics = Dynamics(scene, track_work)
    with uncollected():
        kernel, blocks = advance_kernel(dynamics)
    return Simulator(dynamics, blocks, Program([kernel]))


def _traced_environment(scene: Scene, task: Task) -> Simulator:
    episode = Episode(Interval(Dynamics(scene)), task)
    with uncollected():
        made = EnvironmentKernel(episode)
        program = Program([made.p, *([goal_reward_kernel(task)] if task.goal_functions else [])])
    return Simulator(episode.dynamics, made.blocks, program, episode)


def address(array: NDArray[Any]) -> int:
    """Memory address of a writable array, in a third of the time that ``array.ctypes.data`` takes."""
    if array.flags.c_contiguous and array.flags.writeable and array.size:
        memory: Any = array
        return ctypes.addressof(ctypes.c_char.from_buffer(memory))
    return array.ctypes.data


class Call:
    """A kernel and its arguments, which are kept from call to call."""

    def __init__(self, kernel: Kernel, entry: llvm.Entry) -> None:
        self.entry = entry
        self._places = {name: k for k, name in enumerate(kernel.arguments)}
        self._frame = np.zeros(len(self._places), dtype=np.int64)
        self.address = self._frame.ctypes.data
        self._alive: dict[str, Any] = {}

    def set(self, **arguments: Any) -> None:
        """Arguments by name: whole numbers and arrays."""
        for name, value in arguments.items():
            whole = isinstance(value, int | np.integer)
            self._frame[self._places[name]] = value if whole else address(value)
            self._alive[name] = value

    def lend(self, arrays: Mapping[str, NDArray[Any]], starts: Mapping[str, int]) -> None:
        """Arrays by name, and the addresses from which the kernel uses them."""
        for name, start in starts.items():
            self._frame[self._places[name]] = start
        self._alive.update(arrays)

    def __call__(self) -> None:
        self.entry(self.address)


class Part(Call):
    """A call for some blocks of a memory: those from ``first`` to ``last``."""

    def __init__(self, simulator: Simulator, name: str, memory: Memory, first: int, last: int) -> None:
        kernel = next(k for k in simulator.program.kernels if k.name == name)
        self.lanes = slice(first * LANES, min(last * LANES, memory.count))
        super().__init__(kernel, simulator.kernels(memory.count)[name])
        self.memory, self.first, self.last = memory, first, last
        scratch = aligned(simulator.blocks.scratch_size)
        queue = np.zeros(simulator.blocks.queue_size, dtype=np.int64)
        self.set(
            scratch=scratch, queue=queue, substeps=simulator.dynamics.scene.substeps,
            count=self.lanes.stop - self.lanes.start,
        )  # fmt: skip
        self._version = -1
        self.set_pointers()

    @property
    def moved(self) -> bool:
        """Whether arrays of the memory have been replaced since the kernel got their addresses."""
        return self._version != self.memory.version

    def set_pointers(self) -> None:
        """Give the kernel the addresses of the memory: parameters get new arrays when lanes differ."""
        if not self.moved:
            return
        arrays, self._version = self.memory.arrays, self.memory.version
        first = 0 if self.memory.shared else self.first
        self.set(
            state=arrays["state"][self.first :], log=arrays["log"][self.first :],
            parameter=arrays["parameter"][first:], parameter_stride=self.memory.parameter_stride,
        )  # fmt: skip


class Worker:
    """A thread that runs the calls it is given, one after another, and ends with this object.

    A call begins after 15 us, with an executor of the standard library after 21 (Zen 5, 2026-11-23); a
    step of 4096 lanes takes 200 to 1000 us.
    """

    def __init__(self) -> None:
        self._asked: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._done: SimpleQueue[BaseException | None] = SimpleQueue()
        queues = self._asked, self._done
        threading.Thread(target=_serve, args=queues, name="redundant-envs worker", daemon=True).start()
        weakref.finalize(self, self._asked.put, None)

    def begin(self, call: Callable[[], None]) -> None:
        self._asked.put(call)

    def finish(self) -> None:
        """Wait until the call is done, and only then raise an interrupt: until then it writes to memory."""
        interrupt = None
        while True:
            try:
                error = self._done.get()
                break
            except KeyboardInterrupt as again:
                interrupt = again
        if interrupt or error:
            raise interrupt or error  # type: ignore[misc]


def _serve(asked: SimpleQueue[Callable[[], None] | None], done: SimpleQueue[BaseException | None]) -> None:
    while (call := asked.get()) is not None:
        try:
            call()
        except BaseException as error:
            done.put(error)
        else:
            done.put(None)


class Team:
    """A kernel on all blocks of a memory, with the given number of threads."""

    def __init__(self, simulator: Simulator, name: str, memory: Memory, threads: int) -> None:
        cuts = np.linspace(0, memory.blocks, min(threads, memory.blocks) + 1).astype(int).tolist()
        self.parts = [Part(simulator, name, memory, a, b) for a, b in itertools.pairwise(cuts)]
        self._start()

    def _start(self) -> None:
        """Threads belong to a process: a forked process starts its own."""
        self._workers = [Worker() for _ in self.parts[1:]]
        self._process = os.getpid()

    def __call__(self) -> None:
        for part in self.parts:
            part.set_pointers()
        if len(self.parts) > 1 and self._process != os.getpid():
            self._start()
        for worker, part in zip(self._workers, self.parts[1:], strict=True):
            worker.begin(part)
        try:
            self.parts[0]()  # the calling thread works, too
        finally:
            for worker in self._workers:
                worker.finish()


class Copied(ABC):
    """Base of objects with a simulator, which copies share; copies create again what they cannot share."""

    made_anew: ClassVar[tuple[str, ...]]
    """Attributes that copies do not take over: compiled code, threads, and views of other arrays."""
    simulator: Simulator

    @staticmethod
    @abstractmethod
    def _found_simulator(state: Mapping[str, Any]) -> Simulator:
        """The simulator that a pickled state needs, in this process."""

    @abstractmethod
    def _connect(self) -> None:
        """Create the attributes that copies do not take over."""

    def __getstate__(self) -> dict[str, Any]:
        left = ("simulator", *self.made_anew)
        kept = {name: value for name, value in self.__dict__.items() if name not in left}
        return {**kept, "_identity": self.simulator.identity}

    def __setstate__(self, state: dict[str, Any]) -> None:
        simulator = self._found_simulator(state)
        simulator.check_same(state.get("_identity", ""))
        self._take(state, simulator)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        made = memo[id(self)] = object.__new__(type(self))
        made._take(copy.deepcopy(self.__getstate__(), memo), self.simulator)
        return made

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def _take(self, state: dict[str, Any], simulator: Simulator) -> None:
        self.__dict__.update({name: value for name, value in state.items() if name != "_identity"})
        self.simulator = simulator
        self._connect()
