"""Trial steps of a lane with local steps: data of a trial step, and its outcome."""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

from redundant_envs.integrators.sliders import ROUNDING


class Phase(enum.IntEnum):
    """Next action of a lane with local steps."""

    IDLE = 0
    AT_STOP = 1
    """Its contacts are resolved."""
    RUN = 2
    """A trial step to the end of the planned step."""
    FIND_TURN = 3
    """Trial steps to the time at which a slider turns."""
    RUN_PAST_TURN = 4
    """A trial step to the end of the planned step, though a slider turns near its stop."""
    FIND_EVENT = 5
    """Trial steps towards an event."""
    COMPLETE = 6


class Trial(NamedTuple):
    """A trial step of a lane.

    Attributes
    ----------
    due : whether the lane has made it, and it is not judged yet
    phase : of the lane, a :class:`Phase`
    h : its length, s
    left : the time left of the planned step at its start, s
    good : whether it is accurate
    interval : the control interval that it belongs to, s
    """

    due: Any
    phase: Any
    h: Any
    left: Any
    good: Any
    interval: Any

    @property
    def tried(self) -> Any:
        """Whether it is an accurate step to the end of the planned one."""
        return self.due & self.good & ((self.phase == Phase.RUN) | (self.phase == Phase.RUN_PAST_TURN))

    @property
    def seeks_event(self) -> Any:
        """Whether it is a step towards an event."""
        return self.due & (self.phase == Phase.FIND_EVENT)

    @property
    def seeks_turn(self) -> Any:
        """Whether it is a step towards a turn."""
        return self.due & (self.phase == Phase.FIND_TURN)


class Bracket(NamedTuple):
    """Two times between which an event is, or a turn.

    Attributes
    ----------
    low, high : lengths of trial steps, s
    gap_low, gap_high : values at both that have different signs: of a pull, or of the speed of a turn
    """

    low: Any
    high: Any
    gap_low: Any
    gap_high: Any

    def is_narrow(self, left: Any) -> Any:
        """Whether its ends count as equal in the time left."""
        return self.high - self.low <= ROUNDING * left


class Search(NamedTuple):
    """The search for an event.

    Attributes
    ----------
    target : number of the slider
    side : of the stop; of a release, the side of it on which the last trial step ended
    low, high, gap_low, gap_high : its :class:`Bracket`
    tries : trial steps of this search
    """

    target: Any
    side: Any
    low: Any
    high: Any
    gap_low: Any
    gap_high: Any
    tries: Any

    @property
    def bracket(self) -> Bracket:
        """The bracket of the event."""
        return Bracket(self.low, self.high, self.gap_low, self.gap_high)


class Outcome(NamedTuple):
    """Outcome of a trial step.

    Attributes
    ----------
    accepted : the step has no event
    there : it ends at the sought event
    again : another trial step from the same start follows, of phase ``phase`` and length ``h``
    search : the search that continues
    positions : of the sliders, at their stops if they have reached them
    slide : the time of a Taylor step to the stop
    cleared : sliders that are known to turn before their stops
    """

    accepted: Any
    there: Any
    again: Any
    phase: Any
    h: Any
    search: Search
    positions: list[Any]
    slide: Any
    cleared: list[Any]
