"""The step that all lanes take together, and the reasons for which a lane leaves it."""

from __future__ import annotations

from functools import reduce
from typing import Any

from redundant_envs.algebra import any_of, cases, logical_not, maximum, where
from redundant_envs.integrators import crossings, step_control
from redundant_envs.integrators.methods import Step
from redundant_envs.integrators.sliders import side_beyond
from redundant_envs.simulator import stiffness
from redundant_envs.simulator.at_stops import AtStops
from redundant_envs.simulator.kinks import levels_of
from redundant_envs.simulator.lane import Lane
from redundant_envs.simulator.setting import WATCHED, Plan, Reason
from redundant_envs.simulator.step import (
    integrated_states,
    joint_quantities,
    lane_step,
    others_error,
    pose_tells_distances,
    step_error,
    tip_norms,
    watched_sliders,
)


class CommonStep(AtStops):
    """Procedures of the common step."""

    def clear(self, lane: Lane) -> None:
        """Before an interval."""
        lane.error = 0.0
        if not self.local:
            return
        lane.evaluations = lane.fault = 0.0
        for name in self.doubts:
            lane[name] = False
        if self.stops:
            lane.impacts = 0.0
        if self.logs:
            lane.logged = 0.0
            lane.span_start = -lane.h if self.plan is Plan.FIXED else 0.0
        if self.origin != "{}_start":
            lane.set(self.kept, lane.get(self.kept), of=self.origin)

    def start(self, lane: Lane) -> None:
        """Before a common step: keep the state, and determine which lanes the step may serve."""
        lane.set(self.kept, lane.get(self.kept), of="{}_start")
        lane.error_start = lane.error
        if self.stops:
            lane.impacts_start = lane.impacts
        for s in self.switches:
            position = joint_quantities(self.dynamics, lane, "{}")[f"phi{s.joint + 1}"]
            lane[s.side] = lane[f"{s.side}_start"] = side_beyond(position, lane[s.lower], lane[s.upper])
        if self.plan is not Plan.FIXED:
            steps = self.least_steps(lane)
            lane.min_steps = where(steps <= 1.0, 0.0, steps)
        if self.logs:
            lane.logged_start = lane.logged
            if self.plan is Plan.FIXED:
                lane.span_start = lane.span_start + lane.h

    def least_steps(self, lane: Lane) -> Any:
        """Number of steps that the present rates and all springs and dampers require."""
        arm = self.dynamics.arm
        turning = [abs(lane[v]) for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
        rates = [lane.steady] if "steady" in self.dynamics.prepared else []
        rates += stiffness.rates_of_motion(self.dynamics, lane, joint_quantities(self.dynamics, lane, "{}"))
        steady = reduce(maximum, rates) if rates else 0.0
        fastest = reduce(maximum, turning) if turning else 0.0
        return step_control.least_steps(fastest, steady, lane.interval)

    def common_step(self, lane: Lane) -> None:
        """The step of all lanes."""
        self._set_step(lane, lane.h, None)

    def _set_step(self, lane: Lane, h: Any, moving: Any) -> None:
        """The fields of a step; the state of lanes that are not ``moving`` stays."""
        dynamics = self.dynamics
        step = lane_step(dynamics, lane, h, held=bool(self.stops))
        if self.estimates:
            error = step_error(dynamics, lane, step)
            # The error of an adaptive step decides on that step, all others are summed up.
            lane.error = error if self.plan is Plan.ADAPTIVE else lane.error + error
        if self.doubts:
            self._doubt(lane, step, h, moving)
        new = [*step.positions, *step.velocities, *step.others]
        if moving is not None:
            new = [where(moving, x, lane[s]) for s, x in zip(dynamics.states, new, strict=True)]
        lane.set(dynamics.states, new)
        for boundary, watched in zip(self.boundaries, step.watched, strict=False):
            lane.set(WATCHED, watched, of=f"{{}}_{boundary.name}")

    def _doubt(self, lane: Lane, step: Step, h: Any, moving: Any) -> None:
        """Record whether the error of a step may exceed its estimate."""
        dynamics, sliders = self.dynamics, watched_sliders(self.dynamics)
        levels = levels_of(dynamics.kinks)
        watched = step.watched[len(self.boundaries) :]
        kinks = [crossings.meets_kink(*kink, self.unseen) for kink in zip(watched, levels, strict=False)]
        hidden = [unseen for _, unseen in kinks]
        crossed = [seen for seen, _ in kinks] + hidden
        doubts = []
        if integrated_states(dynamics):
            limit = step_control.DOUBTFUL * lane.tip_tolerance
            doubts.append(others_error(dynamics, lane, step, h) > limit)
        if sliders:
            ways = [h * maximum(w.most, -w.least) for w in watched[len(levels) :]]
            far = sum(ways[1:], ways[0])
            doubts += [far > step_control.FAR * distance for distance in self._distances(lane, "{}")]
        if moving is not None and pose_tells_distances(dynamics):
            doubts += self._farther(lane, "{}", "{}_start")
        for name, found in (("kinked", crossed), ("hidden_kink", hidden), ("doubtful", doubts)):
            if found:
                seen = any_of(found) if moving is None else any_of(found) & moving
                lane[name] = lane[name] | seen

    def _distances(self, lane: Lane, form: str) -> list[Any]:
        """Distance of the tip from each joint that turns, m, from the fields of a form."""
        joints = zip(tip_norms(self.dynamics, lane, form), self.dynamics.arm.prismatic, strict=True)
        return [norm for norm, slides in joints if not slides]

    def _farther(self, lane: Lane, before: str, after: str) -> list[Any]:
        """For each joint that turns, whether the tip is now many times as far from it as before."""
        distances = zip(self._distances(lane, before), self._distances(lane, after), strict=True)
        return [new > step_control.FARTHER * old for old, new in distances]

    def judge(self, lane: Lane) -> None:
        """After a common step: the reason why a lane leaves it, if it does.

        For a lane that the step could not serve, its result is never used.
        """
        reason: Any = Reason.NONE
        if self.boundaries:
            sliders = self.sliders(lane, "{}_start", lane.h)
            pulled = any_of(crossings.most_pull(s, self.unseen) > 0.0 for s in sliders)
            near = any_of(crossings.may_meet(s, lane.h, self.unseen) for s in sliders)
            reason = cases((pulled, Reason.STOP), (near, Reason.NEAR_STOP), default=Reason.NONE)
        stages = float(self.dynamics.method.stages)
        if self.plan is Plan.FIXED:
            lane.evaluations = lane.evaluations + stages
        elif self.plan is Plan.DOUBLING:
            # A link that has become fast during the step may have been too fast for it.
            slow = self.least_steps(lane) <= step_control.TOO_FAST
            single = lane.min_steps == 0.0
            served = single & slow & (lane.error <= lane.tip_tolerance)
            for name in self.doubts:
                lane[name] = lane[name] & single
            served = served & logical_not(self.kinked(lane) | self.doubtful(lane))
            reason = where(served, reason, Reason.ACCURACY)
            lane.evaluations = where(single, lane.evaluations + stages, lane.evaluations)
            lane.error = where(single, lane.error, 0.0)
        self._leave(lane, reason)

    def kinked(self, lane: Lane) -> Any:
        """Whether a step of an interval may have met a kink, which error estimates do not capture well."""
        return lane.kinked if "kinked" in self.doubts else False

    def hidden_kink(self, lane: Lane) -> Any:
        """Whether it may have met a kink between its stages."""
        return lane.hidden_kink if "hidden_kink" in self.doubts else False

    def doubtful(self, lane: Lane) -> Any:
        """Whether the error of an interval may exceed its estimate, though the motion is smooth.

        Either a step has found so, or the tip is now so far from a joint that an error of its angle, made
        when the tip was near, weighs more.
        """
        if "doubtful" not in self.doubts:
            return False
        if not pose_tells_distances(self.dynamics):
            return lane.doubtful
        return lane.doubtful | any_of(self._farther(lane, "{}_start", "{}"))

    def refuse(self, lane: Lane) -> None:
        """Skip the common step: no lane is served by it."""
        if self.plan is Plan.DOUBLING:
            lane.error = 0.0
        self._leave(lane, Reason.ACCURACY)

    def _leave(self, lane: Lane, reason: Any) -> None:
        # Local steps do not help lanes whose state or effort is not finite.
        names = [f"{s}_start" for s in self.dynamics.states[: 2 * self.dynamics.count]]
        defect = self.defect(lane.get((*names, *self.dynamics.commands)))
        lane.reason = where(defect == 0.0, reason, Reason.NONE)
        # Poison every state: some were never advanced, and others hold results that depend on neighbours.
        for s in self.dynamics.states:
            lane[s] = where(defect == 0.0, lane[s], defect)

    @staticmethod
    def defect(values: list[Any]) -> Any:
        """0 if some numbers are finite, else NaN."""
        return reduce(lambda total, x: total + (x - x), values[1:], values[0] - values[0])
