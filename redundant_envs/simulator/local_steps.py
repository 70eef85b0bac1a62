"""Local time stepping: steps of individual length for lanes that the common step does not serve."""

from __future__ import annotations

from typing import Any

from redundant_envs.algebra import any_of, cases, logical_not, where
from redundant_envs.integrators import step_control
from redundant_envs.integrators.event_search import after_trial
from redundant_envs.integrators.event_times import Encounter
from redundant_envs.integrators.sliders import law_behind, leaves_stop, side_touched, starts_at_stop
from redundant_envs.integrators.trial_steps import Outcome, Phase, Search, Trial
from redundant_envs.simulator.common_step import CommonStep
from redundant_envs.simulator.lane import Lane
from redundant_envs.simulator.setting import (
    MOST_SEARCHED,
    MOST_TRIALS,
    SEARCH,
    TRIALS_OF_SUBSTEP,
    Fault,
    Plan,
    Reason,
)
from redundant_envs.simulator.step import active_stop, tip_norms


class LocalSteps(CommonStep):
    """Procedures of lanes that leave the common step."""

    def enter(self, lane: Lane) -> None:
        """Lanes that have just left the common step: its result saves trying it again."""
        new = lane.entered
        plan = self._first_plan(lane)
        fresh: Any = False
        phase: Any = Phase.RUN
        if self.boundaries:
            begun = any_of(self.begun_at(lane, starts_at_stop))
            rested = any_of(a != 0.0 for a in lane.get(self.active, of="{}_start"))
            fresh = logical_not(plan.void | begun | rested)
            touched = self._touched_before(lane)
            phase = where(fresh, Phase.RUN, where(touched, Phase.AT_STOP, Phase.RUN))
        values = {
            **{s: where(fresh, lane[s], lane[f"{s}_start"]) for s in self.dynamics.states},
            **{f"{s}_trial": lane[f"{s}_start"] for s in self.dynamics.states},
            "error": where(fresh, lane.error, lane.error_start),
            "error_trial": lane.error_start, "elapsed": 0.0, "left": plan.left,
            "step": where(fresh, lane.h, plan.left),
        }  # fmt: skip
        if self.plan is Plan.DOUBLING:
            values |= {"divisions": plan.steps, "steps_left": plan.steps}
            values |= {f"{q}_seen": step_control.NEVER_SEEN for q in self.dynamics.arm.coordinates}
        elif self.plan is Plan.ADAPTIVE:
            values |= {"next_step": plan.following, "steps_left": 0.0}
        if self.boundaries:
            values |= dict.fromkeys(("searched", "tries", "slide"), 0.0)
        for b in self.boundaries:
            lane[f"cleared_{b.name}"] = logical_not(new) & lane[f"cleared_{b.name}"]
        if self.stops:
            values |= {"changes": 0.0} | {a: lane[f"{a}_start"] for a in self.active}
            for s, leaves in zip(self.stops, self.begun_at(lane, leaves_stop), strict=True):
                lane[f"released_{s.name}"] = where(new, leaves, lane[f"released_{s.name}"])
        if self.logs:
            values["logged"] = lane.logged_start
        for name, value in values.items():
            lane[name] = where(new, value, lane[name])
        lane.due = where(new, fresh, lane.due)
        self._set_phase(lane, where(new, phase, lane.phase))
        lane.entered = False

    def _first_plan(self, lane: Lane) -> step_control.Plan:
        if self.plan is Plan.FIXED:
            return step_control.Plan(lane.h, False)
        if self.plan is Plan.ADAPTIVE:
            return step_control.first_adaptive(lane.next_step, lane.min_steps, lane.interval)
        failed = lane.reason == Reason.ACCURACY
        return step_control.first_doubling(
            failed, lane.error, lane.min_steps, lane.tip_tolerance, lane.interval
        )

    def trial_step(self, lane: Lane) -> None:
        """A trial step of the lanes that move."""
        self._set_step(lane, lane.step, self._moving(lane))

    @staticmethod
    def _moving(lane: Lane) -> Any:
        return (lane.phase >= Phase.RUN) & (lane.phase <= Phase.FIND_EVENT)

    def look(self, lane: Lane) -> None:
        """After a trial step: count it, and determine how it meets the stops."""
        moved = self._moving(lane)
        if self.boundaries:
            self._set_crossings(lane, self.sliders(lane, "{}_trial", lane.step), lane.step)
        if self.stops:
            lane.held = any_of(a != 0.0 for a in lane.get(self.active))
        lane.due = moved
        lane.evaluations = lane.evaluations + where(moved, float(self.dynamics.method.stages), 0.0)

    def decide(self, lane: Lane) -> None:
        """After a trial step: decide on the lane's next action."""
        dynamics, due, phase = self.dynamics, lane.due, lane.phase
        doubling = self.plan is Plan.DOUBLING
        verdict = self._verdict(lane)
        trial = Trial(due, phase, lane.step, lane.left, verdict.good, lane.interval)
        outcome = self._outcome(lane, trial)
        again, there, accepted = outcome.again, outcome.there, outcome.accepted
        passed = self._passed(lane, there)
        tried = (phase == Phase.RUN) | (phase == Phase.RUN_PAST_TURN)
        failed = due & tried & logical_not(verdict.good)
        span = lane.step + outcome.slide if self.boundaries else lane.step
        left_after = lane.left - span
        ended = accepted & logical_not(left_after > 0.0)
        lost = self._lost(lane)
        elapsed = lane.elapsed + span
        ending = self._ending(lane, ended, accepted, elapsed, verdict)
        # After an inaccurate one of equal steps the interval is repeated; otherwise the step is.
        if doubling:
            failed, ended = failed | ending.unsure, ended & logical_not(ending.unsure)
            accepted = accepted & logical_not(ending.unsure)
        back = failed | lost if doubling else lost
        retry: Any = False if doubling else failed
        moved = accepted | there
        done = ended & ending.last
        continuing = accepted & logical_not(done)
        left = cases((failed, verdict.left), (ended, ending.left), (moved, left_after), default=lane.left)
        touches: Any = False
        touched_before: Any = False
        if self.stops:
            # A held slider has just shown that it stays; a free one at its stop must be examined.
            sliders = self.sliders(lane, "{}_trial", lane.step)[: len(self.stops)]
            at = [s.position for s in sliders]
            if self.switches:
                at = [where(passed, x, p) for x, p in zip(outcome.positions, at, strict=False)]
            touches = any_of(
                s.free & (side_touched(x, s.active_stop, s.lower, s.upper) != 0.0)
                for s, x in zip(sliders, at, strict=True)
            )
            touched_before = self._touched_before(lane)
        goes = (continuing | passed) & logical_not(touches)
        here = dict(zip(self.positions, outcome.positions, strict=False))
        for q, v in zip(dynamics.arm.coordinates, dynamics.arm.rates, strict=True):
            if self.boundaries and q not in here:
                here[q] = lane[q] + outcome.slide * lane[v]
        new = {}
        for s in dynamics.states:
            start, trial_start, present = lane[f"{s}_start"], lane[f"{s}_trial"], lane[s]
            new[f"{s}_trial"] = cases((goes, present), (back, start), default=trial_start)
            new[s] = cases((back, start), (again | retry, trial_start), default=here.get(s, present))
        error, error_start, error_trial = lane.error, lane.error_start, lane.error_trial
        new |= {
            "error": cases((back, error_start), (again | retry, error_trial), default=error),
            "error_trial": cases((goes, error), (back, error_start), default=error_trial),
            "elapsed": cases((back, 0.0), (moved, elapsed), default=lane.elapsed),
            "left": left,
            "step": cases((again, outcome.h), (goes | failed, left), default=lane.step),
        }
        if doubling:
            new |= {
                "min_steps": ending.min_steps,
                "divisions": where(back, verdict.steps, lane.divisions),
                "steps_left": cases(
                    (back, verdict.steps), (ended, ending.steps_left), default=lane.steps_left
                ),
            }
            for q in dynamics.arm.coordinates:
                new[f"{q}_seen"] = where(ending.unsure & ending.last, lane[q], lane[f"{q}_seen"])
        elif self.plan is Plan.ADAPTIVE:
            new["steps_left"] = lane.steps_left + where(due, 1.0, 0.0)
            new["next_step"] = where(accepted | failed, verdict.following, lane.next_step)
        if self.plan is not Plan.FIXED:
            fault = Fault.TOLERANCE_NOT_REACHED
            if self.plan is Plan.ADAPTIVE:
                fault |= Fault.NO_STEP_FOUND
            new["fault"] = where(done & ending.flagged, fault, lane.fault)
        next_phase = cases(
            (logical_not(due), phase),
            (done, Phase.COMPLETE),
            (lost, Phase.COMPLETE),
            (again, outcome.phase),
            (there & logical_not(passed), Phase.AT_STOP),
            (continuing | passed, where(touches, Phase.AT_STOP, Phase.RUN)),
            (back, where(touched_before, Phase.AT_STOP, Phase.RUN)),
            (retry, Phase.RUN),
            default=phase,
        )
        if self.boundaries:
            new |= self._after_search(lane, outcome, goes, back, lost, new)
            new |= self._laws(lane, outcome, there, back)
        for name, value in new.items():
            lane[name] = value
        lane.due = False
        self._set_phase(lane, next_phase)

    def _passed(self, lane: Lane, there: Any) -> Any:
        """Whether a trial step ends where a force changes its law: the lane goes on without contacts."""
        if not self.switches:
            return False
        return there & (lane.target >= float(len(self.stops)))

    def _laws(self, lane: Lane, outcome: Outcome, there: Any, back: Any) -> dict[str, Any]:
        """The laws that hold after a trial step. By rounding, another joint may have passed its limit,
        too."""
        new, joints = {}, self.sliders(lane, "{}_trial", lane.step)[len(self.stops) :]
        for k, (s, joint) in enumerate(zip(self.switches, joints, strict=True)):
            sought = lane.target == float(len(self.stops) + k)
            crossed = where(sought, lane.side, joint.side_beyond)
            changes = there & (crossed != 0.0)
            side = where(changes, law_behind(lane[s.side], crossed), lane[s.side])
            new[s.side] = where(back, lane[f"{s.side}_start"], side)
        return new

    def _verdict(self, lane: Lane) -> step_control.Verdict:
        if self.plan is Plan.FIXED:
            return step_control.Verdict(True, lane.left)
        if self.plan is Plan.ADAPTIVE:
            return step_control.judge_adaptive(
                lane.error, lane.step, lane.next_step, lane.min_steps, lane.interval, lane.steps_left
            )
        return step_control.judge_doubling(lane.error, lane.tip_tolerance, lane.divisions, lane.interval)

    def _outcome(self, lane: Lane, trial: Trial) -> Outcome:
        search = Search(*lane.get(SEARCH)) if self.boundaries else None
        if search is None:
            nothing = trial.due & trial.good
            return Outcome(nothing, False, False, None, None, None, [], 0.0, [])  # type: ignore[arg-type]
        rates = self.rates
        encounters = [
            Encounter(
                *lane.get(
                    ("force", "force_trial", "crossing", "turning", "cleared", f"mobility_{v}"),
                    of=f"{{}}_{s.name}",
                )
            )
            for s, v in zip(self.stops, rates, strict=True)
        ]
        for s in self.switches:
            crossing, turning, cleared = lane.get(("crossing", "turning", "cleared"), of=f"{{}}_{s.name}")
            encounters.append(Encounter(0.0, 0.0, crossing, turning, cleared, 0.0))
        sliders = self.sliders(lane, "{}_trial", lane.step)
        smooth = self.dynamics.method.stages > 1
        return after_trial(trial, search, sliders, encounters, self.unseen, smooth)

    def _lost(self, lane: Lane) -> Any:
        """End every search: after too many trial steps, and when a time is NaN."""
        if not self.boundaries:
            return False
        rest = lane.left - lane.step
        found = (lane.searched < MOST_SEARCHED) & (rest == rest)
        stages = float(self.dynamics.method.stages)
        if self.plan is Plan.DOUBLING:
            found = found & (lane.evaluations < MOST_TRIALS * stages)
        elif self.plan is Plan.FIXED:
            # If such steps make a slider unstable, every step can seem to end beyond a stop.
            most = MOST_TRIALS * lane.h + TRIALS_OF_SUBSTEP * lane.interval
            found = found & (lane.evaluations * lane.h < stages * most)
        else:
            found = found & (lane.steps_left < step_control.MOST_ADAPTIVE_STEPS + MOST_TRIALS)
        return lane.due & logical_not(found)

    def _ending(
        self, lane: Lane, ended: Any, accepted: Any, elapsed: Any, verdict: step_control.Verdict
    ) -> step_control.Ending:
        if self.plan is Plan.FIXED:
            return step_control.Ending(True, lane.left, False)
        if self.plan is Plan.ADAPTIVE:
            return step_control.end_adaptive(lane.interval, elapsed, verdict.following)
        terms = [
            n * abs(lane[q] - lane[f"{q}_seen"])
            for n, q in zip(tip_norms(self.dynamics, lane), self.dynamics.arm.coordinates, strict=True)
        ]
        crossed = step_control.Crossed(
            ended, accepted, lane.steps_left, lane.divisions, self.least_steps(lane),
            sum(terms[1:], terms[0]), lane.impacts if self.stops else 0.0,
            self.doubtful(lane), self.kinked(lane), self.hidden_kink(lane),
        )  # fmt: skip
        return step_control.end_doubling(
            crossed, lane.error, lane.tip_tolerance, lane.min_steps, lane.interval
        )

    def _after_search(
        self, lane: Lane, outcome: Outcome, goes: Any, back: Any, lost: Any, new: dict[str, Any]
    ) -> dict[str, Any]:
        """Fields of searches, contacts and events that a trial step changes."""
        again, due = outcome.again, lane.due
        values = {
            name: where(again, value, lane[name]) for name, value in zip(SEARCH, outcome.search, strict=True)
        }
        values |= {
            "searched": cases((again, lane.searched + 1.0), (due, 0.0), default=lane.searched),
            "fault": where(lost, Fault.EVENT_BUDGET, new.get("fault", lane.fault)),
            "slide": where(due, outcome.slide, lane.slide),
        }
        for b, cleared in zip(self.boundaries, outcome.cleared, strict=True):
            values[f"cleared_{b.name}"] = where(again, cleared, logical_not(due) & lane[f"cleared_{b.name}"])
        if not self.stops:
            return values
        values |= {
            "changes": where(back, 0.0, lane.changes),
            "impacts": where(back, lane.impacts_start, lane.impacts),
            **{a: where(back, lane[f"{a}_start"], lane[a]) for a in self.active},
        }
        if self.logs:
            values["logged"] = where(back, lane.logged_start, lane.logged)
        for k, (s, q, v) in enumerate(zip(self.stops, self.positions, self.rates, strict=True)):
            # The slider of this event comes to its stop, even if by rounding it seems to move away.
            comes = outcome.there & (lane.target == float(k))
            leaves = leaves_stop(new[q], new[v], values[active_stop(s.name)], lane[s.lower], lane[s.upper])
            released = lane[f"released_{s.name}"]
            values[f"released_{s.name}"] = where(due, leaves & logical_not(comes), released)
            force, trial_force = lane[f"force_{s.name}"], lane[f"force_trial_{s.name}"]
            values[f"force_trial_{s.name}"] = where(goes, force, trial_force)
        return values
