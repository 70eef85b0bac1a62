"""What every kind of boundary of a lane can do: the kinds are in :mod:`stops`, :mod:`laws`, :mod:`stiction`.

A boundary bounds a coordinate, or it is a guard, a value that keeps its sign as long as a law holds.
"""

from __future__ import annotations

import abc
from collections.abc import Iterator
from typing import Any, ClassVar

from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events.boundary import BoundedCoordinate
from redundant_envs.simulator.events.first_event import Encounter, Event, first_event
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.fields import FieldName, Own, Owner, Variable
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.numerics.methods import Watched


class Boundary(Owner, abc.ABC):
    """A place where a motion has events."""

    first = Own("m/s^2 or N", "first acceleration at the stages, or pull of the stop")
    last = Own("m/s^2 or N", "last acceleration at the stages, or pull of the stop")
    least = Own("m/s^2 or N", "least acceleration at the stages, or pull of the stop")
    most = Own("m/s^2 or N", "most acceleration at the stages, or pull of the stop")

    def __init__(self, dynamics: Dynamics, name: str, owner: str) -> None:
        """``name`` ends the names of its fields, ``owner`` is the key of the effect that has added it."""
        self.dynamics, self.name, self.owner = dynamics, name, owner

    def watched_fields(self) -> Iterator[Variable]:
        """Fields with its values at the stages of a step, and how it is met."""
        yield from self.own("first", "last", "least", "most")

    @property
    def watches(self) -> tuple[FieldName, ...]:
        """Those that a step sets, in the order of :class:`Watched`."""
        return self.first, self.last, self.least, self.most

    def watched(self, lane: Lane) -> Watched:
        """Values at the stages of a step."""
        return Watched(*lane.get(self.watches))

    @abc.abstractmethod
    def encounter(self, lane: Lane, number: float) -> Encounter:
        """How it is met in a trial step; ``number`` is its own."""

    @abc.abstractmethod
    def first_event(self, e: Encounter, h: Any) -> Event:
        """The first event in a trial step of length ``h``."""

    def settled(self, lane: Lane, e: Encounter) -> Encounter:
        """An encounter in a step that slots have taken, which know the accelerations at its end."""
        return e

    @abc.abstractmethod
    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        """At the end of a trial step with an event, which is of this boundary where it is ``sought``; a
        coordinate is beyond the limit of a ``side``, at a ``position``."""


class Bounded(Boundary):
    """A coordinate between two limits."""

    bounces: ClassVar[bool] = False
    """Whether these are stops."""
    crossing = Own("", "how the trial step meets a limit (Crossing)")
    turning = Own("s", "when the coordinate turns in the trial step")
    cleared = Own("", "is known to turn before its limit", truth=True)

    def watched_fields(self) -> Iterator[Variable]:
        yield from super().watched_fields()
        yield from self.own("crossing", "turning")

    @abc.abstractmethod
    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        """Value and rate of the coordinate, from the fields of a form."""

    @abc.abstractmethod
    def limits(self, lane: Lane) -> tuple[Any, Any]:
        """Lower and upper limit of the coordinate."""

    @abc.abstractmethod
    def at_stage(self, x: Quantities) -> Any:
        """Its acceleration at a stage, or the pull of the stop at which it rests."""

    def starts_at_stop(self, lane: Lane) -> Any:
        """Whether it starts the common step at a stop, and does not move away from it."""
        return False

    def active_side(self, lane: Lane, form: str = "{}") -> Any:
        """Side of the stop at which the coordinate rests."""
        return 0.0

    def scale(self, lane: Lane) -> Any:
        """Size of the numbers from which it is computed, if these are larger than its own."""
        return 0.0

    def in_step(self, lane: Lane, origin: str) -> BoundedCoordinate:
        """The coordinate in a step, whose initial values are in fields of this form."""
        return BoundedCoordinate(
            *self.motion(lane), *self.motion(lane, origin), self.watched(lane), self.active_side(lane),
            *self.limits(lane), self.bounces, self.scale(lane),
        )  # fmt: skip

    def forces(self, lane: Lane) -> tuple[Any, Any, Any]:
        """Force of its stop at the end and at the start of a trial step, and the coordinate's mobility."""
        return 0.0, 0.0, 0.0

    def encounter(self, lane: Lane, number: float) -> Encounter:
        now, before, mobility = self.forces(lane)
        crossing, turning, cleared = lane.get((self.crossing, self.turning, self.cleared))
        motion = self.in_step(lane, "{}_trial")
        return Encounter(number, motion, now, before, crossing, turning, cleared, mobility)

    def first_event(self, e: Encounter, h: Any) -> Event:
        return first_event(e, h, 1.0 / h, self.dynamics.method.stages > 1)
