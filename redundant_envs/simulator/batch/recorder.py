"""The part of the log of events (:mod:`redundant_envs.simulator.lane.event_log`) that kernels do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.flow import Scalar
from redundant_envs.simulator.batch.blocks import Block, Blocks
from redundant_envs.simulator.events.contacts import Happening
from redundant_envs.simulator.lane.event_log import MAX_LOGGED
from redundant_envs.simulator.lane.fields import LOG


class LaneBuffer(NamedTuple):
    """A block of lanes that have left their own."""

    pointers: dict[str, Scalar]  # the addresses of its memories
    homes: Scalar  # the address of the numbers of its lanes


class NoRecorder:
    """Records no event."""

    def __init__(self, blocks: Blocks) -> None:
        self.blocks, self.p, self.features = blocks, blocks.p, blocks.interval.features

    def log(self, seats: LaneBuffer, busy: Callable[[], Scalar]) -> None:
        """Log the events of the lanes in the ``busy`` seats: the bits of a whole number."""

    def log_released(self, block: Block) -> None:
        """Log the sliders that were released before the common step."""


class Recorder(NoRecorder):
    """Appends events to the logs of lanes."""

    def _append(self, log: Scalar, lane: Any, counts: Any, seat: Any, event: tuple[Any, ...]) -> None:
        """Append an event, with its time, kind and speed, to the log of a lane, if there is room."""
        p, count = self.p, self.blocks.load(counts, seat, "logged")
        with p.when(count < float(MAX_LOGGED)):
            at = p.whole(count) * (3 * self.blocks.lanes) + lane
            for k, value in enumerate(event):
                p.store(log, at + k * self.blocks.lanes, value)
            self.blocks.store(counts, seat, "logged", count + 1.0)

    def log(self, seats: LaneBuffer, busy: Callable[[], Scalar]) -> None:
        p, load, pointers = self.p, self.blocks.load, seats.pointers
        with p.each_set(busy()) as seat:
            lane = p.load(seats.homes, seat)
            log = p["log"] + self.blocks.block_of(lane) * self.blocks.width(LOG)
            for k, b in enumerate(self.features.stops):
                happened = load(pointers, seat, b.happened)
                with p.when(happened > 0.0):
                    time = load(pointers, seat, "span_start") + load(pointers, seat, "elapsed")
                    event = time, happened + 10.0 * k, load(pointers, seat, b.speed)
                    self._append(log, self.blocks.in_block(lane), pointers, seat, event)
                    self.blocks.store(pointers, seat, b.happened, 0.0)

    def log_released(self, block: Block) -> None:
        p, load, pointers = self.p, self.blocks.load, block.pointers
        with p.each(self.blocks.lanes) as lane:
            for k, b in enumerate(self.features.holding):
                names = b.active_stop, f"{b.active_stop}_start"
                now, before = (load(pointers, lane, name) for name in names)
                with p.when(now != before):
                    event = load(pointers, lane, "span_start"), Happening.RELEASE + 10.0 * k, 0.0
                    self._append(pointers[str(LOG)], lane, pointers, lane, event)
