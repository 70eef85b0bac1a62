"""How low a bounce ends in rest, and whether the bounces that are left out for it matter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import maximum, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.simulator.events import contacts
from redundant_envs.simulator.events.contacts import Resolved
from redundant_envs.simulator.lane.engine_fields import engine
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.fields import Variable
from redundant_envs.simulator.lane.memory import Lane


class NoStops:
    """Lanes without stops."""

    def __init__(self, control: Control) -> None:
        self.control = control

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes."""
        return iter(())

    def impacts(self, lane: Lane) -> Any:
        """Impacts of the interval."""
        return 0.0

    def impacts_since_start(self, lane: Lane) -> Any:
        """Those since the start of the common step."""
        return 0.0

    def lowest(self, lane: Lane) -> Any:
        """Height below which a bounce ends in rest, m."""
        if self.control is Control.EQUAL:
            return contacts.lowest_bounce(lane.tip_tolerance)
        return ROUNDING if self.control is Control.ADAPTIVE else contacts.LOWEST_BOUNCE

    def most_impacts(self, lane: Lane) -> Any:
        """Most impacts of an interval."""
        lowered = self.lowest(lane) < contacts.LOWEST_BOUNCE
        return where(lowered, float(contacts.MAX_WITH_LOW_BOUNCES), float(contacts.MAX_IMPACTS))

    def plan(self, lane: Lane) -> None:
        """Before the first crossing of an interval."""

    def begin(self, lane: Lane) -> None:
        """Before each crossing."""

    def note(self, lane: Lane, r: Resolved) -> None:
        """After contacts are resolved, which leaves out bounces."""

    def missed(self, lane: Lane) -> Any:
        """Whether bounces were left out that may matter."""
        return False

    def take_all(self, lane: Lane) -> None:
        """Before another crossing, with which one is compared."""


class Bounces(NoStops):
    """Bounces of lanes whose lowest height follows from the tolerance alone."""

    def impacts(self, lane: Lane) -> Any:
        return lane.impacts

    def impacts_since_start(self, lane: Lane) -> Any:
        return lane.impacts - lane.impacts_start


class ComparedBounces(Bounces):
    """Bounces of an interval that is compared with one that has all of them: with another stop, or dry
    friction, an impact may come before those that are left out would be over, and find at rest what is still
    in the air."""

    def fields(self) -> Iterator[Variable]:
        yield from engine("lowest_bounce", "bounces_end", "bounce_missed")

    def lowest(self, lane: Lane) -> Any:
        return lane.lowest_bounce

    def plan(self, lane: Lane) -> None:
        lane.lowest_bounce = contacts.lowest_bounce(lane.tip_tolerance)

    def begin(self, lane: Lane) -> None:
        lane.bounces_end, lane.bounce_missed = -1.0, False

    def note(self, lane: Lane, r: Resolved) -> None:
        happens = (r.impacts > lane.impacts) | (r.left_out > 0.0)
        missed = r.others | (happens & (lane.elapsed < lane.bounces_end))
        lane.bounce_missed = lane.bounce_missed | missed
        lane.bounces_end = maximum(lane.bounces_end, lane.elapsed + r.left_out)

    def missed(self, lane: Lane) -> Any:
        return lane.bounce_missed

    def take_all(self, lane: Lane) -> None:
        lane.lowest_bounce = ROUNDING
