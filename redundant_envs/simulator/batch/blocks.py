"""Blocks of lanes in a kernel: the addresses of their memories, and the loop that advances all of them."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from redundant_envs.compiler.tracing.flow import Kernel, LaneFunction, Scalar
from redundant_envs.compiler.tracing.graph import TooManyOperations, counted, reached
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, SCRATCH, STATE, Layout, Lifetime
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane, traced

GROUP = 64
"""Blocks that go through a step together: few enough to stay in a small cache, many enough that the code of
a step and the code of its events seldom replace each other in the instruction cache."""
MEMORY = {
    "state": "f64", "parameter": "f64", "log": "f64", "scratch": "f64", "queue": "i64",
    "parameter_stride": "int", "count": "int", "substeps": "int",
}  # fmt: skip
"""Arguments of kernels that advance lanes. The stride is 0 while all lanes share their parameters."""

Procedure = Callable[[Lane], Any]


@dataclass
class Block:
    """A block of lanes."""

    first: Scalar  # its first lane
    lanes: Scalar  # the number of its lanes
    pointers: dict[str, Scalar]  # the addresses of its memories


@dataclass
class Ends:
    """Work on the lanes at both ends of an interval."""

    begin: Procedure  # before anything else
    inputs: Mapping[str, Any]  # tables that it reads
    end: Procedure  # of a lane that has crossed the interval; it may return values for arrays
    outputs: Callable[[Block], dict[str, Any]]  # addresses of these arrays for a block
    finish: Callable[[Block], None] = lambda block: None  # records further work on a block


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """ValueError if what is recorded within this context would take too long to compile."""
    try:
        with counted():
            yield
    except TooManyOperations as error:
        raise ValueError(
            f"the program of this scene has {error}, which would take minutes to "
            "compile; leave some of its effects out, or take fixed steps in place of a tolerance"
        ) from None


class Blocks:
    """Lanes of an interval in a kernel, which has the arguments of :data:`MEMORY`."""

    def __init__(self, p: Kernel, interval: Interval, layout: Layout) -> None:
        self.p, self.interval, self.layout = p, interval, layout
        self.lanes = p.lanes  # of a block
        self.shift = p.lanes.bit_length() - 1  # their number is a power of two
        self.functions: dict[str, LaneFunction] = {}
        self.reads: dict[str, set[tuple[str, int]]] = {}  # memory rows that each function loads
        self.read: set[tuple[str, int]] = set()  # those that the kernel itself reads
        self.count = self.block_of(p["count"] + (p.lanes - 1))  # number of blocks

    def block_of(self, lane: Scalar) -> Scalar:
        """The number of the block of a lane."""
        return lane >> self.shift

    def in_block(self, lane: Scalar) -> Scalar:
        """The number of a lane in its block."""
        return lane & (self.lanes - 1)

    def width(self, lifetime: Lifetime) -> int:
        """Count of numbers of a block in a memory."""
        return self.layout.size(lifetime) * self.lanes

    @property
    def scratch_size(self) -> int:
        """Count of numbers of the scratch memory: two groups of blocks, and all fields of entry and slots."""
        if not self.interval.features.local:
            return self.width(SCRATCH)
        return 2 * GROUP * self.width(SCRATCH) + 2 * self.buffer_size

    @property
    def buffer_size(self) -> int:
        """Count of numbers of the memories of the entry, or of the slots."""
        return sum(map(self.width, (STATE, SCRATCH, PARAMETER)))

    @property
    def queue_size(self) -> int:
        """Count of whole numbers: the waiting lanes, the homes of entry and slots, and whether to stop."""
        return 1 + (GROUP * self.lanes + 2 * self.lanes if self.interval.features.local else 0)

    def stop_if_asked(self) -> None:
        """Return from the kernel if it is asked to stop; its memories are of no use then."""
        p = self.p
        with p.when(p.load(p["queue"], self.queue_size - 1) != 0):
            p.leave()

    def block(self, number: Any, in_group: Any) -> Block:
        """The block with a number; ``in_group`` is its index in the scratch memory."""
        p = self.p
        first = number * self.lanes
        rest = p["count"] - first
        lanes = p.select(rest < self.lanes, rest, self.lanes)
        pointers = {
            str(STATE): p["state"] + number * self.width(STATE),
            str(PARAMETER): p["parameter"] + number * p["parameter_stride"],
            str(SCRATCH): p["scratch"] + in_group * self.width(SCRATCH),
            str(LOG): p["log"] + number * self.width(LOG),
        }
        return Block(first, lanes, pointers)

    def function(self, name: str, *procedures: Procedure, **more: Any) -> LaneFunction:
        """Procedures of a lane, one after the other, as one compiled function."""
        return self._keep(traced(name, self.layout, *procedures, **more))

    def _keep(self, function: LaneFunction) -> LaneFunction:
        self.functions[function.name] = function
        self.reads[function.name] = {n.extra for n in reached(function.results) if n.name == "load"}
        return function

    def program(self) -> dict[Any, LaneFunction]:
        """The program of a lane as functions: at its beginning (None), and after each request."""
        functions = self.interval.traced_program(self.layout)
        return {request: self._keep(function) for request, function in functions.items()}

    def mask(self, pointers: Mapping[str, Scalar], name: str) -> Scalar:
        """Lanes of a block whose field is not 0."""
        space, row = self.layout.row_of(name)
        self.read.add((space, row))
        return self.p.mask(pointers[space], row)

    def load(self, pointers: Mapping[str, Scalar], lane: Any, name: str) -> Scalar:
        """A field of a lane of a block."""
        space, row = self.layout.row_of(name)
        self.read.add((space, row))
        return self.p.load(pointers[space], lane + row * self.lanes)

    def store(self, pointers: Mapping[str, Scalar], lane: Any, name: str, value: Any) -> None:
        """Set a field of a lane of a block."""
        space, row = self.layout.row_of(name)
        self.p.store(pointers[space], lane + row * self.lanes, value)

    def valid(self, block: Block) -> Scalar:
        """The lanes of a block, as the bits of a whole number."""
        return self.p.record("<<", 1, block.lanes) - 1

    def advance(self, ends: Ends) -> None:
        """Advance all lanes by a control interval."""
        p, interval = self.p, self.interval
        parts = ends.begin, interval.step.clear, interval.step.common_step, ends.end
        if not interval.features.repeats_common_step:
            whole = self.function("interval", *parts, inputs=ends.inputs)
            with p.each(self.count) as number:
                block = self.block(number, 0)
                self.stop_if_asked()
                self.call(whole, block, ends.outputs(block))
                ends.finish(block)
            return
        first = self.function("begin", *parts[:2], inputs=ends.inputs)
        step, last = self.function("step", parts[2]), self.function("end", parts[3])
        pieces = [self.function("next_piece", begin) for begin in interval.pieces.begins]
        with p.each(self.count) as number:
            block = self.block(number, 0)
            self.call(first, block)
            with contextlib.ExitStack() as each:
                for piece in pieces:
                    each.enter_context(p.each(interval.pieces.count))
                    p.call(piece, **block.pointers)
                    each.enter_context(self.going_on(block))
                each.enter_context(p.each(p["substeps"]))
                self.stop_if_asked()
                p.call(step, **block.pointers)
            p.call(last, **block.pointers, **ends.outputs(block))
            ends.finish(block)

    @contextlib.contextmanager
    def going_on(self, block: Block) -> Iterator[None]:
        """Where a lane of a block has a piece of the interval before it: others wait at its end."""
        if not self.interval.pieces.begins:
            yield
            return
        with self.p.when(self.mask(block.pointers, "h") & self.valid(block) != 0):
            yield

    def call(self, function: LaneFunction, block: Block, outputs: Mapping[str, Any] | None = None) -> None:
        """Call a function on a block, with the rows of tables that it reads: copies padded with 0 for a block
        that is not full."""
        p, tables = self.p, {}
        for table, (kind, columns) in function.inputs.items():
            there = p[table] + block.first * columns
            tile = p.space(self.lanes * columns, kind)
            with p.when(block.lanes < self.lanes):
                with p.each(self.lanes * columns) as i:
                    p.store(tile, i, p.number(i) * 0.0)
                with p.each(block.lanes * columns) as i:
                    p.store(tile, i, p.load(there, i))
            tables[table] = p.select(block.lanes == self.lanes, there, tile, kind=kind)
        p.call(function, **tables, **block.pointers, **(outputs or {}))

    def prune(self) -> None:
        """Drop stores within an interval to rows that no function and no loop reads."""
        read = self.read.union(*self.reads.values())
        for f in self.functions.values():
            f.stores[:] = [s for s in f.stores if s[0] != SCRATCH or s[:2] in read]
