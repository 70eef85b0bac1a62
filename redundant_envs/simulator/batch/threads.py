"""The programs of an environment for one lane a thread, as a GPU runs them: no blocks, no slots and no queue.

The functions of a lane are those of the other kernels. A thread copies its lane's rows from arrays with a row
for each field and a column for each lane, crosses the control interval, begins a new episode where one is
due, and writes the rows that may have changed. A thread has the generator of its lane, NumPy's PCG64.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from redundant_envs.compiler.tracing.flow import Kernel, LaneFunction, Scalar
from redundant_envs.language.philox import LOW
from redundant_envs.simulator.batch.blocks import Block, Blocks, Ends
from redundant_envs.simulator.batch.environment import (
    DECISION,
    DUE,
    Autoreset,
    EpisodeKernel,
    goal_reward_function,
)  # fmt: skip
from redundant_envs.simulator.batch.slots import LaneBuffer, Slots
from redundant_envs.simulator.lane.episode import GOAL, TABLES, TIP, Episode
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, SCRATCH, STATE, Layout, Lifetime
from redundant_envs.tasks.base import Task

ARGUMENTS = {
    "state": "f64", "parameter": "f64", "generator": "i64", "due": "i8", "actions": "f32", "obs": "f32",
    **TABLES, "last_obs": "f32", **{f"last_{table}": element for table, element in TABLES.items()},
    **dict.fromkeys(("count", "stride", "substeps", "autoreset", DECISION), "int"),
}  # fmt: skip
"""Arguments of the kernels. The stride is that of the rows of states, parameters, generators and tables."""
LEVELS = {"scratch": "f64", "lists": "i64", "counters": "i64", "level": "int", "groups": "int"}
"""Further arguments of the kernels of a step in levels: a row for each scratch field, two lists of lanes that
have not crossed their interval, which levels fill in turn, and a counter for each level and group."""
GROUP_BITS = 14
"""Each group of 2^14 lanes has a part of the lists and a counter of its own: few threads add to one."""
TRIALS = 2
"""Trial steps of a level: nearly all lanes that leave the common step need two (docs/design.md)."""
FACTOR = 0x2360ED05_1FC65DA4_4385DF64_9FCCF645
"""Of NumPy's PCG64, by which its state of 128 bits is multiplied."""
ASKED = 2
"""Of lanes in which a reset begins an episode; in those that are due the next step does."""
AGAIN = ("entered", "due", "touching", "moving", "complete")
"""Fields by which the program of a lane tells what it waits for."""


class LaneBlocks(Blocks):
    """A single block of one lane, whose memories a thread has for itself."""

    def __init__(self, p: Kernel, episode: Episode) -> None:
        super().__init__(p, episode.interval, episode.layout())
        self.count: Any = 1
        self.own: Block
        self.stored: set[tuple[str, int]] = set()  # rows that the kernel itself writes

    def block(self, number: Any, in_group: Any) -> Block:
        return self.own

    def _keep(self, function: LaneFunction) -> LaneFunction:
        function.name = f"{self.p.name}_{function.name}"  # a program has several kernels with its like
        return super()._keep(function)

    def stop_if_asked(self) -> None:
        """Nobody asks a GPU."""

    def call(self, function: LaneFunction, block: Block, outputs: Any = None) -> None:
        tables = {
            name: self.p[name] + block.first * columns for name, (_, columns) in function.inputs.items()
        }
        self.p.call(function, **tables, **block.pointers, **(outputs or {}))

    def store(self, pointers: Mapping[str, Scalar], lane: Any, name: str, value: Any) -> None:
        self.stored.add(self.layout.row_of(name))
        super().store(pointers, lane, name, value)

    def changed(self, lifetime: Lifetime) -> list[int]:
        """Rows of a memory that are written."""
        stored = self.stored.union(s[:2] for f in self.functions.values() for s in f.stores)
        return sorted(row for space, row in stored if space == lifetime)


class LaneSlots(Slots):
    """Local time stepping of one lane: its program runs where the lane is."""

    def __init__(self, blocks: LaneBlocks, ends: Ends) -> None:
        self.blocks, self.p, self.interval = blocks, blocks.p, blocks.interval
        self.layout, self.features, self.ends, self.logs = (
            blocks.layout,
            blocks.interval.features,
            ends,
            False,
        )
        self.trace()

    def block(self, number: Any) -> Block:
        return self.blocks.block(number, 0)

    @property
    def slots(self) -> LaneBuffer:  # type: ignore[override]
        return LaneBuffer(self.block(0).pointers, None)  # type: ignore[arg-type]

    def advance(self) -> None:
        p, block = self.p, self.block(0)
        if self.features.repeats_common_step:
            self.again = p.variable(0)
            self.blocks.call(self.cleared, block)
            self.pieces(0, 1)  # type: ignore[arg-type]
        else:
            self.group(0, 1)
        self.finish(block)

    def finish(self, block: Block) -> None:
        """The end of an interval."""
        self.p.call(self.ended, **block.pointers, **self.ends.outputs(block))
        self.ends.finish(block)

    def group(self, first: Any, end: Any) -> None:
        block = self.block(0)
        with self.blocks.going_on(block):
            self.start(block)
            with self.p.when(self.blocks.mask(block.pointers, "reason") != 0):
                self.enter()
                self.cross(block)

    def run(self, first: Any, busy: Any) -> None:
        """Its lane has crossed its interval in :meth:`group`."""

    def kept(self) -> list[int]:
        """Scratch rows that a lane needs after the common step, and after each trial step."""
        later = [*self.goes_on.values(), self.stepped, self.recorded, self.ended]
        later += [self.contact] if self.features.resolves else []
        written = {s[:2] for f in self.blocks.functions.values() for s in f.stores}
        read = set().union(*(self.blocks.reads[f.name] for f in later))
        asked = {self.layout.row_of(name) for name in AGAIN}
        return sorted(row for space, row in read & written | asked if space == SCRATCH)

    def start(self, block: Block) -> None:
        """The common step."""
        self.blocks.call(self.started, block)
        self.common_step(block)

    def enter(self) -> None:
        """Leave the common step."""
        self.blocks.store(self.slots.pointers, 0, "entered", 1.0)
        if self.features.boundaries:  # else a trial step begins with it
            self.begin(self.slots)

    def cross(self, block: Block) -> None:
        """Cross the rest of the interval."""
        with self.p.loop_while(lambda: self.blocks.mask(block.pointers, "complete") == 0):
            self.trial()
        self.blocks.store(block.pointers, 0, "complete", 0.0)


class LaneKernel(EpisodeKernel):
    """A kernel of an environment, for a lane each time. ValueError if the scene has too many operations."""

    blocks: LaneBlocks

    def __init__(self, name: str, episode: Episode, shares: bool, threads: bool, more: Any = ()) -> None:
        """``shares``: all lanes have the same parameters, one after the other. With ``threads`` each thread
        has a lane; otherwise a call goes through all."""
        self.shares, self.threads = shares, threads
        p = Kernel(name, {**ARGUMENTS, **dict(more)}, 1)
        super().__init__(p, LaneBlocks(p, episode), episode)

    def take(self, lane: Scalar, kept: Sequence[int] = ()) -> Block:
        """The memories of a lane: copies of its rows, and scratch rows that were ``kept``, or 0."""
        p, layout = self.p, self.blocks.layout
        pointers = {str(life): p.space(max(1, layout.size(life))) for life in (STATE, SCRATCH, LOG)}
        pointers[str(PARAMETER)] = p["parameter"] + 0 if self.shares else p.space(layout.size(PARAMETER))
        for life in (STATE,) if self.shares else (STATE, PARAMETER):
            for row in range(layout.size(life)):
                p.store(pointers[str(life)], row, p.load(p[str(life)], p["stride"] * row + lane))
        for row in range(layout.size(SCRATCH)):
            value = p.load(p["scratch"], p["stride"] * row + lane) if row in kept else 0.0
            p.store(pointers[str(SCRATCH)], row, value)
        self.blocks.own = Block(lane, 1, pointers)  # type: ignore[arg-type]
        return self.blocks.own

    def give(self, block: Block) -> None:
        """Write the rows that some function has changed."""
        p = self.p
        for life in (STATE,) if self.shares else (STATE, PARAMETER):
            for row in self.blocks.changed(life):
                p.store(p[str(life)], p["stride"] * row + block.first, p.load(block.pointers[str(life)], row))

    def begin(self, block: Block) -> None:
        """A new episode of a lane, from the next key of its generator."""
        words = self.next_word(block.first), self.next_word(block.first)
        self.draw(block, 0, [half for word in words for half in (word & LOW, word >> 32)])
        self.reset(block)
        self.blocks.store(block.pointers, 0, "resetting", 0.0)

    def next_word(self, lane: Scalar) -> Scalar:
        """The next 64 bits of the lane's PCG64; rows of it are the halves of state and increment."""
        p, stride = self.p, self.p["stride"]
        high, low, more_high, more_low = (p.load(p["generator"], stride * row + lane) for row in range(4))
        f_high, f_low = _signed(FACTOR >> 64), _signed(FACTOR & (1 << 64) - 1)
        product = low * f_low
        new_low = product + more_low
        carry = ((product & more_low) | ((product | more_low) & ~new_low)) >> 63
        new_high = _upper(low, FACTOR & (1 << 64) - 1) + high * f_low + low * f_high + more_high + carry
        p.store(p["generator"], lane, new_high)
        p.store(p["generator"], stride + lane, new_low)
        mixed, turn = new_high ^ new_low, new_high >> 58
        return (mixed >> turn) | (mixed << ((64 - turn) & 63))

    def autoreset(self, block: Block) -> None:
        """Autoreset of a lane after its step."""
        p, mask, lane = self.p, self.blocks.mask, block.first
        done = mask(block.pointers, "terminated") | mask(block.pointers, "truncated")
        with p.when(p["autoreset"] == Autoreset.NEXT_STEP):
            due = p.load(p["due"], lane)
            p.store(p["due"], lane, p.select(due == DUE, 0, done))
            with p.when(due == DUE):
                self.begin(block)
                self.observe(block)
        with p.when((p["autoreset"] == Autoreset.SAME_STEP) & (done != 0)):
            self.keep_last(lane)
            self.begin(block)
            self.observe(block)
            self.copy_ends(block, 0)


def programs(episode: Episode, shares: bool, threads: bool = True) -> tuple[list[Kernel], Layout]:
    """The kernels "reset" and "step", or instead of it "first", "next" and "last" where lanes may need
    different numbers of steps; and the fields of their lanes."""
    features = episode.features
    levels = features.local and not features.repeats_common_step and not episode.decides
    names = ("first", "next", "last") if levels else ("step",)
    task = episode.task
    rewards = [goal_reward_kernel(task, threads)] if task.goal_conditioned else []
    kernels = [_reset_kernel(episode, shares, threads)]
    for name in names:
        made = LaneKernel(name, episode, shares, threads, LEVELS if levels else {})
        (_record_level if levels else _record_step)(made)
        made.blocks.prune()
        kernels.append(made)
    return [*(kernel.p for kernel in kernels), *rewards], kernels[-1].blocks.layout


def goal_reward_kernel(task: Task, threads: bool = True) -> Kernel:
    """A kernel for the reward of goal environments, of a pair of goals each time."""
    p = Kernel("goal_reward", {"pairs": "f64", "numbers": "f64", "reward": "f64", "count": "int"}, 1)
    with _each_lane(p, threads) as lane:
        pairs, reward = p["pairs"] + lane * len((*TIP, *GOAL)), p["reward"] + lane
        p.call(goal_reward_function(task), pairs=pairs, reward=reward, numbers=p["numbers"])
    return p


@contextlib.contextmanager
def _each_lane(p: Kernel, threads: bool) -> Iterator[Scalar]:
    """For a thread, its number among all, if there are so many lanes."""
    if threads:
        index = p.record("thread")
        with p.when(index < p["count"]):
            yield index
    else:
        with p.each(p["count"]) as index:
            yield index


def _reset_kernel(episode: Episode, shares: bool, threads: bool) -> LaneKernel:
    """A kernel that begins an episode in lanes for which one is due, and observes all."""
    kernel = LaneKernel("reset", episode, shares, threads)
    p = kernel.p
    with _each_lane(p, kernel.threads) as lane:
        block = kernel.take(lane)
        with p.when(p.load(p["due"], lane) == ASKED):
            kernel.begin(block)
            p.store(p["due"], lane, 0)
        kernel.observe(block)
        kernel.give(block)
    kernel.blocks.prune()
    return kernel


def _ends(kernel: LaneKernel) -> Ends:
    inputs = {"actions": ("f32", kernel.episode.actions)}
    return Ends(kernel.episode.command, inputs, kernel.end, kernel.outputs)


def _advance(blocks: LaneBlocks, ends: Ends) -> Callable[[], None]:
    local = blocks.interval.features.local
    return LaneSlots(blocks, ends).advance if local else functools.partial(blocks.advance, ends)


def _record_step(kernel: LaneKernel) -> None:
    """A step of each lane."""
    p, blocks, episode = kernel.p, kernel.blocks, kernel.episode
    if not episode.decides:
        advance = _advance(blocks, _ends(kernel))
        with _each_lane(p, kernel.threads) as lane:
            block = kernel.take(lane)
            advance()
            kernel.autoreset(block)
            kernel.give(block)
        return
    decide = blocks.function("decide", episode.decide, inputs=_ends(kernel).inputs)
    begin, end = episode.begin_step_of_decision, episode.finish_step_of_decision
    advance = _advance(blocks, Ends(begin, {}, end, lambda block: {}))
    with _each_lane(p, kernel.threads) as lane:
        block = kernel.take(lane)
        blocks.call(decide, block)
        with p.each(p[DECISION]):
            advance()
        kernel.observe(block)
        kernel.autoreset(block)
        kernel.give(block)


def _record_level(kernel: LaneKernel) -> None:
    """A part of a step. "first" takes the common step and ends the intervals of the lanes that it serves;
    "next" takes :data:`TRIALS` trial steps of each other lane, "last" all that remain: so the threads of a
    warp stay together."""
    p, blocks, name = kernel.p, kernel.blocks, kernel.p.name
    slots = LaneSlots(blocks, _ends(kernel))
    kept = slots.kept()

    def finish(block: Block) -> None:
        slots.finish(block)
        kernel.autoreset(block)
        kernel.give(block)

    def leave(block: Block, level: Any) -> None:
        """Keep what the lane needs at the next level, and enter it in the list of that level."""
        kernel.give(block)
        for row in kept:
            value = p.load(block.pointers[str(SCRATCH)], row)
            p.store(p["scratch"], p["stride"] * row + block.first, value)
        group = block.first >> GROUP_BITS
        place = p.record("take", p["counters"] + (level * p["groups"] + group))
        p.store(p["lists"], (level & 1) * p["stride"] + (group << GROUP_BITS) + place, block.first)

    with _each_lane(p, kernel.threads) as index:
        if name == "first":
            block = kernel.take(index)
            slots.start(block)
            goes_on = blocks.mask(block.pointers, "reason") != 0
            with p.when(goes_on):
                blocks.store(block.pointers, 0, "entered", 1.0)
                leave(block, p["level"])
            with p.when(~goes_on):
                finish(block)
            return
        level, group = p["level"], index >> GROUP_BITS
        place = index & ((1 << GROUP_BITS) - 1)
        with p.when(place < p.load(p["counters"], level * p["groups"] + group)):
            block = kernel.take(p.load(p["lists"] + (level & 1) * p["stride"], index), kept)
            with p.when(blocks.mask(block.pointers, "entered") != 0):
                slots.enter()
            if name == "last":
                slots.cross(block)
                finish(block)
                return
            with p.each(TRIALS), p.when(blocks.mask(block.pointers, "complete") == 0):
                slots.trial()
            complete = blocks.mask(block.pointers, "complete") != 0
            with p.when(complete):
                finish(block)
            with p.when(~complete):
                leave(block, level + 1)


def _signed(word: int) -> int:
    """A word of 64 bits as a signed number."""
    return word - (1 << 64) if word >> 63 else word


def _upper(a: Scalar, b: int) -> Scalar:
    """The upper half of the product of words of 64 bits."""
    a0, a1, b0, b1 = a & LOW, a >> 32, b & LOW, b >> 32
    middle = a1 * b0 + (a0 * b0 >> 32)
    rest = a0 * b1 + (middle & LOW)
    return a1 * b1 + (middle >> 32) + (rest >> 32)
