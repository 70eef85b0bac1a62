"""All lanes of an environment in the memory of a GPU, and the programs that work on them there."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from redundant_envs.compiler.backends import cache, cuda, llvm
from redundant_envs.compiler.backends.nvptx import ptx
from redundant_envs.compiler.backends.processors import NVIDIA
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.compiler.tracing.graph import uncollected
from redundant_envs.envs.core import Core
from redundant_envs.envs.keys import PCG, generator_states
from redundant_envs.model.memory import Memory
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.batch.environment import DECISION, DUE, Autoreset
from redundant_envs.simulator.batch.threads import ASKED, GROUP_BITS, programs
from redundant_envs.simulator.lane.episode import GOAL, TABLES, TIP
from redundant_envs.simulator.lane.fields import PARAMETER, SCRATCH, STATE
from redundant_envs.support.extras import needs

with needs("train"):
    import torch

Launch = Callable[[str, int, Sequence[int | bytes]], None]
"""Runs a kernel for so many lanes, with its arguments."""
Tables = tuple[torch.Tensor, ...]
"""Observations (lanes, columns), and flags, counts and values, (rows, lanes) each."""
LEVELS = 2
"""Launches between that of the common step and the last one, which takes all that remain."""
MOST_BY_VALUE = 3500
"""Bytes of parameters that all lanes share, up to which kernels get them by value: arguments have 4096."""
MASK = 2**64 - 1
PCG_BACK = pow(PCG, -1, 2**128)


def on_gpu(program: Program, shared: int, device: torch.device, scene: Scene) -> Launch:
    """The kernels of a program on a GPU, for the present stream of each call."""
    effects = ", ".join(type(e).__name__ for e in scene.effects) or "no effects"
    with llvm.target(NVIDIA), uncollected():
        key = cache.program_key(f"{cache.identity(program)}\0{shared}", 1)
        what = f"{scene.robot.kind} {scene.integrator} with {effects} for GPUs"
        text = cache.code(key, lambda: ptx(program, shared).encode(), what).decode()
    with torch.cuda.device(device):
        torch.cuda.current_stream().synchronize()  # the context is there then
        module = cuda.Module(text, [kernel.name for kernel in program.kernels])

    def launch(name: str, count: int, arguments: Sequence[int | bytes]) -> None:
        with torch.cuda.device(device):
            module.launch(name, count, arguments, torch.cuda.current_stream().cuda_stream)

    return launch


def check_gpu(device: torch.device) -> None:
    """Refuse a device that is no GPU of this machine; warn of one that is slow with 64 bits."""
    if device.type != "cuda":
        raise ValueError(f"device is {str(device)!r}; give 'cpu' or 'cuda', or 'cuda:1' of several GPUs")
    if not torch.cuda.is_available():
        why = "this torch has no CUDA" if torch.version.cuda is None else "torch.cuda.is_available() is False"
        raise ValueError(f"device is {str(device)!r}, and torch finds no GPU ({why}); give device='cpu'")
    count, index = torch.cuda.device_count(), torch.cuda.current_device()
    if (index := index if device.index is None else device.index) >= count:
        raise ValueError(f"device is {str(device)!r}, and this machine has GPUs 0 to {count - 1}")
    if (slow := cuda.slowness(index)) >= cuda.SLOW:
        warnings.warn(
            f"{torch.cuda.get_device_name(index)} computes with 64 bits 1/{slow} as fast as with 32: expect "
            f"steps to take up to {slow // 2} times as long as on a GPU for computing centres, with the same "
            "bits",
            stacklevel=4,
        )


def check_memory(device: torch.device, of_lane: int, num_envs: int) -> None:
    """Refuse more lanes than the memory of a GPU can hold."""
    free, _ = torch.cuda.mem_get_info(device)
    if of_lane * num_envs > free:
        raise ValueError(
            f"num_envs is {num_envs}; each takes {of_lane} bytes, all {of_lane * num_envs / 1e9:.1f} GB, and "
            f"{device} has {free / 1e9:.1f} GB free: give at most {free // of_lane}"
        )


class DeviceLanes:
    """The numbers of lanes as tensors with a row for each field, and their steps and resets. ``core`` tells
    what they are; it has other lanes."""

    def __init__(self, core: Core, count: int, device: torch.device, load: Any = on_gpu) -> None:
        self.core, self.count, self.device, self._load = core, count, device, load
        self.episode, self.pid = core.episode, os.getpid()
        self.begun, self._turn = False, 0
        shares = core.memory.shared and 8 * core.simulator.layout.size(PARAMETER) <= MOST_BY_VALUE
        self._program(shares)
        self.state = self._zeros(self.layout.size(STATE))
        self.generator = self._zeros(4, torch.int64)
        self.due = torch.zeros(count, dtype=torch.int8, device=device)
        self.scratch = self._zeros(self.layout.size(SCRATCH) if self.levels else 0)
        self.lists = self._zeros(2 if self.levels else 0, torch.int64)
        self.counters = torch.zeros((LEVELS + 2, self.groups), dtype=torch.int64, device=device)
        self.parameter = self._numbers_of(core.memory)
        self.sets = [self._tables() for _ in range(2)]
        self.lasts = [self._tables() for _ in range(2)] if self._keeps_last else self.sets
        self._copy_state(core.memory)

    @property
    def _keeps_last(self) -> bool:
        """Whether there are outputs before an autoreset."""
        return self.core.autoreset == Autoreset.SAME_STEP

    @property
    def groups(self) -> int:
        return (self.count >> GROUP_BITS) + 1

    def bytes_of_lane(self) -> int:
        """Bytes of the device's memory that each lane takes."""
        rows = {"f64": 8, "i64": 8, "i8": 1}
        tables = sum(rows[TABLES[name]] * len(names) for name, names in self.episode.tables.items())
        lives = (STATE, SCRATCH) if self.levels else (STATE,)
        own = 0 if self.shares else self.layout.size(PARAMETER)
        numbers = sum(map(self.layout.size, lives)) + own + 4 + (2 if self.levels else 0)
        sets = 4 if self._keeps_last else 2
        return 8 * numbers + 1 + sets * (tables + 4 * len(self.episode.observed))

    def _program(self, shares: bool) -> None:
        on_device = self._load is on_gpu
        kernels, self.layout = programs(self.episode, shares, on_device)
        self.shares = shares
        self.arguments = {kernel.name: [*kernel.arguments] for kernel in kernels}
        self.levels = "first" in self.arguments
        if on_device:
            check_memory(self.device, self.bytes_of_lane(), self.count)
        shared = self.layout.size(PARAMETER) if shares else 0
        self._launched = self._load(Program(kernels), shared, self.device, self.core.scene)

    def _zeros(self, rows: int, kind: torch.dtype = torch.float64) -> torch.Tensor:
        return torch.zeros((rows, self.count), dtype=kind, device=self.device)

    def _tables(self) -> Tables:
        flags, counts, values = self.core.columns.heights
        seen = torch.zeros((self.count, len(self.episode.observed)), dtype=torch.float32, device=self.device)
        return seen, self._zeros(flags, torch.bool), self._zeros(counts, torch.int64), self._zeros(values)

    # ---- steps -------------------------------------------------------------------------------------------

    def _run(self, name: str, more: dict[str, Any]) -> None:
        given = {"parameter": self.parameter, "count": self.count, **more}
        values = [given[argument] for argument in self.arguments[name]]
        self._launched(name, self.count, [x.data_ptr() if isinstance(x, torch.Tensor) else x for x in values])

    def _frame(self, actions: torch.Tensor, autoreset: int) -> dict[str, Any]:
        names, tables, last = ("obs", *TABLES), self.sets[self._turn], self.lasts[self._turn]
        return {
            "state": self.state, "generator": self.generator, "due": self.due, "actions": actions,
            "scratch": self.scratch, "lists": self.lists, "counters": self.counters, "groups": self.groups,
            **dict(zip(names, tables, strict=True)),
            **dict(zip((f"last_{name}" for name in names), last, strict=True)),
            "stride": self.count, "substeps": self.core.simulator.dynamics.scene.substeps,
            "autoreset": autoreset, DECISION: self.core.decide_every,
        }  # fmt: skip

    def check_process(self) -> None:
        if os.getpid() != self.pid:
            raise RuntimeError(
                "this process was forked after the environments were made, and a GPU does not follow a fork; "
                "make them in this process, and start it with multiprocessing's method 'spawn'"
            )

    def step(self, actions: torch.Tensor) -> tuple[Tables, Tables]:
        """Outputs of a step, and those before an autoreset."""
        self.check_process()
        self._turn = 1 - self._turn
        frame = self._frame(actions, self.core.autoreset)
        results = self.sets[self._turn], self.lasts[self._turn]
        if not self.levels:
            self._run("step", frame)
            return results
        self.counters.zero_()
        self._run("first", {**frame, "level": 0})
        for level in range(LEVELS):
            self._run("next", {**frame, "level": level})
        self._run("last", {**frame, "level": LEVELS})
        return results

    def reset(self, mask: Any) -> Tables:
        """Begin an episode in the lanes of a mask, and observe all."""
        self.check_process()
        self.due[torch.as_tensor(mask, device=self.device)] = ASKED
        unused = self.sets[self._turn][0]  # instead of actions
        self._run("reset", self._frame(unused, Autoreset.DISABLED))
        self.begun = True
        return self.sets[self._turn]

    def goal_reward(self, achieved: torch.Tensor, desired: torch.Tensor) -> torch.Tensor:
        """The reward of pairs of goals, (n, 2) each."""
        self.check_process()
        pairs = torch.cat([achieved, desired], dim=1).to(torch.float64).contiguous()
        assert pairs.shape[1] == len((*TIP, *GOAL))
        reward = torch.empty(len(pairs), dtype=torch.float64, device=self.device)
        more = {"pairs": pairs, "numbers": self._reward_numbers, "reward": reward, "count": len(pairs)}
        values = [more[argument] for argument in self.arguments["goal_reward"]]
        values = [x.data_ptr() if isinstance(x, torch.Tensor) else x for x in values]
        self._launched("goal_reward", len(pairs), values)
        return reward

    @functools.cached_property
    def _reward_numbers(self) -> torch.Tensor:
        numbers = [self.core.reach, *self.core.task.parameters().values()]
        return torch.tensor(numbers, dtype=torch.float64, device=self.device)

    # ---- to and from the memory of a CPU -------------------------------------------------------------------

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Give generators to lanes with a seed, and to those that have none."""
        fresh = np.random.SeedSequence().generate_state(self.count, np.uint64).tolist()
        given = {
            k: fresh[k] if s is None else s for k, s in enumerate(seeds) if s is not None or not self.begun
        }
        if given:
            state, increment = generator_states([*given.values()])
            words = np.stack([np.broadcast_to(word, (1, len(given)))[0] for word in (*state, *increment)])
            lanes = torch.tensor([*given], device=self.device)
            self.generator[:, lanes] = torch.from_numpy(words.view(np.int64)).to(self.device)

    def _numbers_of(self, memory: Memory) -> Any:
        """Parameters as kernels take them: bytes if all lanes share them."""
        table = memory.read([*self.layout.rows[PARAMETER]])
        if self.shares:
            return table[0].tobytes()
        rows = np.broadcast_to(table.T, (table.shape[1], self.count))  # those of one lane are for all
        return torch.from_numpy(rows.copy()).to(self.device)

    def _copy_state(self, memory: Memory) -> None:
        names = [name for name in self.layout.rows[STATE] if name in memory]
        rows = [self.layout.rows[STATE][name] for name in names]
        self.state[rows] = torch.from_numpy(memory.read(names).T.copy()).to(self.device)

    def take(self, core: Core) -> None:
        """Go on where as many lanes of a CPU are."""
        self.check_process()
        memory = core.memory
        if self.shares and not memory.shared:
            self._program(False)
        self.parameter = self._numbers_of(memory)
        self._copy_state(memory)
        words = [_words(g, bool(waits)) for g, waits in zip(core.generators, core.waiting, strict=True)]
        self.generator.copy_(torch.from_numpy(np.array(words, np.uint64).T.view(np.int64).copy()))
        self.due.copy_(torch.from_numpy((core.mask == DUE).astype(np.int8)))
        self.begun = core.begun_all

    def give(self, core: Core) -> None:
        """Let as many lanes of a CPU go on where these are."""
        self.check_process()
        memory = core.memory
        names = [name for name in self.layout.rows[STATE] if name in memory]
        rows = [self.layout.rows[STATE][name] for name in names]
        memory.write(names, self.state[rows].T.cpu().numpy())
        if not self.shares:
            memory.part()
            memory.write([*self.layout.rows[PARAMETER]], self.parameter.T.cpu().numpy())
        words = self.generator.cpu().numpy().view(np.uint64).T.tolist()
        core.episode_keys.generators[:] = [_generator(*four) for four in words]
        core.keys[:] = [_key(*four) for four in words]
        core.waiting[:] = core.ended[:] = False
        core.mask[:] = self.due.cpu().numpy()
        core.provide_keys(np.flatnonzero(core.mask))


def _words(generator: Any, waits: bool) -> list[int]:
    """The words of a generator, before a key that it has given and that waits."""
    kind = type(generator.bit_generator)
    if kind is not np.random.PCG64:
        raise ValueError(f"the generator of an environment is {kind.__name__}; a GPU has NumPy's PCG64 alone")
    found = generator.bit_generator.state["state"]
    state, increment = found["state"], found["inc"]
    for _ in range(2 if waits else 0):
        state = _before(state, increment)
    return [state >> 64, state & MASK, increment >> 64, increment & MASK]


def _before(state: int, increment: int) -> int:
    return (state - increment) * PCG_BACK % 2**128


def _generator(high: int, low: int, more_high: int, more_low: int) -> np.random.Generator:
    bits = np.random.PCG64(0)
    state: Any = {"state": high << 64 | low, "inc": more_high << 64 | more_low}
    bits.state = {"bit_generator": "PCG64", "state": state, "has_uint32": 0, "uinteger": 0}
    return np.random.Generator(bits)


def _key(high: int, low: int, more_high: int, more_low: int) -> list[int]:
    """The words that a generator has given last."""
    state, increment = high << 64 | low, more_high << 64 | more_low
    key: list[int] = []
    for now in (state, _before(state, increment)):
        both, turn = now >> 64 ^ now & MASK, now >> 122
        word = (both >> turn | both << (64 - turn)) & MASK
        key = [word & 0xFFFFFFFF, word >> 32, *key]
    return key
