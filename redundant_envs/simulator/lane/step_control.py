"""Which trial steps a lane plans, and when its interval is crossed: a class for each :class:`Control`."""

import enum
from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import logical_not, maximum
from redundant_envs.simulator.lane.common_step import CommonStep
from redundant_envs.simulator.lane.dynamics import tip_distance
from redundant_envs.simulator.lane.faults import Control, Fault, Reason
from redundant_envs.simulator.lane.fields import Variable, copies, engine
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.numerics import error_control
from redundant_envs.simulator.numerics.error_control import Crossed, Judgement

MAX_TRIALS = 65536
"""Most trial steps of an interval that is crossed with 1, 2, 4, ... 16384 steps: twice as many as without
events; of an interval in pieces as many for each. With fixed steps the same, and :data:`TRIALS_OF_SUBSTEP`
more for each substep."""
TRIALS_OF_SUBSTEP = 16
SEEN = "{}_seen"


class End(enum.Enum):
    """What comes after a trial step without an event."""

    GOES_ON = "goes on"  # the rest of the planned step, which an event had cut short, or the next one
    REPEATED = "repeated"  # the interval is crossed again with more steps
    CROSSED = "crossed"  # the interval is crossed


class StepControl:
    """How the steps of a lane are chosen; here each common step is one step."""

    repeats = False  # whether an inaccurate step begins the interval anew; otherwise the step is repeated

    def __init__(self, step: CommonStep) -> None:
        self.step, self.features, self.pieces = step, step.features, step.pieces
        self.dynamics = step.dynamics
        self.stages = float(step.dynamics.method.stages)
        self.most_trials = MAX_TRIALS * self.pieces.count

    def fields(self) -> Iterator[Variable]:
        """Fields of the plan, beside the length of the present step."""
        return iter(())

    def begin(self, lane: Lane) -> Any:
        """Plan the first step of an interval; whether the common step is useless for the lane."""
        lane.left = lane.h
        return False

    def accurate(self, lane: Lane) -> Any:
        """Whether a trial step, and with equal steps the interval so far, is accurate enough."""
        return True

    def shorten(self, lane: Lane) -> None:
        """Plan a shorter step after an inaccurate one, which a fixed step never is."""

    def end(self, lane: Lane) -> End:
        """After a trial step without an event, whose time is spent: what comes next."""
        return End.GOES_ON if lane.left > 0.0 else End.CROSSED

    def within_budget(self, lane: Lane) -> Any:
        """Whether the interval may have one more trial step."""
        # If such steps make a slider unstable, every step can seem to end beyond a stop.
        most = self.most_trials * lane.h + TRIALS_OF_SUBSTEP * self.pieces.count * self.pieces.span(lane)
        return lane.evaluations * lane.h < self.stages * most


class EqualSteps(StepControl):
    """1, 2, 4, ... 16384 equal steps, until the sum of their errors passes the tolerance."""

    repeats = True

    def fields(self) -> Iterator[Variable]:
        yield from engine("divisions", "steps_left")
        yield from copies(self.dynamics.arm.coordinates, SEEN, "after the crossing before")

    def begin(self, lane: Lane) -> Any:
        inaccurate = lane.reason == Reason.ACCURACY
        for_error = error_control.steps_for_error(inaccurate, lane.error, self.pieces.allowed_error(lane))
        steps = maximum(for_error, error_control.steps_allowed(lane.min_steps))
        lane.divisions = lane.steps_left = steps
        for q in self.dynamics.arm.coordinates:
            lane[SEEN.format(q)] = error_control.NEVER_SEEN
        self.features.bounces.plan(lane)
        lane.left = self.pieces.span(lane) / steps
        return inaccurate

    def accurate(self, lane: Lane) -> Any:
        return (lane.error <= self.pieces.allowed_error(lane)) | (lane.divisions >= error_control.MAX_STEPS)

    def shorten(self, lane: Lane) -> None:
        steps = 2.0 * lane.divisions
        lane.left = lane.step = self.pieces.span(lane) / steps
        lane.divisions = lane.steps_left = steps

    def end(self, lane: Lane) -> End:
        ended, last = logical_not(lane.left > 0.0), logical_not(lane.steps_left - 1.0 > 0.0)
        lane.min_steps = maximum(lane.min_steps, self.step.least_steps(lane))
        crossed = self._crossed(lane)
        agrees = error_control.growth_allowed(crossed) | error_control.confirmed(crossed)
        agrees = agrees | self.pieces.judged_later(lane, crossed)
        most = error_control.most_steps(crossed.impacts)
        too_fast = lane.min_steps > error_control.TOO_FAST * lane.divisions
        if (lane.divisions < most) & (too_fast | (ended & last & logical_not(agrees))):
            if last:
                lane.copy(self.dynamics.arm.coordinates, to=SEEN)
                self.features.bounces.plan(lane, every=True)
            return End.REPEATED
        if not ended:
            return End.GOES_ON
        if not last:
            lane.left, lane.steps_left = self.pieces.span(lane) / lane.divisions, lane.steps_left - 1.0
            return End.GOES_ON
        accurate = lane.error <= self.pieces.allowed_error(lane)
        if not (accurate & (lane.min_steps <= error_control.MAX_STEPS) & agrees):
            self.pieces.note(lane, Fault.TOLERANCE_NOT_REACHED)
        return End.CROSSED

    def _crossed(self, lane: Lane) -> Crossed:
        change, impacts = tip_distance(self.dynamics, lane, SEEN), self.features.bounces.impacts(lane)
        known = lane.divisions, lane.error, self.pieces.allowed_error(lane), change, impacts
        doubtful, *kinks = self.step.doubts(lane)
        return Crossed(*known, doubtful | self.features.bounces.missed(lane), *kinks)

    def within_budget(self, lane: Lane) -> Any:
        return lane.evaluations < self.pieces.crossings * self.most_trials * self.stages


class AdaptiveSteps(StepControl):
    """Each step is as long as its error allows (dop853)."""

    def fields(self) -> Iterator[Variable]:
        return engine("steps_left")

    def begin(self, lane: Lane) -> Any:
        first = error_control.first_adaptive(lane.next_step, lane.min_steps, self.pieces.span(lane))
        lane.next_step, lane.steps_left, lane.left = first, 0.0, first
        return True

    def _verdict(self, lane: Lane) -> Judgement:
        planned = lane.error, lane.step, lane.next_step, lane.min_steps
        return error_control.judge_adaptive(*planned, self.pieces.span(lane), lane.steps_left - 1.0)

    def accurate(self, lane: Lane) -> Any:
        return self._verdict(lane).accepted

    def shorten(self, lane: Lane) -> None:
        verdict = self._verdict(lane)
        lane.next_step, lane.left = verdict.following, verdict.shorter

    def end(self, lane: Lane) -> End:
        lane.next_step = self._verdict(lane).following
        if lane.left > 0.0:
            return End.GOES_ON
        rest = self.pieces.span(lane) - lane.elapsed
        if not lane.next_step > 0.0:
            self.pieces.note(lane, Fault.TOLERANCE_NOT_REACHED | Fault.NO_STEP_FOUND)
            return End.CROSSED
        if not rest > error_control.CROSSED_SHARE * self.pieces.span(lane):
            return End.CROSSED
        lane.left = error_control.rest_of_interval(rest, lane.next_step)
        return End.GOES_ON

    def within_budget(self, lane: Lane) -> Any:
        taken = lane.steps_left
        lane.steps_left = taken + 1.0
        return taken < error_control.MAX_ADAPTIVE_STEPS + MAX_TRIALS


CLASSES = {Control.FIXED: StepControl, Control.EQUAL: EqualSteps, Control.ADAPTIVE: AdaptiveSteps}
