"""Pieces of a control interval: from its start to the first instant of an effect, from there to the next, to
its end.

All lanes take them together, each with its own length; where instants of a lane fall together, or do not
happen, its last pieces have length 0. A scene without instants has :class:`Whole` intervals.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

from redundant_envs.effects.bound_hooks import INSTANT_UPDATE, Attachments
from redundant_envs.language.algebra import any_of, logical_not, maximum, minimum, total, where
from redundant_envs.simulator.lane import jumps
from redundant_envs.simulator.lane.dynamics import tip_distance
from redundant_envs.simulator.lane.faults import Control, Fault
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import PARAMETER, SCRATCH, Variable, copies, engine, variables
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.numerics import error_control
from redundant_envs.simulator.numerics.error_control import MAX_DOUBLINGS, Crossed

Procedure = Callable[[Lane], Any]
BEFORE = "{}_before"
SHORTER = 0.999
"""With steps shorter than the shortest one before, each piece of several steps has at least twice as many."""


def renewed(attached: Attachments) -> dict[str, str]:
    """States of effects that are updated at an instant, and the fields that say whether it has passed."""
    return {
        field: a.passed
        for a in attached
        for field, functions in a.states.items()
        if INSTANT_UPDATE in functions
    }


class Whole:
    """An interval in one piece."""

    count = 1  # most pieces of an interval
    attempts = 1  # most times that it is crossed in all its pieces
    crossings = 1.0  # the same of a piece, in units of the steps that one may have
    begins: tuple[Procedure, ...] = ()  # what a lane does before each piece
    length = PARAMETER  # how long the length "h" of the common step is kept

    def __init__(self, features: Features) -> None:
        self.features, self.dynamics = features, features.dynamics

    def fields(self) -> Iterator[Variable]:
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

    def note(self, lane: Lane, fault: Fault) -> None:
        """Record a fault; the worst one of an interval counts."""
        lane.fault = float(fault)

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
        yield from variables(self.dynamics.passed, "1 from the instant on, 0 before")

    def clear(self, lane: Lane) -> None:
        lane.piece_end = 0.0
        lane.set(self.dynamics.passed, [0.0] * len(self.dynamics.passed))

    def goes_on(self, lane: Lane) -> Any:
        return lane.h > 0.0

    def stays(self, lane: Lane, step: Callable[[], None]) -> None:
        names = (*self.dynamics.states, "error")
        before, goes_on = lane.get(names), self.goes_on(lane)
        step()
        lane.set(names, [where(goes_on, x, y) for x, y in zip(lane.get(names), before, strict=True)])

    def span(self, lane: Lane) -> Any:
        return lane.h if self.dynamics.scene.substeps == 1 else lane.h * float(self.dynamics.scene.substeps)

    def allowed_error(self, lane: Lane) -> Any:
        """Its tolerance, times the share of the interval that is crossed then."""
        return lane.tip_tolerance * (lane.piece_end / lane.interval)

    def note(self, lane: Lane, fault: Fault) -> None:
        lane.fault = maximum(lane.fault, float(fault))

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
        lane.set(self.features.doubts, [False] * len(self.features.doubts))
        self.features.log.begin_piece(lane, start)

    def take_over(self, lane: Lane, goes_on: Any) -> None:
        """What a piece takes over from those before, where it goes on."""


class RepeatedPieces(Pieces):
    """Pieces under a tolerance, each crossed with steps of its own, and judged alone. Where an error may grow
    beyond the tolerance in later pieces the interval is crossed again, with steps all shorter than the
    shortest one before, and judged like one without instants, whose steps are equal."""

    attempts = MAX_DOUBLINGS + 2
    crossings = 2.0  # each has twice the steps of the one before

    def fields(self) -> Iterator[Variable]:
        yield from super().fields()
        yield from engine("attempts", "again", "longest_step", "divisions", "shortest_step", "steps_taken")
        yield from engine("error_carried", "unsure", "carries_doubt")
        yield from copies(self.dynamics.arm.coordinates, BEFORE, "after the attempt before")

    def clear(self, lane: Lane) -> None:
        super().clear(lane)
        lane.attempts, lane.longest_step = 0.0, math.inf
        self._begin_attempt(lane)

    @staticmethod
    def _begin_attempt(lane: Lane) -> None:
        lane.piece_end = lane.error = lane.error_carried = lane.steps_taken = 0.0
        lane.divisions, lane.shortest_step = 1.0, math.inf
        lane.unsure = lane.carries_doubt = False

    def begin(self, lane: Lane) -> None:
        self._note(lane)
        super().begin(lane)

    def take_over(self, lane: Lane, goes_on: Any) -> None:
        lane.error_carried = where(goes_on, lane.error, lane.error_carried)
        lane.carries_doubt = (goes_on & lane.unsure) | (logical_not(goes_on) & lane.carries_doubt)

    def _note(self, lane: Lane) -> None:
        """After a piece, before the next one begins."""
        steps = lane.divisions
        crossed = (lane.piece_end > 0.0) & (lane.h > 0.0)
        length = minimum(lane.shortest_step, lane.h / steps)
        lane.shortest_step = where(crossed & (steps > 1.0), length, lane.shortest_step)
        lane.steps_taken = where(crossed, lane.steps_taken + steps, lane.steps_taken)
        doubts = [steps >= error_control.CHECKED_STEPS, *(lane[name] for name in self.features.doubts)]
        lane.unsure = lane.unsure | (crossed & any_of(doubts))

    def least_rate(self, lane: Lane, rate: Any) -> Any:
        return maximum(rate, 1.0 / lane.longest_step)

    def judged(self, lane: Lane) -> None:
        lane.divisions = 1.0

    def judged_later(self, lane: Lane, crossed: Crossed) -> Any:
        asked = (crossed.impacts >= error_control.CHECKED_IMPACTS) | crossed.doubtful | crossed.kinked
        return (lane.attempts > 0.0) & logical_not(asked)

    def doubt(self, lane: Lane) -> None:
        self._note(lane)
        impacts = self.features.bounces.impacts(lane)
        carried = error_control.growth_over_pieces(lane.steps_taken, impacts) * lane.error_carried
        grows = lane.carries_doubt | (carried > lane.tip_tolerance)
        first = lane.attempts == 0.0
        lane.again = ((first & grows) | (logical_not(first) & lane.again)) & (lane.fault == 0.0)
        lane.attempts = lane.attempts + 1.0

    def settle(self, lane: Lane) -> None:
        arm, steps, unsure = self.dynamics.arm, lane.steps_taken, lane.carries_doubt
        change, impacts = tip_distance(self.dynamics, lane, BEFORE), self.features.bounces.impacts(lane)
        kinked = unsure if self.features.kinks else False
        crossed = Crossed(steps, lane.error, lane.tip_tolerance, change, impacts, unsure, kinked)
        agrees = error_control.growth_allowed(crossed) | error_control.confirmed(crossed)
        lost = total(lane[v] - lane[v] for v in (*arm.coordinates, *arm.rates)) != 0.0  # no finite state
        doubtful = lane.again & ((lane.attempts == 1.0) | logical_not(agrees)) & logical_not(lost)
        last = steps >= error_control.most_steps(impacts)
        lane.fault = where(doubtful & last, float(Fault.TOLERANCE_NOT_REACHED), lane.fault)
        lane.again = doubtful & logical_not(last)
        several = lane.shortest_step < math.inf
        shorter = where(several, SHORTER * lane.shortest_step, 0.5 * lane.interval / maximum(steps, 1.0))
        lane.longest_step = where(lane.again, shorter, lane.longest_step)
        lane.copy(arm.coordinates, to=BEFORE)
        self._return_to_start(lane)

    def _return_to_start(self, lane: Lane) -> None:
        """Where the interval has to be crossed again: the lane as it was before its first piece."""
        features, zero = self.features, (*self.features.counted, *self.dynamics.passed)
        of_pieces = "error", "piece_end", "error_carried", "shortest_step", "steps_taken"
        names = (*features.saved, *zero, *of_pieces, *features.watch.closest)
        after = lane.get(names)
        lane.copy(features.saved, of=features.origin)
        lane.set(zero, [0.0] * len(zero))
        self._begin_attempt(lane)
        features.watch.clear(lane)
        jumps.strike(features, lane)
        for name, value in zip(names, after, strict=True):
            lane[name] = where(lane.again, lane[name], value)


def pieces_of(features: Features) -> Whole:
    """How the intervals of a scene are cut."""
    if not features.scene.attached.instants:
        return Whole(features)
    return RepeatedPieces(features) if features.control is Control.EQUAL else Pieces(features)
