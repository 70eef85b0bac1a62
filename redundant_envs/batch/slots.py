"""Local time stepping in a kernel: lanes that leave the common step go through slots, eight at a time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from redundant_envs.batch.blocks import GROUP, LANES, Block, Blocks, Ends, Procedure, written_by
from redundant_envs.events.contacts import Happening
from redundant_envs.lane.features import MOST_LOGGED, Control
from redundant_envs.lane.memory import LOG, PARAMETER, SCRATCH, STATE
from redundant_envs.lane.program import Request
from redundant_envs.tracing.flow import Scalar

IDLE = -2.0
"""State of a slot without a lane."""


class Slots:
    """Local time stepping: lanes that the common step does not serve go through slots, eight at a time."""

    def __init__(self, blocks: Blocks, ends: Ends) -> None:
        self.blocks, self.p, self.interval = blocks, blocks.p, blocks.interval
        self.layout, self.features = blocks.layout, blocks.interval.features
        self.begin, self.inputs, self.ends = ends.begin, ends.inputs, ends
        self.trace()  # before any address: the program of a lane declares fields
        p, group = self.p, 2 * GROUP * blocks.width(SCRATCH)
        slots = p["scratch"] + group
        self.slots = {
            str(STATE): slots,
            str(SCRATCH): slots + blocks.width(STATE),
            str(PARAMETER): slots + (blocks.width(STATE) + blocks.width(SCRATCH)),
            str(LOG): p["log"] + 0,
        }
        self.shared = p["parameter_stride"] == 0
        self.slots[str(PARAMETER)] = p.choose(self.shared, p["parameter"], self.slots[str(PARAMETER)])
        self.waiting = p["queue"] + 0
        self.homes = p["queue"] + GROUP * LANES
        self.head, self.tail, self.busy = p.variable(0), p.variable(0), p.variable(0)
        self.free = p.variable(255)
        self.before = p.variable(0)
        """Number of busy slots with lanes of the previous group."""

    def finish(self, block: Block) -> None:
        """Finish a block whose lanes have crossed the interval."""
        self.p.call(self.ended, **block.pointers, **self.ends.outputs(block))
        self.ends.finish(block)

    def block(self, number: Scalar) -> Block:
        """A block by its number; two groups have scratch memories at the same time."""
        return self.blocks.block(number, number & (2 * GROUP - 1))

    def advance(self) -> None:
        p, count = self.p, self.blocks.count
        groups = (count + (GROUP - 1)) >> 6
        if self.features.repeated:
            with p.each(groups) as group:
                first = group * GROUP
                end = p.select(first + GROUP < count, first + GROUP, count)
                with p.each(end, start=first) as number:
                    self.blocks.call_with_tables(self.cleared, self.block(number), self.inputs)
                with p.each(p["substeps"]):
                    self.group(first, end)
                    self.run(first, lambda: self.busy.value > 0)
                with p.each(end, start=first) as number:
                    self.finish(self.block(number))
            return
        # Slots never wait for the last lanes of a group: these continue beside those of the next one.
        with p.each(groups + 1) as group:
            first = group * GROUP
            end = p.select(first + GROUP < count, first + GROUP, count)
            self.before.value = self.busy.value
            self.group(first, end)
            self.run(first, lambda: self.before.value > 0)
            start = p.select(group > 0, first - GROUP, 0)
            with p.each(p.select(first < count, first, count), start=start) as number:
                self.finish(self.block(number))

    def trace(self) -> None:
        """The functions of blocks, and those of slots."""
        make, step, boundaries = self.blocks.function, self.interval.step, self.interval.boundaries
        i = self.features
        self.goes_on = self.blocks.program()
        before: tuple[Procedure, ...] = (self.begin, step.clear, step.start)
        if i.repeated:
            self.cleared = make("clear", self.begin, step.clear, inputs=self.inputs)
            before = (step.start,)
        inputs = {} if i.repeated else self.inputs
        known = dict.fromkeys(i.active, 0.0)
        # Under error control it is known before the common step which lanes it may serve, and with stops,
        # which sliders rest.
        self.started = make("start", *before, inputs=inputs)
        self.common = make("common", step.common_step, step.judge, known=known)
        if i.holding:
            self.common_held = make(
                "common_held", step.common_step, boundaries.update_constraint_forces, step.judge
            )
            self.released = make("release", boundaries.release)
        if i.boundaries:
            self.confirmed = make("confirm_crossings", boundaries.confirm_crossings)
        if i.control is not Control.FIXED:
            self.skipped = make("skip_common_step", step.skip_common_step)
        self.of_blocks = [f for n, f in self.blocks.functions.items() if f not in self.goes_on.values()]
        self.ended = make("end", self.ends.end)
        self.stepped = make("trial_step", step.trial_step)
        self.recorded = make("record_step", step.record_step)
        self.of_slots = [*self.goes_on.values(), self.stepped, self.recorded]
        if i.stops:
            self.contact = make("find_contact_forces", boundaries.find_contact_forces)
            self.of_slots.append(self.contact)

    def group(self, first: Scalar, end: Scalar) -> None:
        """Take a common step with a group of blocks; lanes that it does not serve wait for a slot."""
        p, blocks = self.p, self.blocks
        self.head.value = self.tail.value = 0
        with p.each(end, start=first) as number:
            block = self.block(number)
            inputs = {} if self.features.repeated else self.inputs
            blocks.call_with_tables(self.started, block, inputs)
            self.common_step(block)
            valid = (p.record("<<", 1, block.lanes)) - 1
            leaving = blocks.mask(block.pointers, "reason") & valid
            with p.each_set(leaving) as lane:
                p.store(self.waiting, self.tail.value, block.first + lane)
                self.tail.value = self.tail.value + 1

    def run(self, first: Scalar, busy: Callable[[], Scalar]) -> None:
        """Take trial steps in the slots as long as lanes wait for one, or some are still ``busy``."""
        p = self.p
        with p.loop_while(lambda: (self.head.value < self.tail.value) | busy()):
            with p.each_set(self.free.value) as slot, p.when(self.head.value < self.tail.value):
                self.take(slot)
            self.trial()
            complete = self.blocks.mask(self.slots, "complete")
            with p.each_set(complete) as slot:
                self.leave(slot, first)

    def common_step(self, block: Block) -> None:
        p, i, pointers = self.p, self.features, block.pointers
        if i.control is Control.ADAPTIVE:
            p.call(self.skipped, **pointers)
            return
        with contextlib.ExitStack() as served:
            if i.control is Control.EQUAL:
                mask = self.blocks.mask(pointers, "min_steps")
                serves = mask != 255
                with p.when(mask == 255):
                    p.call(self.skipped, **pointers)
                served.enter_context(p.when(serves))
            if i.holding:
                self._held_or_free(block)
            else:
                p.call(self.common, **pointers)
            if i.boundaries:
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
            if self.features.logs:
                self.log_released(block)
            p.call(self.common_held, **pointers)

    # ---- slots -----------------------------------------------------------------------------------------

    def trial(self) -> None:
        """Take a trial step with all slots, and let their programs go on."""
        p, i, slots, mask = self.p, self.features, self.slots, self.blocks.mask
        with p.when(mask(slots, "entered") != 0):
            p.call(self.goes_on[None], **slots)
            if i.boundaries:
                with p.when(mask(slots, "due") != 0):
                    p.call(self.goes_on[Request.STEP], **slots)
        if i.stops:
            with p.loop_while(lambda: mask(slots, "touching") != 0):
                p.call(self.contact, **slots)
                p.call(self.goes_on[Request.FORCES], **slots)
                if i.logs:
                    self.log()
        p.call(self.stepped, **slots)
        p.call(self.recorded, **slots)
        if i.holding:
            with p.when(mask(slots, "held") != 0):
                p.call(self.contact, **slots)
        p.call(self.goes_on[Request.STEP], **slots)

    @cached_property
    def carried_in(self) -> list[str]:
        """Fields of blocks that slots read."""
        known = {row for f in self.of_blocks for row in written_by(f)}
        read = set().union(*(self.blocks.reads[f.name] for f in self.of_slots))
        if self.features.logs:
            read.add(self.layout.row_of("span_start"))  # read by the log of events, and by no function
        return [
            n
            for n in self.layout.fields
            for row in [self.layout.row_of(n)]
            if row in read and (row[0] == STATE or row in known)
        ]

    @cached_property
    def carried_out(self) -> list[str]:
        """Fields that slots return: states, and fields that are read at the end of the interval."""
        written = {row for f in self.of_slots for row in written_by(f)}
        read = self.blocks.reads[self.ended.name] | {self.layout.row_of("fault")}
        return [
            n
            for n in self.layout.fields
            for row in [self.layout.row_of(n)]
            if row in written and (row[0] == STATE or row in read)
        ]

    def _home(self, lane: Scalar) -> tuple[Block, Scalar]:
        return self.block(lane >> 3), lane & (LANES - 1)

    def _copy(self, names: Sequence[str], goal: Any, goal_lane: Any, source: Any, source_lane: Any) -> None:
        for name in names:
            space, row = self.layout.row_of(name)
            value = self.p.load(source[space], source_lane + row * LANES)
            self.p.store(goal[space], goal_lane + row * LANES, value)

    def _set(self, slot: Scalar, name: str, value: float) -> None:
        space, row = self.layout.row_of(name)
        self.p.store(self.slots[space], slot + row * LANES, value)

    def take(self, slot: Scalar) -> None:
        """Move a waiting lane into a free slot."""
        p = self.p
        lane = p.load(self.waiting, self.head.value)
        self.head.value = self.head.value + 1
        self.busy.value = self.busy.value + 1
        self.free.value = self.free.value & ~p.record("<<", 1, slot)
        p.store(self.homes, slot, lane)
        home, k = self._home(lane)
        self._copy(self.carried_in, self.slots, slot, home.pointers, k)
        with p.when(~self.shared):
            numbers = [n for n, f in self.layout.fields.items() if f.lifetime is PARAMETER]
            self._copy(numbers, self.slots, slot, home.pointers, k)
        self._set(slot, "entered", 1.0)

    def leave(self, slot: Scalar, first: Scalar) -> None:
        """Return a lane that has crossed its interval to its block; ``first`` is the present group's first
        block."""
        p = self.p
        lane = p.load(self.homes, slot)
        self.busy.value = self.busy.value - 1
        self.before.value = self.before.value - p.select((lane >> 3) < first, 1, 0)
        self.free.value = self.free.value | p.record("<<", 1, slot)
        home, k = self._home(lane)
        self._copy(self.carried_out, home.pointers, k, self.slots, slot)
        self._set(slot, "complete", 0.0)
        self._set(slot, "state", IDLE)

    # ---- the log of events -----------------------------------------------------------------------------

    def _append(
        self, block: Any, lane: Any, counts: Any, slot: Any, time: Any, kind: Any, speed: Any
    ) -> None:
        """Append an event to the log of a lane, if there is room."""
        p = self.p
        space, row = self.layout.row_of("logged")
        count = p.load(counts[space], slot + row * LANES)
        with p.when(count < float(MOST_LOGGED)):
            at = p.whole(count) * (3 * LANES) + lane
            for k, value in enumerate((time, kind, speed)):
                p.store(block[str(LOG)], at + k * LANES, value)
            p.store(counts[space], slot + row * LANES, count + 1.0)

    def _of(self, pointers: Any, lane: Any, name: str) -> Scalar:
        space, row = self.layout.row_of(name)
        self.p.masked.add((space, row))
        return self.p.load(pointers[space], lane + row * LANES)

    def log(self) -> None:
        """Log the events of the sliders in the slots."""
        p = self.p
        with p.each_set(self.free.value ^ 255) as slot:
            lane = p.load(self.homes, slot)
            log = {str(LOG): p["log"] + (lane >> 3) * self.blocks.width(LOG)}
            for k, s in enumerate(self.features.stops):
                happened = self._of(self.slots, slot, f"happened_{s.name}")
                with p.when(happened > 0.0):
                    time = self._of(self.slots, slot, "span_start") + self._of(self.slots, slot, "elapsed")
                    speed = self._of(self.slots, slot, f"speed_{s.name}")
                    self._append(log, lane & (LANES - 1), self.slots, slot, time, happened + 10.0 * k, speed)
                    self._set(slot, f"happened_{s.name}", 0.0)

    def log_released(self, block: Block) -> None:
        """Log the sliders that were released before the common step."""
        p, pointers = self.p, block.pointers
        with p.each(LANES) as lane:
            for k, name in enumerate(self.features.active):
                now, was = self._of(pointers, lane, name), self._of(pointers, lane, f"{name}_start")
                with p.when(now != was):
                    time = self._of(pointers, lane, "span_start")
                    self._append(pointers, lane, pointers, lane, time, Happening.RELEASE + 10.0 * k, 0.0)


def advance(blocks: Blocks, ends: Ends) -> None:
    """Advance all lanes by a control interval."""
    if blocks.interval.features.local:
        Slots(blocks, ends).advance()
    else:
        blocks.advance(ends)
