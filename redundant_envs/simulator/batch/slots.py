"""Local time stepping in a kernel, and the part of the log of events that kernels do."""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.flow import LaneFunction, Scalar
from redundant_envs.simulator.batch.blocks import GROUP, Block, Blocks, Ends, Procedure
from redundant_envs.simulator.events.contacts import Happening
from redundant_envs.simulator.lane.event_log import MAX_LOGGED, EventLog
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, SCRATCH, STATE
from redundant_envs.simulator.lane.interval import FIRST
from redundant_envs.simulator.lane.program import Request

IDLE = -2.0
"""State of a slot without a lane."""


class LaneBuffer(NamedTuple):
    """A block of lanes that have left their own."""

    pointers: dict[str, Scalar]  # the addresses of its memories
    homes: Scalar  # the address of the numbers of its lanes


class Brought(NamedTuple):
    """What a lane brings to a seat."""

    fields: list[str]
    numbers: list[str]  # parameters, unless all lanes share them


class Slots:
    """Local time stepping: lanes that the common step does not serve go through slots, a block at a time.
    With boundaries they first begin together, in a block in front: slots become free singly."""

    def __init__(self, blocks: Blocks, ends: Ends) -> None:
        self.blocks, self.p, self.interval = blocks, blocks.p, blocks.interval
        self.layout, self.features, self.ends = blocks.layout, blocks.interval.features, ends
        self.logs = isinstance(self.features.log, EventLog)
        self.trace()  # before any address: the program of a lane declares fields
        p, lanes, homes = self.p, blocks.lanes, self.p["queue"] + GROUP * blocks.lanes
        self.shared = p["parameter_stride"] == 0
        self.waiting = p["queue"] + 0
        self.slots = LaneBuffer(self._pointers(0), homes)
        self.entry = LaneBuffer(self._pointers(1), homes + lanes)
        self.all = (1 << lanes) - 1  # the bits of all slots
        self.head, self.tail, self.busy, self.free = map(p.variable, (0, 0, 0, self.all))
        self.again = p.variable(0)  # whether lanes of a group have to cross their interval again
        self.next, self.last = p.variable(0), p.variable(0)  # lanes of the entry that wait for a slot
        self.before = p.variable(0)  # number of busy lanes of the previous group

    def _pointers(self, number: int) -> dict[str, Scalar]:
        """The addresses of the memories of the slots, 0, or of the entry, 1."""
        p, blocks = self.p, self.blocks
        start = p["scratch"] + (2 * GROUP * blocks.width(SCRATCH) + number * blocks.buffer_size)
        own_parameters = start + (blocks.width(STATE) + blocks.width(SCRATCH))
        return {
            str(STATE): start,
            str(SCRATCH): start + blocks.width(STATE),
            str(PARAMETER): p.select(self.shared, p["parameter"], own_parameters, kind="f64"),
            str(LOG): p["log"] + 0,
        }

    def block(self, number: Scalar) -> Block:
        """A block by its number; two groups have scratch memories at the same time."""
        return self.blocks.block(number, number & (2 * GROUP - 1))

    def advance(self) -> None:
        p, count = self.p, self.blocks.count
        groups = (count + (GROUP - 1)) >> 6
        # Slots never wait for the last lanes of a group: these continue beside those of the next one, but
        # for intervals of several common steps.
        repeated = self.features.repeats_common_step
        with p.each(groups if repeated else groups + 1) as group:
            first = group * GROUP
            end = p.select(first + GROUP < count, first + GROUP, count)
            if repeated:
                with p.each(end, start=first) as number:
                    self.blocks.call(self.cleared, self.block(number))
                self.pieces(first, end)
                start = first
            else:
                self.before.value = self.busy.value
                self.group(first, end)
                self.run(first, lambda: self.before.value > 0)
                start = p.select(group > 0, first - GROUP, 0)
                end = p.select(first < count, first, count)
            with p.each(end, start=start) as number:
                block = self.block(number)
                p.call(self.ended, **block.pointers, **self.ends.outputs(block))
                self.ends.finish(block)

    def pieces(self, first: Scalar, end: Scalar) -> None:
        """Cross an interval that has several common steps with a group of blocks."""
        p, pieces = self.p, self.interval.pieces
        with contextlib.ExitStack() as each:
            if pieces.attempts > 1:
                self.again.value = 1
                each.enter_context(p.loop_while(lambda: self.again.value != 0))
            with contextlib.ExitStack() as steps:
                for begun in self.begun:
                    steps.enter_context(p.each(pieces.count))
                    with p.each(end, start=first) as number:
                        p.call(begun, **self.block(number).pointers)
                steps.enter_context(p.each(p["substeps"]))
                self.group(first, end)
                self.run(first, lambda: self.busy.value > 0)
            if pieces.attempts > 1:
                self.settle(first, end)

    def settle(self, first: Scalar, end: Scalar) -> None:
        """After the pieces of an interval: which lanes have to cross it again."""
        self.again.value = 0
        with self.p.each(end, start=first) as number:
            block = self.block(number)
            self.p.call(self.doubted, **block.pointers)
            with self.p.when(self.blocks.mask(block.pointers, "again") & self.blocks.valid(block) != 0):
                self.p.call(self.settled, **block.pointers)
                again = self.blocks.mask(block.pointers, "again") & self.blocks.valid(block)
                self.again.value = self.again.value | again

    def trace(self) -> None:
        """The functions of blocks, and those of slots."""
        make, step, boundaries = self.blocks.function, self.interval.step, self.interval.boundaries
        i, pieces, inputs = self.features, self.interval.pieces, self.ends.inputs
        begin: tuple[Procedure, ...] = (self.ends.begin, step.clear)
        self.goes_on = self.blocks.program()
        if i.repeats_common_step:
            self.cleared = make("clear", *begin, inputs=inputs)
            begin, inputs = (), {}
        self.begun = [make("next_piece", begin) for begin in pieces.begins]
        if pieces.attempts > 1:
            self.doubted, self.settled = make("doubt", pieces.doubt), make("settle", pieces.settle)
        # Under error control it is known before the common step which lanes it may serve, and with stops,
        # which sliders rest.
        self.started = make("start", *begin, step.start, inputs=inputs)
        self.common = make("common", step.common_step, step.judge, known=dict.fromkeys(i.active, 0.0))
        if i.holding:
            forces = boundaries.update_constraint_forces
            self.common_held = make("common_held", step.common_step, forces, step.judge)
            self.released = make("release", boundaries.release)
        if i.bounded:
            self.confirmed = make("confirm_crossings", boundaries.confirm_crossings)
        if i.dynamics.controlled:
            self.skipped = make("skip_common_step", step.skip_common_step)
        of_blocks = [f for n, f in self.blocks.functions.items() if f not in self.goes_on.values()]
        self.ended = make("end", self.ends.end)
        self.stepped = make("trial_step", step.trial_step)
        self.recorded = make("record_step", step.record_step)
        of_entry = [self.goes_on[stretch] for stretch in (None, FIRST) if stretch in self.goes_on]
        of_slots = [*(f for f in self.goes_on.values() if f not in of_entry), self.stepped, self.recorded]
        if i.resolves:
            self.contact = make("find_contact_forces", boundaries.find_contact_forces)
            of_slots.append(self.contact)
        self.name_fields(of_blocks, of_entry, of_slots)

    def name_fields(self, *functions: Sequence[LaneFunction]) -> None:
        """Fields that a lane brings from its block, takes from the entry to a slot, and brings back, which
        follow from what functions of blocks, of the entry and of slots read and write."""
        reads = self.blocks.reads
        _, read_in_entry, read_in_slots = (set().union(*(reads[f.name] for f in some)) for some in functions)
        in_blocks, in_entry, in_slots = ({s[:2] for f in some for s in f.stores} for some in functions)
        read_in_slots |= {self.layout.row_of(name) for name in self.features.log.read}  # by no function
        at_end = reads[self.ended.name] | {self.layout.row_of("fault")}
        if self.interval.pieces.attempts > 1:
            at_end = at_end.union(*(reads[f.name] for f in (*self.begun, self.doubted, self.settled)))
        read_in_entry |= read_in_slots
        self.brought = Brought(self._fields(read_in_entry, in_blocks), self._numbers(read_in_entry))
        taken = self._fields(read_in_slots | {self.layout.row_of("complete")}, in_blocks | in_entry)
        taken += [n for n in self._fields(in_entry, at_end) if n not in taken]
        self.taken = Brought(taken, self._numbers(read_in_slots))
        self.returned = self._fields(in_entry | in_slots, at_end)

    def _fields(self, rows: set[tuple[str, int]], and_these: set[tuple[str, int]]) -> list[str]:
        """Fields in some rows: states, and those that are in other rows, too."""
        at = self.layout.places().items()
        return [n for n, row in at if row in rows and (row[0] == STATE or row in and_these)]

    def _numbers(self, rows: set[tuple[str, int]]) -> list[str]:
        """Parameters in some rows."""
        return [n for n, row in self.layout.places().items() if row in rows and row[0] == PARAMETER]

    def group(self, first: Scalar, end: Scalar) -> None:
        """Take a common step with a group of blocks; lanes that it does not serve wait for a slot."""
        p, blocks = self.p, self.blocks
        self.head.value = self.tail.value = 0
        with p.each(end, start=first) as number:
            block = self.block(number)
            blocks.stop_if_asked()
            with blocks.going_on(block):
                blocks.call(self.started, block)
                self.common_step(block)
                with p.each_set(blocks.mask(block.pointers, "reason") & blocks.valid(block)) as lane:
                    p.store(self.waiting, self.tail.value, block.first + lane)
                    self.tail.value = self.tail.value + 1

    def run(self, first: Scalar, busy: Callable[[], Scalar]) -> None:
        """Take trial steps in the slots as long as lanes wait for one, or some are still ``busy``."""
        with self.p.loop_while(lambda: (self.head.value < self.tail.value) | busy()):
            self.blocks.stop_if_asked()
            with self.p.each_set(self.free.value) as slot:
                self.fill(slot)
            self.trial()
            with self.p.each_set(self.blocks.mask(self.slots.pointers, "complete")) as slot:
                self.leave(slot, first)

    def common_step(self, block: Block) -> None:
        p, i, pointers = self.p, self.features, block.pointers
        if i.control is Control.ADAPTIVE:
            p.call(self.skipped, **pointers)
            return
        with contextlib.ExitStack() as served:
            if i.control is Control.EQUAL:
                served_lanes = self.blocks.valid(block) & ~self.blocks.mask(pointers, "min_steps")
                with p.when(served_lanes == 0):
                    p.call(self.skipped, **pointers)
                served.enter_context(p.when(served_lanes != 0))
            if i.holding:
                self._held_or_free(block)
            else:
                p.call(self.common, **pointers)
            if i.bounded:
                with p.when(self.blocks.mask(pointers, "reason") != 0):
                    p.call(self.confirmed, **pointers)

    def _held_or_free(self, block: Block) -> None:
        """A common step, in a faster form for blocks in which no slider rests."""
        p, pointers = self.p, block.pointers
        resting = p.variable(0)
        for name in self.features.active:
            resting.value = resting.value | self.blocks.mask(pointers, name)
        with p.when(resting.value == 0):
            p.call(self.common, **pointers)
        with p.when(resting.value != 0):
            p.call(self.released, **pointers)
            if self.logs:
                self.log_released(block)
            p.call(self.common_held, **pointers)

    def trial(self) -> None:
        """Take a trial step with all slots, and let their programs go on."""
        p, i, slots, mask = self.p, self.features, self.slots.pointers, self.blocks.mask
        if not i.boundaries:
            self.begin(self.slots)
        if i.resolves:
            with p.loop_while(lambda: mask(slots, "touching") != 0):
                p.call(self.contact, **slots)
                p.call(self.goes_on[Request.FORCES], **slots)
                if self.logs:
                    self.log_resolved()
        p.call(self.stepped, **slots)
        p.call(self.recorded, **slots)
        if i.resolves:
            p.call(self.contact, **slots)
        p.call(self.goes_on[Request.STEP], **slots)

    def log_resolved(self) -> None:
        """Log the events of the lanes in the slots."""
        p, load, pointers = self.p, self.blocks.load, self.slots.pointers
        with p.each_set(self.free.value ^ self.all) as slot:
            lane = p.load(self.slots.homes, slot)
            log = p["log"] + self.blocks.block_of(lane) * self.blocks.width(LOG)
            for k, b in enumerate(self.features.stops):
                happened = load(pointers, slot, b.happened)
                with p.when(happened > 0.0):
                    time = load(pointers, slot, "span_start") + load(pointers, slot, "elapsed")
                    event = time, happened + 10.0 * k, load(pointers, slot, b.speed)
                    self._append(log, self.blocks.in_block(lane), pointers, slot, event)
                    self.blocks.store(pointers, slot, b.happened, 0.0)

    def log_released(self, block: Block) -> None:
        """Log the sliders that were released before the common step."""
        p, load, pointers = self.p, self.blocks.load, block.pointers
        with p.each(self.blocks.lanes) as lane:
            for k, b in enumerate(self.features.holding):
                names = b.active_stop, f"{b.active_stop}_start"
                now, before = (load(pointers, lane, name) for name in names)
                with p.when(now != before):
                    event = load(pointers, lane, "span_start"), Happening.RELEASE + 10.0 * k, 0.0
                    self._append(pointers[str(LOG)], lane, pointers, lane, event)

    def _append(self, log: Scalar, lane: Any, counts: Any, seat: Any, event: tuple[Any, ...]) -> None:
        """Append an event, with its time, kind and speed, to the log of a lane, if there is room."""
        p, count = self.p, self.blocks.load(counts, seat, "logged")
        with p.when(count < float(MAX_LOGGED)):
            at = p.whole(count) * (3 * self.blocks.lanes) + lane
            for k, value in enumerate(event):
                p.store(log, at + k * self.blocks.lanes, value)
            self.blocks.store(counts, seat, "logged", count + 1.0)

    def _copy(self, names: Sequence[str], goal: Any, goal_lane: Any, source: Any, source_lane: Any) -> None:
        for name in names:
            self.blocks.store(goal, goal_lane, name, self.blocks.load(source, source_lane, name))

    def begin(self, seats: LaneBuffer) -> None:
        """Begin the programs of the lanes that have just come to some seats."""
        p, pointers, mask = self.p, seats.pointers, self.blocks.mask
        with p.when(mask(pointers, "entered") != 0):
            p.call(self.goes_on[None], **pointers)
            if FIRST in self.goes_on:
                with p.when(mask(pointers, "due") != 0):
                    p.call(self.goes_on[FIRST], **pointers)

    def fill(self, slot: Scalar) -> None:
        """Give a free slot to the next lane, if one waits."""
        p, waits = self.p, lambda: self.head.value < self.tail.value
        if not self.features.boundaries:
            with p.when(waits()):
                self.take(self.slots, slot)
                self.free.value = self.free.value & ~p.record("<<", 1, slot)
            return
        with p.when((self.next.value == self.last.value) & waits()):
            self.next.value = self.last.value = 0
            with p.loop_while(lambda: waits() & (self.last.value < self.blocks.lanes)):
                self.take(self.entry, self.last.value)
                self.last.value = self.last.value + 1
            self.begin(self.entry)
        with p.when(self.next.value < self.last.value):
            seat = self.next.value
            p.store(self.slots.homes, slot, p.load(self.entry.homes, seat))
            self._bring(self.taken, self.slots, slot, self.entry.pointers, seat)
            self.next.value = self.next.value + 1
            self.free.value = self.free.value & ~p.record("<<", 1, slot)

    def take(self, seats: LaneBuffer, seat: Scalar) -> None:
        """Move a waiting lane to a free seat."""
        lane = self.p.load(self.waiting, self.head.value)
        self.head.value = self.head.value + 1
        self.busy.value = self.busy.value + 1
        self.p.store(seats.homes, seat, lane)
        home, k = self.block(self.blocks.block_of(lane)), self.blocks.in_block(lane)
        self._bring(self.brought, seats, seat, home.pointers, k)
        self.blocks.store(seats.pointers, seat, "entered", 1.0)

    def _bring(self, what: Brought, seats: LaneBuffer, seat: Any, source: Any, lane: Any) -> None:
        """Copy fields of a lane to a seat."""
        self._copy(what.fields, seats.pointers, seat, source, lane)
        with self.p.when(~self.shared):
            self._copy(what.numbers, seats.pointers, seat, source, lane)

    def leave(self, slot: Scalar, first: Scalar) -> None:
        """Return a lane that has crossed its interval to its block; ``first`` begins the present group."""
        lane, slots = self.p.load(self.slots.homes, slot), self.slots.pointers
        self.busy.value = self.busy.value - 1
        self.before.value = self.before.value - self.p.select(self.blocks.block_of(lane) < first, 1, 0)
        self.free.value = self.free.value | self.p.record("<<", 1, slot)
        home, k = self.block(self.blocks.block_of(lane)), self.blocks.in_block(lane)
        self._copy(self.returned, home.pointers, k, slots, slot)
        self.blocks.store(slots, slot, "complete", 0.0)
        self.blocks.store(slots, slot, "state", IDLE)


def advance(blocks: Blocks, ends: Ends) -> None:
    """Advance all lanes by a control interval."""
    if blocks.interval.features.local:
        Slots(blocks, ends).advance()
    else:
        blocks.advance(ends)
