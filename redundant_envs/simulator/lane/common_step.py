"""A step of a lane and its error; the step that all lanes take together, and why a lane leaves it."""

from collections.abc import Sequence
from functools import reduce
from typing import Any

from redundant_envs.compiler.tracing.passes.stages import Subroutine
from redundant_envs.language.algebra import any_of, cases, logical_not, maximum, sqrt, total, where
from redundant_envs.simulator.events import crossings
from redundant_envs.simulator.lane import jumps
from redundant_envs.simulator.lane.boundaries import Boundaries
from redundant_envs.simulator.lane.closed_forms import closing, noting
from redundant_envs.simulator.lane.dynamics import numbers_of, quantities_of_arm, tip_norms
from redundant_envs.simulator.lane.faults import Control, Reason
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.kinks import kink_values, levels_of
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.parameters import rates_of_motion
from redundant_envs.simulator.numerics import error_control
from redundant_envs.simulator.numerics.methods import Numbers, Step, explicit_step

MAX_INLINED = 4
"""Stages of a step up to which each has its own copy of the right-hand side."""
SMALLEST_STATE = 1e-300
"""Smallest number by which an error is divided."""


def lane_step(features: Features, lane: Lane, h: Any) -> Step:
    """A step of length ``h``, which watches, in this order, the coordinates of boundaries, values that change
    their signs at kinks, and speeds of :attr:`Features.watched_sliders`."""
    dynamics, numbers = features.dynamics, features.known_numbers(lane)
    start = lane.values(dynamics.closed)  # with what else closed forms take at the start of the step
    x = features.quantities_in_step(lane.get(dynamics.states), numbers)
    dynamics.close(x, noting(dynamics.varying, start))
    count, width = dynamics.count, len(dynamics.states) - len(dynamics.closed)
    states, alone = dynamics.states[:width], dynamics.autonomous
    # What is known before the accelerations of the stage before are comes first.
    early = (*states[:count], *alone, *(("elapsed",) if start else ()))
    late = tuple(name for name in states[count:] if name not in alone)
    arguments = (*early, *late, *numbers, *start)

    def derivatives(*values: Any) -> list[Any]:
        known = dict(zip(arguments, values, strict=True))
        x = features.quantities_in_step([known[name] for name in states], {n: known[n] for n in numbers})
        close = closing(known, known["elapsed"], dynamics.varying) if start else None
        results = dynamics.accelerations(x, close)
        others = zip(states[count:], results, strict=False)
        results = [change for name, change in others if name not in alone] + results[width - count :]
        results += [b.at_stage(x) for b in features.bounded]
        pulls = features.pulls(x)
        results += [pulls[b.name] for b in features.guards]
        results += kink_values(features.scene.attached, features.kinks, x)
        return [*results, *(known[states[count + k]] for k in sliders)]

    kinks, sliders = levels_of(features.kinks), features.watched_sliders
    more = len(features.boundaries) + len(kinks) + len(sliders)
    right_hand_side: Any = derivatives
    if dynamics.method.stages > MAX_INLINED:
        asides = [k for k, name in enumerate(late) if name == "work"]
        right_hand_side = Subroutine(derivatives, len(early), len(late) + more, arguments, asides)

    def changes(state: Numbers, node: float) -> Numbers:
        known = {**numbers, **start, **dict(zip(states, state, strict=True))}
        if start:
            known["elapsed"] = node * h
        results = right_hand_side(*(known[name] for name in arguments))
        slopes = dict(zip(late, results, strict=False)) | dynamics.autonomous_changes(known)
        return [*(slopes[name] for name in states[count:]), *results[len(late) :]]

    step = explicit_step(dynamics.method, changes, lane.get(states), count, h)
    if start:
        x = features.quantities_in_step(step.state, numbers)
        dynamics.close(x, closing(start, h, dynamics.varying))
        step.state.extend(x.each(dynamics.closed))
    return step


def step_error(features: Features, lane: Lane, step: Step) -> Any:
    """The error of a step: in metres at the tip, or for dop853 in units of its tolerance."""
    if features.control is Control.ADAPTIVE:
        names = tuple(name for name in features.dynamics.states if name != "work")
        strikes, states = bool(features.stops), zip(lane.get(names), step.state, strict=False)
        scales = [error_control.rounding_scale(a, b, strikes) for a, b in states]

        def size(errors: Sequence[Any], h: Any) -> Any:
            squares = ((e * s) ** 2 for e, s in zip(errors, scales, strict=False))
            return h * sqrt(total(squares) * (1.0 / len(names)))

        return error_control.blended_error(*(size(*error) for error in step.errors[1:]))
    weights = tip_weights(features, lane)

    def tip_size(errors: Sequence[Any], h: Any) -> Any:
        n = features.dynamics.count
        parts = zip(weights, errors[:n], errors[n : 2 * n], strict=True)
        return h * total(w * (abs(q) + lane.interval * abs(v)) for w, q, v in parts)

    return error_control.tip_error(*(tip_size(*error) for error in step.errors), sharpness=features.sharpness)


def others_error(features: Features, lane: Lane, step: Step, h: Any) -> Any:
    """Estimated tip error from errors of effects' states, m. No other estimate contains an error that does
    not act yet. Each error is related to the size of its state, now or at the end of the interval at the pace
    of the step; the same share of the tip's motion by the step's change of velocity is the estimate."""
    dynamics, n = features.dynamics, features.dynamics.count
    gained = gained_speed(features, lane, lane.get(dynamics.arm.rates), step.state[n : 2 * n])
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated, start=2 * n):
        sizes = [abs(error[k]) * factor for error, factor in step.errors]
        size = size_of_state(lane[name], step.state[k], lane.interval, h)
        shares.append(error_control.tip_error(*sizes, sharpness=features.sharpness) / size)
    return lane.interval * gained * total(shares)


def gained_speed(features: Features, lane: Lane, before: Sequence[Any], after: Sequence[Any]) -> Any:
    """Change of the tip's speed between two sets of rates, m/s: the sum of what each joint contributes."""
    rates = zip(tip_norms(features.dynamics, lane), after, before, strict=True)
    return total(norm * abs(after - before) for norm, after, before in rates)


def size_of_state(before: Any, after: Any, interval: Any, h: Any) -> Any:
    """Size of an effect's state to which an error in a step of ``h`` is related."""
    return maximum(maximum(abs(before), abs(after - before) * (interval / h)), SMALLEST_STATE)


def departure(features: Features, lane: Lane) -> Any:
    """Speed at which the end of the interval departs from the motion, m/s at the tip, as long as the law goes
    on to hold whose guard has passed 0, or is sought: by what the laws differ in the present state."""
    dynamics = features.dynamics
    states, numbers = lane.get(dynamics.states), features.known_numbers(lane)
    others = dict(numbers)
    for k, b in enumerate(features.guards, start=len(features.bounded)):
        others |= b.other_law(lane, (lane[b.pull] > 0.0) | (lane.target == float(k)))
    laws = (features.quantities_in_step(states, known) for known in (numbers, others))
    apart = [abs(one - other) for one, other in zip(*map(dynamics.accelerations, laws), strict=True)]
    speed = total(w * a for w, a in zip(tip_weights(features, lane), apart, strict=False))
    shares = []
    for k, name in enumerate(dynamics.effect_states.integrated):
        size = size_of_state(lane[f"{name}_trial"], lane[name], lane.interval, lane.step)
        shares.append(apart[dynamics.count + k] / size)
    if shares:
        rates = (lane.get(dynamics.arm.rates, of=form) for form in ("{}_trial", "{}"))
        speed = speed + gained_speed(features, lane, *rates) * total(shares)
    return lane.interval * speed


def tip_weights(features: Features, lane: Lane) -> list[Any]:
    """Metres at the tip per unit of the error of each coordinate."""
    norms, arm = tip_norms(features.dynamics, lane), features.arm
    if features.scene.tolerance is None:
        return norms
    lengths = lane.get(f"l{k + 1}" for k in range(arm.num_lengths))
    reach = total(lengths or [0.0])  # an arm of sliders alone has none
    pairs, weight = zip(norms, arm.prismatic, strict=True), error_control.tip_weight
    return [n if slides else weight(n, reach, lane.tip_tolerance) for n, slides in pairs]


class CommonStep:
    """Procedures of a step, and of the one that all lanes take together."""

    def __init__(self, boundaries: Boundaries) -> None:
        self.boundaries, self.features, self.pieces = boundaries, boundaries.features, boundaries.pieces
        self.dynamics = self.features.dynamics

    def clear(self, lane: Lane) -> None:
        """Before an interval; impulses act then."""
        features = self.features
        lane.error = 0.0
        self.features.watch.clear(lane)
        self.pieces.clear(lane)
        if features.counts_evaluations:
            lane.evaluations = 0.0
        if features.local:
            lane.fault = 0.0
            lane.set(features.doubts, [False] * len(features.doubts))
            lane.set(features.counted, [0.0] * len(features.counted))
            features.log.clear(lane)
            if features.origin != "{}_start":
                lane.copy(features.saved, to=features.origin)
        jumps.strike(features, lane)

    def start(self, lane: Lane) -> None:
        """Before a common step: keep the state, and determine which lanes the step may serve."""
        lane.copy(self.features.saved, to="{}_start")
        lane.error_start = lane.error
        lane.copy((*self.features.counted, *self.features.watch.closest), to="{}_start")
        self.boundaries.begin_laws(lane)
        if self.dynamics.controlled:
            steps = self.least_steps(lane)
            lane.min_steps = where(steps <= 1.0, 0.0, steps)
        self.features.log.start(lane)

    def least_steps(self, lane: Lane) -> Any:
        """Number of steps of an interval, or a piece, before any estimate is used: half a radian of the
        fastest link in each, and as many as springs and dampers need, which estimates see once touched."""
        arm, crossed = self.dynamics.arm, self.pieces.span(lane)
        turning = [abs(lane[v]) for v, slides in zip(arm.rates, arm.prismatic, strict=True) if not slides]
        rates = [lane.least_step_rate] if "least_step_rate" in self.dynamics.parameters.prepared else []
        here = quantities_of_arm(self.dynamics, lane)
        rates += rates_of_motion(self.dynamics.scene, lane, here, numbers_of(self.dynamics, lane), crossed)
        fastest, most = (reduce(maximum, values or [0.0]) for values in (turning, rates))
        return crossed * maximum(2.0 * fastest, self.pieces.least_rate(lane, most))

    def common_step(self, lane: Lane) -> None:
        """The step of all lanes; one whose piece has no length stays as it is."""
        self.pieces.stays(lane, lambda: self._set_step(lane, lane.h, None))
        self.features.watch.take(lane)
        self.boundaries.record_pulls(lane)
        if self.features.counts_evaluations and not self.features.local:
            self._count(lane, self.pieces.goes_on(lane))

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
        self.boundaries.record_pulls(lane)
        if self.dynamics.bounds_late_switch:
            lane.departure = departure(self.features, lane)
        lane.due = lane.moving
        lane.evaluations = lane.evaluations + where(lane.moving, float(self.dynamics.method.stages), 0.0)

    def _set_step(self, lane: Lane, h: Any, moving: Any) -> None:
        """The fields of a step; the state of lanes that are not ``moving`` stays."""
        step = lane_step(self.features, lane, h)
        if self.dynamics.method.error5:
            error = step_error(self.features, lane, step)
            # The error of an adaptive step decides on that step, all others are summed up.
            lane.error = error if self.features.control is Control.ADAPTIVE else lane.error + error
        if self.features.doubts:
            self._doubt(lane, step, h, moving)
        now = dict(zip(self.dynamics.states, step.state, strict=True))
        before = lane.values(self.dynamics.states)
        self.features.stiction.keep(lane, before, now)
        self.features.watch.note_step(lane, before.values(), now.values(), h)
        lane.set_where(True if moving is None else moving, now)
        for b, watched in zip(self.features.boundaries, step.watched, strict=False):
            lane.set(b.watches, watched[: len(b.watches)])

    def _doubt(self, lane: Lane, step: Step, h: Any, moving: Any) -> None:
        """Record whether the error of a step may exceed its estimate."""
        features, levels = self.features, levels_of(self.features.kinks)
        watched = step.watched[len(features.boundaries) :]
        met = [crossings.meets_kink(*kink, features.overshoot) for kink in zip(watched, levels, strict=False)]
        hidden = [unseen for _, unseen in met]
        crossed = [seen for seen, _ in met] + hidden
        doubts = []
        if self.dynamics.effect_states.integrated:
            doubts.append(others_error(features, lane, step, h) > error_control.DOUBTFUL * lane.tip_tolerance)
        if features.watched_sliders:
            far = total(h * maximum(w.most, -w.least) for w in watched[len(levels) :])
            doubts += [far > error_control.FAR * distance for distance in self._distances(lane, "{}")]
        if moving is not None and features.pose_tells_distances:
            doubts += self._farther(lane, "{}", "{}_start")
        for name, flags in (("kinked", crossed), ("hidden_kink", hidden), ("doubtful", doubts)):
            if flags:
                seen = any_of(flags) if moving is None else any_of(flags) & moving
                lane[name] = lane[name] | seen

    def _distances(self, lane: Lane, form: str) -> list[Any]:
        """Distance of the tip from each joint that turns, m, from the fields of a form."""
        joints = zip(tip_norms(self.dynamics, lane, form), self.dynamics.arm.prismatic, strict=True)
        return [norm for norm, slides in joints if not slides]

    def _farther(self, lane: Lane, before: str, after: str) -> list[Any]:
        """For each joint that turns, whether the tip is now many times as far from it as before."""
        distances = zip(self._distances(lane, before), self._distances(lane, after), strict=True)
        return [new > error_control.FARTHER * old for old, new in distances]

    def judge(self, lane: Lane) -> None:
        """After a common step: why a lane leaves it, if it does. Then the result of the step is not used."""
        overshoot = self.features.overshoot
        moved = [b.in_step(lane, "{}_start") for b in self.features.bounded]
        pulled = any_of(crossings.most_pull(s, overshoot) > 0.0 for s in moved)
        near = any_of(crossings.may_meet(s, lane.h, overshoot) for s in moved)
        reason: Any = cases((pulled, Reason.EVENT), (near, Reason.NEAR_BOUNDARY), default=Reason.NONE)
        guards = self.features.guards
        passes = [(lane[b.pull] > 0.0) | crossings.may_pass(b.watched(lane), overshoot) for b in guards]
        reason = where(any_of(passes), Reason.EVENT, reason)
        goes_on = self.pieces.goes_on(lane)
        if not self.dynamics.controlled:
            self._count(lane, goes_on)
        elif self.features.control is Control.EQUAL:
            # A link that has become fast during the step may have been too fast for it.
            slow = self.least_steps(lane) <= error_control.TOO_FAST
            single = lane.min_steps == 0.0
            served = single & slow & (lane.error <= self.pieces.allowed_error(lane))
            for name in self.features.doubts:
                lane[name] = lane[name] & single
            doubtful, kinked, _ = self.doubts(lane)
            served = served & logical_not(kinked | doubtful)
            reason = where(served, reason, Reason.ACCURACY)
            self._count(lane, single & goes_on)
            lane.error = where(single, lane.error, 0.0)
            self.pieces.judged(lane)
        self._leave(lane, reason)

    def doubts(self, lane: Lane) -> tuple[Any, ...]:
        """Whether the error of an interval may exceed its estimate: near a kink, which estimates do not
        capture well, or though the motion is smooth.

        For the latter either a step has found so, or the tip is now so far from a joint that an error of its
        angle, made when the tip was near, weighs more.
        """
        names = ("doubtful", "kinked", "hidden_kink")
        doubtful, *kinks = (lane[name] if name in self.features.doubts else False for name in names)
        if self.features.pose_tells_distances:
            doubtful = doubtful | any_of(self._farther(lane, "{}_start", "{}"))
        return doubtful, *kinks

    def skip_common_step(self, lane: Lane) -> None:
        """Skip the common step: no lane is served by it."""
        if self.features.control is Control.EQUAL:
            lane.error = 0.0
        self._leave(lane, Reason.ACCURACY)

    def _leave(self, lane: Lane, reason: Any) -> None:
        # Local steps do not help lanes whose state or effort is not finite.
        motion = lane.get(self.dynamics.states[: 2 * self.dynamics.count], of="{}_start")
        defect = self.defect([*motion, *lane.get(self.dynamics.commands)])
        lane.reason = where((defect == 0.0) & self.pieces.goes_on(lane), reason, Reason.NONE)
        # Poison every state: some were never advanced, and others hold results that depend on neighbours.
        for s in self.dynamics.states:
            lane[s] = where(defect == 0.0, lane[s], defect)

    @staticmethod
    def defect(values: list[Any]) -> Any:
        """0 if some numbers are finite, else NaN."""
        return reduce(lambda total, x: total + (x - x), values[1:], values[0] - values[0])
