"""The log of a lane's events: impacts at stops, rests and releases, with their times."""

from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import where
from redundant_envs.simulator.lane.fields import LOG, Variable, engine
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.stops import Impacting

MAX_LOGGED = 256
"""Number of events of an interval that are kept."""


class NoLog:
    """A lane whose events are not kept."""

    counted: tuple[str, ...] = ()  # fields with counts of an interval
    read: tuple[str, ...] = ()  # fields that the kernel reads, and no function

    def fields(self) -> Iterator[Variable]:
        return iter(())

    def fields_of_events(self) -> Iterator[Variable]:
        return iter(())

    def clear(self, lane: Lane) -> None:
        """Before an interval."""

    def begin_piece(self, lane: Lane, start: Any) -> None:
        """Before a piece of it."""

    def start(self, lane: Lane) -> None:
        """Before a common step."""

    def note(self, lane: Lane, b: Impacting, happened: Any, speed: Any) -> None:
        """After contacts are resolved: what has happened to a coordinate, at a speed."""

    def end(self, lane: Lane, given_up: Any) -> None:
        """After an interval: one that is given up has no events."""


class EventLog(NoLog):
    counted, read = ("logged",), ("span_start",)

    def __init__(self, several: bool) -> None:
        """``several``: an interval has equal common steps, before the first of which it is one too early."""
        self.several = several

    def fields(self) -> Iterator[Variable]:
        yield from engine("span_start")

    def fields_of_events(self) -> Iterator[Variable]:
        yield from engine("logged_start", "logged")
        for n in range(MAX_LOGGED):
            for name, unit in (("time", "s"), ("kind", ""), ("speed", "m/s")):
                yield Variable(f"log_{name}_{n}", unit, f"{name} of event {n}", LOG)

    def clear(self, lane: Lane) -> None:
        lane.span_start = -lane.h if self.several else 0.0

    def begin_piece(self, lane: Lane, start: Any) -> None:
        lane.span_start = start - lane.h if self.several else start

    def start(self, lane: Lane) -> None:
        if self.several:
            lane.span_start = lane.span_start + lane.h

    def note(self, lane: Lane, b: Impacting, happened: Any, speed: Any) -> None:
        lane[b.happened], lane[b.speed] = happened, speed

    def end(self, lane: Lane, given_up: Any) -> None:
        lane.logged = where(given_up, 0.0, lane.logged)
