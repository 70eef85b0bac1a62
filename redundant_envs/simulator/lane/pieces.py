"""Pieces of a control interval: from its start to the first instant of an effect, from there to the next, to
its end.

All lanes take them together, each with its own length; where instants of a lane fall together, or do not
happen, its last pieces have length 0. A scene without instants has :class:`Whole` intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from redundant_envs.effects.bound_hooks import INSTANT_UPDATE, Attachments
from redundant_envs.language.algebra import maximum, where
from redundant_envs.simulator.lane import jumps
from redundant_envs.simulator.lane.engine_fields import engine
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import PARAMETER, SCRATCH, Lifetime, Variable
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.numerics.error_control import Crossed

Procedure = Callable[[Lane], Any]


def renewed(attached: Attachments) -> dict[str, str]:
    """States of effects that are updated at an instant, and the fields that say whether it has passed."""
    every = ((field, own, a.passed) for a in attached for field, own in a.states.items())
    return {field: passed for field, own, passed in every if INSTANT_UPDATE in own}


class Whole:
    """An interval in one piece."""

    count = 1
    """Most pieces of an interval."""
    attempts = 1
    """Most times that it is crossed in all its pieces."""
    crossings = 1.0
    """The same of a piece, in units of the steps that one may have."""
    begins: tuple[Procedure, ...] = ()
    """What a lane does before each piece."""
    length: Lifetime = PARAMETER
    """How long the length "h" of the common step is kept."""

    def __init__(self, features: Features) -> None:
        self.features, self.dynamics = features, features.dynamics

    def fields(self) -> Iterator[Variable]:
        """Fields of the lanes."""
        return iter(())

    def clear(self, lane: Lane) -> None:
        """Before an interval: none of it is crossed."""

    def goes_on(self, lane: Lane) -> Any:
        """Whether the present piece of a lane has a length."""
        return True

    def stays(self, lane: Lane, step: Callable[[], None]) -> None:
        """Take the common step; a lane whose piece has no length stays as it is."""
        step()

    def span(self, lane: Lane) -> Any:
        """What is crossed at once, s: an interval, or the present piece of it."""
        return lane.interval

    def allowed_error(self, lane: Lane) -> Any:
        """The error that the interval may have at the end of the present piece, m."""
        return lane.tip_tolerance

    def worst(self, lane: Lane, fault: float) -> Any:
        """The fault of an interval of which the present piece has one."""
        return fault

    def least_rate(self, lane: Lane, rate: Any) -> Any:
        """Least number of steps per second, of which motion and effects ask for a ``rate``."""
        return rate

    def judged(self, lane: Lane) -> None:
        """After the common step is judged."""

    def judged_later(self, lane: Lane, crossed: Crossed) -> Any:
        """Whether the whole interval will be judged, so that a piece of it need not be."""
        return False

    def doubt(self, lane: Lane) -> None:
        """After the last piece: whether the lane has to be judged, since an error may have grown over an
        instant or it was so before."""

    def settle(self, lane: Lane) -> None:
        """Whether a lane that has to be judged has crossed the interval; otherwise it begins again."""


class Pieces(Whole):
    """An interval of a scene whose effects have instants."""

    length = SCRATCH

    def __init__(self, features: Features) -> None:
        super().__init__(features)
        self.instants = features.scene.attached.instants
        self.count, self.begins = len(self.instants) + 1, (self.begin,)

    def fields(self) -> Iterator[Variable]:
        yield from engine("piece_end")
        for name in self.dynamics.passed:
            yield Variable(name, "", "1 from the instant on, 0 before", SCRATCH)

    def clear(self, lane: Lane) -> None:
        lane.piece_end = 0.0
        for name in self.dynamics.passed:
            lane[name] = 0.0

    def goes_on(self, lane: Lane) -> Any:
        return lane.h > 0.0

    def stays(self, lane: Lane, step: Callable[[], None]) -> None:
        names = (*self.dynamics.states, "error")
        before, goes_on = lane.get(names), self.goes_on(lane)
        step()
        lane.set(names, [where(goes_on, x, y) for x, y in zip(lane.get(names), before, strict=True)])

    def span(self, lane: Lane) -> Any:
        substeps = self.dynamics.scene.substeps
        return lane.h if substeps == 1 else lane.h * float(substeps)

    def allowed_error(self, lane: Lane) -> Any:
        """Its tolerance, times the share of the interval that is crossed then."""
        return lane.tip_tolerance * (lane.piece_end / lane.interval)

    def worst(self, lane: Lane, fault: float) -> Any:
        return maximum(lane.fault, fault)

    def begin(self, lane: Lane) -> None:
        """Begin the next piece: let the instants at its start happen, and determine its length."""
        dynamics, start, interval = self.dynamics, lane.piece_end, lane.interval
        end = interval
        happens: dict[str, Any] = {}
        for a in self.instants:
            time, here = lane[a.instant], lane[a.passed] == 0.0
            happens[a.passed] = here & (time >= 0.0) & (time <= start) & (time < interval)
            end = where((time > start) & (time < end), time, end)
        x = self.features.quantities(lane)
        dynamics.guard_values(x, begins=True)  # the laws of the piece before need not hold any more
        instants = renewed(dynamics.scene.attached)
        for name, value in dynamics.changes(x, INSTANT_UPDATE, lane).items():
            lane[name] = where(happens[instants[name]], value, lane[name])
        jumps.strike(self.features, lane, happens)
        for passed, now in happens.items():
            lane[passed] = where(now, 1.0, lane[passed])
        lane.piece_end = end
        length = end - start
        self.take_over(lane, length > 0.0)
        lane.h = length if dynamics.scene.substeps == 1 else length / float(dynamics.scene.substeps)
        for name in self.features.doubts:
            lane[name] = False
        self.features.log.begin_piece(lane, start)

    def take_over(self, lane: Lane, goes_on: Any) -> None:
        """What a piece takes over from those before, where it goes on."""
