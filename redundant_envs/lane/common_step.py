"""A step of a lane and its error; the step that all lanes take together, and why a lane leaves it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from redundant_envs.algebra import any_of, cases, logical_not, maximum, sqrt, total, where
from redundant_envs.events import crossings
from redundant_envs.events.boundary import Boundary
from redundant_envs.lane import attempts, coordinates, jumps, pieces, required_steps
from redundant_envs.lane.boundaries import Boundaries
from redundant_envs.lane.closed_forms import InStep, StepStart
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import WATCHED, Control, Reason
from redundant_envs.lane.kinks import kink_values, levels_of
from redundant_envs.lane.memory import Lane
from redundant_envs.numerics import error_control
from redundant_envs.numerics.methods import Numbers, Step, Watched, explicit_step
from redundant_envs.quantities import Quantities
from redundant_envs.tracing.passes.stages import Subroutine

MOST_INLINED = 4
"""Stages of a step up to which each has its own copy of the right-hand side."""
SMALLEST_STATE = 1e-300
"""Smallest number by which an error is divided."""


def lane_step(dynamics: Dynamics, lane: Lane, h: Any) -> Step:
    """A step of length ``h``.

    It watches, in this order: the coordinates of boundaries, values that change their signs at kinks, and
    speeds of :attr:`Dynamics.watched_sliders`.
    """
    numbers = coordinates.known_numbers(dynamics, lane)
    start = _start_of_closed_forms(dynamics, lane, numbers)
    count, width = dynamics.count, len(dynamics.states) - len(dynamics.closed)
    states, alone = dynamics.states[:width], dynamics.autonomous
    # What is known before the accelerations of the stage before are comes first.
    early = (*states[:count], *alone, *(("elapsed",) if start else ()))
    late = tuple(name for name in states[count:] if name not in alone)
    arguments = (*early, *late, *numbers, *start)

    def derivatives(*values: Any) -> list[Any]:
        known = dict(zip(arguments, values, strict=True))
        x = coordinates.contact_quantities(
            dynamics, [known[name] for name in states], {n: known[n] for n in numbers}
        )
        results = dynamics.accelerations(
            x, InStep(known, known["elapsed"], dynamics.varying) if start else None
        )
        others = zip(states[count:], results, strict=False)
        results = [change for name, change in others if name not in alone] + results[width - count :]
        results += [watched_acceleration(dynamics, b, x) for b in dynamics.bounded]
        pulls = dynamics.pulls(x)
        results += [pulls[b.name] for b in dynamics.guards]
        results += kink_values(dynamics.scene.attached, dynamics.kinks, x)
        return [*results, *(known[states[count + k]] for k in sliders)]

    kinks, sliders = levels_of(dynamics.kinks), dynamics.watched_sliders
    more = len(dynamics.boundaries) + len(kinks) + len(sliders)
    right_hand_side: Any = derivatives
    if dynamics.method.stages > MOST_INLINED:
        asides = [k for k, name in enumerate(late) if name == "work"]
        right_hand_side = Subroutine(derivatives, len(early), len(late) + more, arguments, asides)

    def changes(q: Numbers, v: Numbers, z: Numbers, node: float) -> Numbers:
        known = {**numbers, **start, **dict(zip(states, (*q, *v, *z), strict=True))}
        if start:
            known["elapsed"] = node * h
        results = right_hand_side(*(known[name] for name in arguments))
        found = dict(zip(late, results, strict=False)) | dynamics.autonomous_changes(known)
        return [*(found[name] for name in states[count:]), *results[len(late) :]]

    values = lane.get(states)
    step = explicit_step(
        dynamics.method, changes, values[:count], values[count : 2 * count], values[2 * count :], h
    )
    if start:
        x = coordinates.contact_quantities(
            dynamics, [*step.positions, *step.velocities, *step.others], numbers
        )
        dynamics.close(x, InStep(start, h, dynamics.varying))
        step.others.extend(x.each(dynamics.closed))
    return step


def _start_of_closed_forms(dynamics: Dynamics, lane: Lane, numbers: dict[str, Any]) -> dict[str, Any]:
    """States in closed form, and what else their forms take, at the start of a step."""
    found = dict(zip(dynamics.closed, lane.get(dynamics.closed), strict=True))
    at_start = StepStart(dynamics.varying)
    dynamics.close(coordinates.contact_quantities(dynamics, lane.get(dynamics.states), numbers), at_start)
    return found | at_start.found


def watched_acceleration(dynamics: Dynamics, b: Boundary, x: Quantities) -> Any:
    """Acceleration of the coordinate of a boundary; for a slider that rests, the pull of its stop."""
    if b.joint is None:
        return coordinates.acceleration(dynamics, b, x)
    if b in dynamics.stops and dynamics.sticking and b not in dynamics.angular:
        return x[f"qdd{b.number}"]
    if b in dynamics.holding:
        return where(x[f"held{b.number}"] > 0.0, coordinates.pull(x, b, x[b.active]), x[f"qdd{b.number}"])
    return dynamics.along(b, x.each(f"qdd{k + 1}" for k in range(dynamics.count)))


def step_error(dynamics: Dynamics, lane: Lane, step: Step) -> Any:
    """The error of a step: in metres at the tip, or for dop853 in units of its tolerance."""
    if dynamics.scene.integrator == "dop853":
        names = tuple(name for name in dynamics.states if name != "work")
        after = [*step.positions, *step.velocities, *step.others]
        strikes = bool(dynamics.stops)
        states = zip(lane.get(names), after, strict=False)
        scales = [error_control.rounding_scale(a, b, strikes) for a, b in states]

        def size(errors: Sequence[Any], h: Any) -> Any:
            squares = ((e * s) ** 2 for e, s in zip(errors, scales, strict=False))
            return h * sqrt(total(squares) * (1.0 / len(names)))

        return error_control.blended_error(*(size(*error) for error in step.errors[1:]))
    weights = tip_weights(dynamics, lane)

    def tip_size(errors: Sequence[Any], h: Any) -> Any:
        n = dynamics.count
        parts = zip(weights, errors[:n], errors[n : 2 * n], strict=True)
        return h * total(w * (abs(q) + lane.interval * abs(v)) for w, q, v in parts)

    return error_control.tip_error(*(tip_size(*error) for error in step.errors), sharpness=dynamics.sharpness)


def others_error(dynamics: Dynamics, lane: Lane, step: Step, h: Any) -> Any:
    """Estimated tip error from errors of effects' states, m. No other estimate contains an error that does
    not act yet. Each error is related to the size of its state, now or at the end of the interval at the pace
    of the step; the same share of the tip's motion by the step's change of velocity is the estimate."""
    gained = gained_speed(dynamics, lane, lane.get(dynamics.arm.rates), step.velocities)
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated):
        sizes = [abs(error[2 * dynamics.count + k]) * factor for error, factor in step.errors]
        size = size_of_state(lane[name], step.others[k], lane.interval, h)
        shares.append(error_control.tip_error(*sizes, sharpness=dynamics.sharpness) / size)
    return lane.interval * gained * total(shares)


def gained_speed(dynamics: Dynamics, lane: Lane, before: Sequence[Any], after: Sequence[Any]) -> Any:
    """Change of the tip's speed between two sets of rates, m/s: the sum of what each joint contributes."""
    rates = zip(coordinates.tip_norms(dynamics, lane), after, before, strict=True)
    return total(norm * abs(after - before) for norm, after, before in rates)


def size_of_state(before: Any, after: Any, interval: Any, h: Any) -> Any:
    """Size of an effect's state to which an error in a step of ``h`` is related."""
    pace = abs(after - before) * (interval / h)
    return maximum(maximum(abs(before), pace), SMALLEST_STATE)


def departure(dynamics: Dynamics, lane: Lane) -> Any:
    """Speed at which the end of the interval departs from the motion, m/s at the tip, as long as the law goes
    on to hold whose guard has passed 0, or is sought: by what the laws differ in the present state."""
    states, numbers = lane.get(dynamics.states), coordinates.known_numbers(dynamics, lane)
    others = dict(numbers)
    for k, b in enumerate(dynamics.guards, start=len(dynamics.bounded)):
        if not b.sticks:
            passed = (lane[b.pull] > 0.0) | (lane.target == float(k))
            others[b.side] = where(passed, -lane[b.side], lane[b.side])
    slopes = (
        dynamics.accelerations(coordinates.contact_quantities(dynamics, states, known))
        for known in (numbers, others)
    )
    apart = [abs(one - other) for one, other in zip(*slopes, strict=True)]
    speed = total(w * a for w, a in zip(tip_weights(dynamics, lane), apart, strict=False))
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated):
        size = size_of_state(lane[f"{name}_trial"], lane[name], lane.interval, lane.step)
        shares.append(apart[dynamics.count + k] / size)
    if shares:
        rates = (lane.get(dynamics.arm.rates, of=form) for form in ("{}_trial", "{}"))
        speed = speed + gained_speed(dynamics, lane, *rates) * total(shares)
    return lane.interval * speed


def tip_weights(dynamics: Dynamics, lane: Lane) -> list[Any]:
    """Metres at the tip per unit of the error of each coordinate."""
    norms, arm = coordinates.tip_norms(dynamics, lane), dynamics.arm
    if dynamics.scene.tolerance is None:
        return norms
    lengths = lane.get(f"l{k + 1}" for k in range(arm.num_lengths))
    reach = total(lengths or [0.0])  # an arm of sliders alone has none
    return [
        n if slides else error_control.tip_weight(n, reach, lane.tip_tolerance)
        for n, slides in zip(norms, arm.prismatic, strict=True)
    ]


class CommonStep:
    """Procedures of a step, and of the one that all lanes take together."""

    def __init__(self, dynamics: Dynamics, boundaries: Boundaries) -> None:
        self.dynamics, self.boundaries = dynamics, boundaries

    def clear(self, lane: Lane) -> None:
        """Before an interval; impulses act then."""
        lane.error = 0.0
        if self.dynamics.instants:
            pieces.clear(self.dynamics, lane)
        if self.dynamics.attempts > 1:
            attempts.clear(lane)
        if self.dynamics.local:
            self._clear_counts(lane)
        elif self.dynamics.instants:
            lane.evaluations = 0.0
        jumps.strike(self.dynamics, lane)

    def _clear_counts(self, lane: Lane) -> None:
        lane.evaluations = lane.fault = 0.0
        for name in self.dynamics.doubts:
            lane[name] = False
        for name in self.dynamics.counted:
            lane[name] = 0.0
        if self.dynamics.logs:
            lane.span_start = 0.0 if self.dynamics.controlled else -lane.h
        if self.dynamics.origin != "{}_start":
            lane.copy(self.dynamics.kept, to=self.dynamics.origin)

    def next_piece(self, lane: Lane) -> None:
        """Before the common steps of a piece of the interval."""
        pieces.begin(self.dynamics, lane, coordinates.known_numbers(self.dynamics, lane))

    def start(self, lane: Lane) -> None:
        """Before a common step: keep the state, and determine which lanes the step may serve."""
        lane.copy(self.dynamics.kept, to="{}_start")
        lane.error_start = lane.error
        lane.copy(self.dynamics.counted, to="{}_start")
        self.boundaries.guards.begin_laws(lane)
        if self.dynamics.controlled:
            steps = self.least_steps(lane)
            lane.min_steps = where(steps <= 1.0, 0.0, steps)
        elif self.dynamics.logs:
            lane.span_start = lane.span_start + lane.h

    def least_steps(self, lane: Lane) -> Any:
        """Number of steps of an interval, or a piece, before any estimate is used: half a radian of the
        fastest link in each, and as many as springs and dampers require, which no estimate sees before they
        are touched."""
        arm, crossed = self.dynamics.arm, pieces.span(self.dynamics, lane)
        turning = [abs(lane[v]) for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
        rates = [lane.least_step_rate] if "least_step_rate" in self.dynamics.prepared else []
        here = coordinates.quantities_of_arm(self.dynamics, lane)
        numbers = coordinates.numbers_of(self.dynamics, lane)
        rates += required_steps.rates_of_motion(self.dynamics.scene, lane, here, numbers, crossed)
        fastest, most = (reduce(maximum, found or [0.0]) for found in (turning, rates))
        if self.dynamics.attempts > 1:
            most = maximum(most, 1.0 / lane.longest_step)
        return crossed * maximum(2.0 * fastest, most)

    def common_step(self, lane: Lane) -> None:
        """The step of all lanes; one whose piece has no length stays as it is."""
        if not self.dynamics.instants:
            self._set_step(lane, lane.h, None)
            return self.boundaries.guards.record_pulls(lane)
        names = (*self.dynamics.states, "error")
        before, goes_on = lane.get(names), pieces.goes_on(lane)
        self._set_step(lane, lane.h, None)
        lane.set(names, [where(goes_on, x, y) for x, y in zip(lane.get(names), before, strict=True)])
        self.boundaries.guards.record_pulls(lane)
        if not self.dynamics.local:
            self._count(lane, goes_on)
        return None

    def _count(self, lane: Lane, taken: Any) -> None:
        """Count the evaluations of the common step where it is taken."""
        stages = float(self.dynamics.method.stages)
        lane.evaluations = where(taken, lane.evaluations + stages, lane.evaluations)

    def trial_step(self, lane: Lane) -> None:
        """A trial step of the lanes that ask for one."""
        self._set_step(lane, lane.step, lane.moving)

    def record_step(self, lane: Lane) -> None:
        """After a trial step: count it, and determine how it meets the boundaries."""
        self.boundaries.record_crossings(lane, "{}_trial", lane.step)
        self.boundaries.guards.record_pulls(lane)
        if self.dynamics.weighs_laws:
            lane.departure = departure(self.dynamics, lane)
        lane.due = lane.moving
        stages = float(self.dynamics.method.stages)
        lane.evaluations = lane.evaluations + where(lane.moving, stages, 0.0)

    def _set_step(self, lane: Lane, h: Any, moving: Any) -> None:
        """The fields of a step; the state of lanes that are not ``moving`` stays."""
        dynamics = self.dynamics
        step = lane_step(dynamics, lane, h)
        if dynamics.method.error5:
            error = step_error(dynamics, lane, step)
            # The error of an adaptive step decides on that step, all others are summed up.
            lane.error = error if self.dynamics.control is Control.ADAPTIVE else lane.error + error
        if self.dynamics.doubts:
            self._doubt(lane, step, h, moving)
        new = [*step.positions, *step.velocities, *step.others]
        before, now = (dict(zip(dynamics.states, x, strict=True)) for x in (lane.get(dynamics.states), new))
        self.boundaries.guards.keep_sticking(lane, before, now)
        new = list(now.values())
        if moving is not None:
            new = [where(moving, x, lane[s]) for s, x in zip(dynamics.states, new, strict=True)]
        lane.set(dynamics.states, new)
        for b, watched in zip(self.dynamics.boundaries, step.watched, strict=False):
            names = Watched._fields if b.guards else WATCHED
            lane.set(names, watched[: len(names)], of=f"{{}}_{b.name}")

    def _doubt(self, lane: Lane, step: Step, h: Any, moving: Any) -> None:
        """Record whether the error of a step may exceed its estimate."""
        dynamics, levels = self.dynamics, levels_of(self.dynamics.kinks)
        watched = step.watched[len(dynamics.boundaries) :]
        kinks = zip(watched, levels, strict=False)
        met = [crossings.meets_kink(*kink, dynamics.overshoot) for kink in kinks]
        hidden = [unseen for _, unseen in met]
        crossed = [seen for seen, _ in met] + hidden
        doubts = []
        if dynamics.effect_states.integrated:
            limit = error_control.DOUBTFUL * lane.tip_tolerance
            doubts.append(others_error(dynamics, lane, step, h) > limit)
        if dynamics.watched_sliders:
            far = total(h * maximum(w.most, -w.least) for w in watched[len(levels) :])
            doubts += [far > error_control.FAR * distance for distance in self._distances(lane, "{}")]
        if moving is not None and dynamics.pose_tells_distances:
            doubts += self._farther(lane, "{}", "{}_start")
        for name, found in (("kinked", crossed), ("hidden_kink", hidden), ("doubtful", doubts)):
            if found:
                seen = any_of(found) if moving is None else any_of(found) & moving
                lane[name] = lane[name] | seen

    def _distances(self, lane: Lane, form: str) -> list[Any]:
        """Distance of the tip from each joint that turns, m, from the fields of a form."""
        joints = zip(
            coordinates.tip_norms(self.dynamics, lane, form), self.dynamics.arm.prismatic, strict=True
        )
        return [norm for norm, slides in joints if not slides]

    def _farther(self, lane: Lane, before: str, after: str) -> list[Any]:
        """For each joint that turns, whether the tip is now many times as far from it as before."""
        distances = zip(self._distances(lane, before), self._distances(lane, after), strict=True)
        return [new > error_control.FARTHER * old for old, new in distances]

    def judge(self, lane: Lane) -> None:
        """After a common step: why a lane leaves it, if it does. Then the result of the step is not used."""
        moved, overshoot = self.boundaries.in_step(lane, "{}_start"), self.dynamics.overshoot
        pulled = any_of(crossings.most_pull(s, overshoot) > 0.0 for s in moved)
        near = any_of(crossings.may_meet(s, lane.h, overshoot) for s in moved)
        reason: Any = cases((pulled, Reason.EVENT), (near, Reason.NEAR_BOUNDARY), default=Reason.NONE)
        passes = [
            (lane[b.pull] > 0.0) | crossings.may_pass(self.boundaries.watched(lane, b), overshoot)
            for b in self.dynamics.guards
        ]
        reason = where(any_of(passes), Reason.EVENT, reason)
        goes_on = pieces.goes_on(lane) if self.dynamics.instants else True
        if not self.dynamics.controlled:
            self._count(lane, goes_on)
        elif self.dynamics.control is Control.EQUAL:
            # A link that has become fast during the step may have been too fast for it.
            slow = self.least_steps(lane) <= error_control.TOO_FAST
            single = lane.min_steps == 0.0
            served = single & slow & (lane.error <= pieces.allowed_error(self.dynamics, lane))
            for name in self.dynamics.doubts:
                lane[name] = lane[name] & single
            doubtful, kinked, _ = self.doubts(lane)
            served = served & logical_not(kinked | doubtful)
            reason = where(served, reason, Reason.ACCURACY)
            self._count(lane, single & goes_on)
            lane.error = where(single, lane.error, 0.0)
            if self.dynamics.attempts > 1:
                lane.divisions = 1.0
        self._leave(lane, reason)

    def doubts(self, lane: Lane) -> tuple[Any, ...]:
        """Whether the error of an interval may exceed its estimate: near a kink, which estimates do not
        capture well, or though the motion is smooth.

        For the latter either a step has found so, or the tip is now so far from a joint that an error of its
        angle, made when the tip was near, weighs more.
        """
        names = ("doubtful", "kinked", "hidden_kink")
        doubtful, *kinks = (lane[name] if name in self.dynamics.doubts else False for name in names)
        if self.dynamics.pose_tells_distances:
            doubtful = doubtful | any_of(self._farther(lane, "{}_start", "{}"))
        return doubtful, *kinks

    def skip_common_step(self, lane: Lane) -> None:
        """Skip the common step: no lane is served by it."""
        if self.dynamics.control is Control.EQUAL:
            lane.error = 0.0
        self._leave(lane, Reason.ACCURACY)

    def _leave(self, lane: Lane, reason: Any) -> None:
        # Local steps do not help lanes whose state or effort is not finite.
        motion = lane.get(self.dynamics.states[: 2 * self.dynamics.count], of="{}_start")
        defect = self.defect([*motion, *lane.get(self.dynamics.commands)])
        leaves = defect == 0.0
        if self.dynamics.instants:
            leaves = leaves & pieces.goes_on(lane)
        lane.reason = where(leaves, reason, Reason.NONE)
        # Poison every state: some were never advanced, and others hold results that depend on neighbours.
        for s in self.dynamics.states:
            lane[s] = where(defect == 0.0, lane[s], defect)

    @staticmethod
    def defect(values: list[Any]) -> Any:
        """0 if some numbers are finite, else NaN."""
        return reduce(lambda total, x: total + (x - x), values[1:], values[0] - values[0])
