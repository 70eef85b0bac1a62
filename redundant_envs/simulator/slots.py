"""Local time stepping in a kernel: lanes that leave the common step go through slots, eight at a time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from redundant_envs.integrators.contact_resolution import Event
from redundant_envs.simulator.blocks import GROUP, LANES, Block, Blocks, Ends, Procedure, written_by
from redundant_envs.simulator.lane import LOG, PARAMETER, SCRATCH, STATE
from redundant_envs.simulator.setting import MOST_LOGGED, Plan
from redundant_envs.tracing.flow import Scalar


class Slots:
    """Local time stepping: lanes that the common step does not serve go through slots, eight at a time."""

    def __init__(self, blocks: Blocks, ends: Ends) -> None:
        self.blocks, self.p, self.interval = blocks, blocks.p, blocks.interval
        self.layout = blocks.layout
        self.begin, self.inputs, self.ends = ends.begin, ends.inputs, ends
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
        self.p.call(self.ended, **block.places, **self.ends.outputs(block))
        self.ends.finish(block)

    def block(self, number: Scalar) -> Block:
        """A block by its number; two groups have scratch memories at the same time."""
        return self.blocks.block(number, number & (2 * GROUP - 1))

    def advance(self) -> None:
        p, interval, count = self.p, self.interval, self.blocks.count
        self.trace()
        groups = (count + (GROUP - 1)) >> 6
        if interval.repeated:
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
        i, make = self.interval, self.blocks.function
        before: tuple[Procedure, ...] = (self.begin, i.clear, i.start)
        if i.repeated:
            self.cleared = make("clear", self.begin, i.clear, inputs=self.inputs)
            before = (i.start,)
        inputs = {} if i.repeated else self.inputs
        known = dict.fromkeys(i.active, 0.0)
        # Under error control it is known before the common step which lanes it may serve, and with stops,
        # which sliders rest.
        self.started = make("start", *before, inputs=inputs)
        self.common = make("common", i.common_step, i.judge, known=known)
        if i.stops:
            self.common_held = make("common_held", i.common_step, i.press, i.judge)
            self.released = make("release", i.release)
        if i.boundaries:
            self.met = make("meet", i.meet)
        if i.plan is not Plan.FIXED:
            self.refused = make("refuse", i.refuse)
        of_blocks = list(self.blocks.functions.values())
        self.ended = make("end", self.ends.end)
        self.entered = make("enter", i.enter)
        self.stepped = make("trial_step", i.trial_step)
        self.looked = make("look", i.look)
        self.decided = make("decide", i.decide)
        of_slots = [self.entered, self.stepped, self.looked, self.decided]
        if i.stops:
            self.contact = make("look_at_contacts", i.look_at_contacts)
            self.resolved = make("resolve_contacts", i.resolve_contacts)
            of_slots += [self.contact, self.resolved]
        self.of_blocks, self.of_slots = of_blocks, of_slots

    def group(self, first: Scalar, end: Scalar) -> None:
        """Take a common step with a group of blocks; lanes that it does not serve wait for a slot."""
        p, blocks = self.p, self.blocks
        self.head.value = self.tail.value = 0
        with p.each(end, start=first) as number:
            block = self.block(number)
            inputs = {} if self.interval.repeated else self.inputs
            blocks.call_with_tables(self.started, block, inputs)
            self.common_step(block)
            valid = (p.record("<<", 1, block.lanes)) - 1
            leaving = blocks.mask(block.places, "reason") & valid
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
        p, i, places = self.p, self.interval, block.places
        if i.plan is Plan.ADAPTIVE:
            p.call(self.refused, **places)
            return
        serves = None
        if i.plan is Plan.DOUBLING:
            mask = self.blocks.mask(places, "min_steps")
            serves = mask != 255
            with p.when(mask == 255):
                p.call(self.refused, **places)
        if not i.stops:
            assert serves is not None
            with p.when(serves):
                p.call(self.common, **places)
                if i.switches:
                    with p.when(self.blocks.mask(places, "reason") != 0):
                        p.call(self.met, **places)
            return
        with p.when(serves) if serves is not None else contextlib.nullcontext():
            resting = p.variable(0)
            for name in i.active:
                resting.value = resting.value | self.blocks.mask(places, name)
            with p.when(resting.value == 0):
                p.call(self.common, **places)
            with p.when(resting.value != 0):
                p.call(self.released, **places)
                if i.logs:
                    self.tell_released(block)
                p.call(self.common_held, **places)
            with p.when(self.blocks.mask(places, "reason") != 0):
                p.call(self.met, **places)

    # ---- slots -----------------------------------------------------------------------------------------

    def trial(self) -> None:
        """Take a trial step with all slots."""
        p, i, slots, mask = self.p, self.interval, self.slots, self.blocks.mask
        with p.when(mask(slots, "entered") != 0):
            p.call(self.entered, **slots)
            if i.boundaries:
                with p.when(mask(slots, "due") != 0):
                    p.call(self.decided, **slots)
        if i.stops:
            with p.loop_while(lambda: mask(slots, "touching") != 0):
                p.call(self.contact, **slots)
                p.call(self.resolved, **slots)
                if i.logs:
                    self.tell()
        p.call(self.stepped, **slots)
        p.call(self.looked, **slots)
        if i.stops:
            with p.when(mask(slots, "held") != 0):
                p.call(self.contact, **slots)
        p.call(self.decided, **slots)

    @cached_property
    def carried_in(self) -> list[str]:
        """Fields of blocks that slots read."""
        known = {place for f in self.of_blocks for place in written_by(f)}
        read = set().union(*(self.blocks.reads[f.name] for f in self.of_slots))
        if self.interval.logs:
            read.add(self.layout.place("span_start"))  # read by the log of events, and by no function
        return [
            n
            for n in self.layout.fields
            for place in [self.layout.place(n)]
            if place in read and (place[0] == STATE or place in known)
        ]

    @cached_property
    def carried_out(self) -> list[str]:
        """Fields that slots return: states, and fields that are read at the end of the interval."""
        written = {place for f in self.of_slots for place in written_by(f)}
        read = self.blocks.reads[self.ended.name] | {self.layout.place("fault")}
        return [
            n
            for n in self.layout.fields
            for place in [self.layout.place(n)]
            if place in written and (place[0] == STATE or place in read)
        ]

    def _home(self, lane: Scalar) -> tuple[Block, Scalar]:
        return self.block(lane >> 3), lane & (LANES - 1)

    def _copy(self, names: Sequence[str], goal: Any, goal_lane: Any, source: Any, source_lane: Any) -> None:
        for name in names:
            space, row = self.layout.place(name)
            value = self.p.load(source[space], source_lane + row * LANES)
            self.p.store(goal[space], goal_lane + row * LANES, value)

    def _set(self, slot: Scalar, name: str, value: float) -> None:
        space, row = self.layout.place(name)
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
        self._copy(self.carried_in, self.slots, slot, home.places, k)
        with p.when(~self.shared):
            numbers = [n for n, f in self.layout.fields.items() if f.lifetime is PARAMETER]
            self._copy(numbers, self.slots, slot, home.places, k)
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
        self._copy(self.carried_out, home.places, k, self.slots, slot)
        self._set(slot, "phase", 0.0)
        self._set(slot, "complete", 0.0)

    # ---- the log of events -----------------------------------------------------------------------------

    def _append(
        self, block: Any, lane: Any, counts: Any, slot: Any, time: Any, kind: Any, speed: Any
    ) -> None:
        """Append an event to the log of a lane, if there is room."""
        p = self.p
        space, row = self.layout.place("logged")
        count = p.load(counts[space], slot + row * LANES)
        with p.when(count < float(MOST_LOGGED)):
            at = p.whole(count) * (3 * LANES) + lane
            for k, value in enumerate((time, kind, speed)):
                p.store(block[str(LOG)], at + k * LANES, value)
            p.store(counts[space], slot + row * LANES, count + 1.0)

    def _of(self, places: Any, lane: Any, name: str) -> Scalar:
        space, row = self.layout.place(name)
        self.p.masked.add((space, row))
        return self.p.load(places[space], lane + row * LANES)

    def tell(self) -> None:
        """Log the events of the sliders in the slots."""
        p = self.p
        with p.each_set(self.free.value ^ 255) as slot:
            lane = p.load(self.homes, slot)
            log = {str(LOG): p["log"] + (lane >> 3) * self.blocks.width(LOG)}
            for k, s in enumerate(self.interval.stops):
                happened = self._of(self.slots, slot, f"happened_{s.name}")
                with p.when(happened > 0.0):
                    time = self._of(self.slots, slot, "span_start") + self._of(self.slots, slot, "elapsed")
                    speed = self._of(self.slots, slot, f"speed_{s.name}")
                    self._append(log, lane & (LANES - 1), self.slots, slot, time, happened + 10.0 * k, speed)

    def tell_released(self, block: Block) -> None:
        """Log the sliders that were released before the common step."""
        p, places = self.p, block.places
        with p.each(LANES) as lane:
            for k, name in enumerate(self.interval.active):
                now, was = self._of(places, lane, name), self._of(places, lane, f"{name}_start")
                with p.when(now != was):
                    time = self._of(places, lane, "span_start")
                    self._append(places, lane, places, lane, time, Event.RELEASE + 10.0 * k, 0.0)


def advance(blocks: Blocks, ends: Ends) -> None:
    """Advance all lanes by a control interval."""
    if blocks.interval.local:
        Slots(blocks, ends).advance()
    else:
        blocks.advance(ends)
