"""Attempts at an interval that instants cut into pieces, under a tolerance.

Each piece is crossed with steps of its own, and judged alone; an error made in a piece grows in those after
it. Where it may grow beyond the tolerance the interval is crossed again, with steps that are all shorter than
the shortest one before: like an interval without instants, whose steps are equal, and judged like it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import any_of, logical_not, maximum, minimum, total, where
from redundant_envs.simulator.lane import coordinates, jumps
from redundant_envs.simulator.lane.engine_fields import engine
from redundant_envs.simulator.lane.faults import Control, Fault
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import SCRATCH, Variable
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.pieces import Pieces, Whole
from redundant_envs.simulator.numerics import error_control
from redundant_envs.simulator.numerics.error_control import MAX_DOUBLINGS, Crossed

BEFORE = "{}_before"
SHORTER = 0.999
"""With steps shorter than the shortest one before, each piece of several steps has at least twice as many."""
OWN = ("error_carried", "shortest_step", "steps_taken")


def pieces_of(features: Features) -> Whole:
    """How the intervals of a scene are cut."""
    if not features.scene.attached.instants:
        return Whole(features)
    return RepeatedPieces(features) if features.control is Control.EQUAL else Pieces(features)


class RepeatedPieces(Pieces):
    """Pieces of an interval that is crossed again where an error may have grown over an instant."""

    attempts = MAX_DOUBLINGS + 2
    crossings = 2.0  # each has twice the steps of the one before

    def fields(self) -> Iterator[Variable]:
        arm = self.dynamics.arm
        yield from super().fields()
        yield from engine("attempts", "again", "longest_step", "divisions", "shortest_step", "steps_taken")
        yield from engine("error_carried", "unsure", "carries_doubt")
        for q, slides in zip(arm.coordinates, arm.prismatic, strict=True):
            unit = "m" if slides else "rad"
            yield Variable(BEFORE.format(q), unit, f"{q} after the attempt before", SCRATCH)

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

    def _note(self, lane: Lane) -> None:
        """After a piece, before the next one begins."""
        steps = lane.divisions
        crossed = (lane.piece_end > 0.0) & (lane.h > 0.0)
        length = minimum(lane.shortest_step, lane.h / steps)
        lane.shortest_step = where(crossed & (steps > 1.0), length, lane.shortest_step)
        lane.steps_taken = where(crossed, lane.steps_taken + steps, lane.steps_taken)
        doubts = [steps >= error_control.CHECKED_STEPS, *(lane[name] for name in self.features.doubts)]
        lane.unsure = lane.unsure | (crossed & any_of(doubts))

    def take_over(self, lane: Lane, goes_on: Any) -> None:
        lane.error_carried = where(goes_on, lane.error, lane.error_carried)
        lane.carries_doubt = (goes_on & lane.unsure) | (logical_not(goes_on) & lane.carries_doubt)

    def least_rate(self, lane: Lane, rate: Any) -> Any:
        return maximum(rate, 1.0 / lane.longest_step)

    def judged(self, lane: Lane) -> None:
        lane.divisions = 1.0

    def judged_later(self, lane: Lane, crossed: Crossed) -> Any:
        return (lane.attempts > 0.0) & error_control.growth_judged_later(crossed)

    def doubt(self, lane: Lane) -> None:
        self._note(lane)
        carried = (
            error_control.growth_over_pieces(lane.steps_taken, self.features.bounces.impacts(lane))
            * lane.error_carried
        )
        grows = lane.carries_doubt | (carried > lane.tip_tolerance)
        first = lane.attempts == 0.0
        lane.again = ((first & grows) | (logical_not(first) & lane.again)) & (lane.fault == 0.0)
        lane.attempts = lane.attempts + 1.0

    def settle(self, lane: Lane) -> None:
        arm, steps, unsure = self.dynamics.arm, lane.steps_taken, lane.carries_doubt
        norms = zip(coordinates.tip_norms(self.dynamics, lane), arm.coordinates, strict=True)
        change = total(n * abs(lane[q] - lane[BEFORE.format(q)]) for n, q in norms)
        impacts = self.features.bounces.impacts(lane)
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
        names = (*features.kept, *features.counted, "error", "piece_end", *self.dynamics.passed, *OWN)
        after = lane.get(names)
        lane.copy(features.kept, of=features.origin)
        lane.set(zero, [0.0] * len(zero))
        self._begin_attempt(lane)
        jumps.strike(features, lane)
        for name, value in zip(names, after, strict=True):
            lane[name] = where(lane.again, lane[name], value)
