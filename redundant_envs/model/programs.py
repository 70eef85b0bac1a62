"""Compiled programs of scenes, and calls of their kernels."""

from __future__ import annotations

import ctypes
import functools
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

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

    @functools.cached_property
    def key(self) -> str:
        """Name of the program's machine code."""
        return cache.program_key(self.identity)

    def check_same(self, identity: str) -> None:
        """ValueError unless a copy was made of a simulator with this program."""
        if identity != self.identity:
            scene = self.dynamics.scene
            names = ", ".join(type(x).__name__ for x in (scene.robot, *scene.effects))
            raise ValueError(
                f"the copy is of a simulator with other equations: {names}, or the task, are not what they "
                "were when it was made; go on with the definitions of then, or make a new simulator"
            )

    @functools.cached_property
    def kernels(self) -> dict[str, llvm.Entry]:
        """The kernels in machine code, from this process, the folder of the user, or the compiler."""
        scene = self.dynamics.scene
        effects = ", ".join(type(e).__name__ for e in scene.effects) or "no effects"
        what = f"{scene.robot.kind} {scene.integrator} with {effects}"
        if self.episode:
            what += ", as an environment"
        elif self.dynamics.track_work:
            what += ", and its work"
        return cache.kernels(self.key, self.program, what)


KEPT_SIMULATORS = 64
"""Simulators that are traced once for all their users; the least recently used ones are dropped."""
_kept: OrderedDict[str, Simulator] = OrderedDict()


def _kept_or_made(make: Callable[[], Simulator], scene: Scene, *more: Any) -> Simulator:
    """A cached simulator, for scenes whose parts all belong to this package.

    Classes of users are traced each time: a function may have been defined again. Keys are texts, because
    these distinguish the sign of a zero, which equality does not.
    """
    parts = (scene.robot, *scene.effects, *(part for part in more if not isinstance(part, bool)))
    if not all(type(part).__module__.partition(".")[0] == "redundant_envs" for part in parts):
        return make()
    name = repr((scene, *more, llvm.processor()))
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
        super().__init__(kernel, simulator.kernels[name])
        self.memory, self.first, self.last = memory, first, last
        self.lanes = slice(first * LANES, min(last * LANES, memory.count))
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
