"""Error control: error estimates in metres at the tip, and the steps that a lane takes."""

from __future__ import annotations

from typing import Any, NamedTuple

from redundant_envs.algebra import cases, logical_not, maximum, minimum, sqrt, where


def blended_error(higher: Any, lower: Any) -> Any:
    """Hairer's blend of two embedded estimates, of which ``higher`` has the higher order."""
    blend = higher * higher / sqrt(higher * higher + 0.01 * lower * lower + 1e-300)  # 1e-300: no 0 / 0
    return where(lower < 1e150, blend, lower)  # the square of a larger one is infinite, and the blend 0


def tip_error(e6: Any, e5: Any, e3: Any) -> Any:
    """Twice the larger of two blends, m: where e5 is small by chance, its blend with e3 is a hundred times
    too small (decision record 0017)."""
    return 2.0 * maximum(blended_error(e6, e5), blended_error(e5, e3))  # a NaN of the first is passed on


def tip_weight(norm: Any, reach: Any, tip_tolerance: Any) -> Any:
    """Metres at the tip per radian of a link, for the error of its angle in a step.

    The norm is that of the Jacobian's column, except for links shorter than a hundredth of the reach: they
    fall over within milliseconds, so their errors grow. Their errors count ten times, and stay below
    1/400 rad.
    """
    return maximum(norm, minimum(0.01 * reach, maximum(10.0 * norm, 400.0 * tip_tolerance)))


def rounding_scale(before: Any, after: Any, strikes: bool) -> Any:
    """Reciprocal of the error that dop853 allows for a coordinate or velocity in a step: near rounding.

    If sliders may strike their stops it allows a hundredth of that: a hundred elastic impacts in an interval
    multiply an error by thousands.
    """
    scale = 1.0 / (1e-14 + 1e-13 * maximum(abs(before), abs(after)))
    return 100.0 * scale if strikes else scale


def steps_of_spring(stiffness: Any, mobility: Any) -> Any:
    """Steps per second that resolve an oscillation: 2 rad of its phase in each."""
    return 0.5 * sqrt(stiffness * mobility)


def steps_of_damper(damping: Any, mobility: Any) -> Any:
    """Steps per second that resolve a decay: two of its time constants in each."""
    return 0.5 * damping * mobility


def steps_towards_damper(here: Any, there: Any, mobility: Any, interval: Any) -> Any:
    """Steps per second that resolve a decay whose damping changes from its value ``here`` to its value
    ``there``, the position that the joint reaches in the interval at the present rate: one of the time
    constants at the end of a step."""
    here, there = 2.0 * steps_of_damper(here, mobility), 2.0 * steps_of_damper(there, mobility)
    return maximum(here, sqrt(maximum(here, 1.0 / interval) * there))


def steps_of_state(rate: Any) -> Any:
    """Steps per second that resolve a state of an effect: two of its time constants in each."""
    return 0.5 * rate


def least_steps(fastest: Any, steady: Any, interval: Any) -> Any:
    """Number of steps of an interval before any estimate is used: half a radian of the fastest link in each,
    and as many as springs and dampers require, since an estimate cannot see a spring before it is touched."""
    return interval * maximum(2.0 * fastest, steady)


class Plan(NamedTuple):
    """The first step of a lane that the common step does not serve.

    Attributes
    ----------
    left : length of the planned step, s
    void : whether the common step is useless for the lane
    steps : number of steps into which the interval is divided
    following : the step after it, s
    """

    left: Any
    void: Any
    steps: Any = None
    following: Any = None


class Verdict(NamedTuple):
    """Whether a trial step is accurate enough, and the plan if it is not."""

    good: Any
    left: Any
    steps: Any = None
    following: Any = None


class Ending(NamedTuple):
    """At the end of a planned step.

    Attributes
    ----------
    last : whether the interval is crossed
    left : length of the next planned step, s
    flagged : whether the required accuracy is not reached
    steps_left : planned steps to go
    unsure : whether the interval is to be crossed again with twice the steps
    min_steps : the least number of steps that is allowed from now on
    """

    last: Any
    left: Any
    flagged: Any
    steps_left: Any = None
    unsure: Any = False
    min_steps: Any = None


# ---- a tolerance: 1, 2, 4, ... 16384 equal steps, until the sum of their errors passes ----------------

# A sum of errors ignores their growth, which matters with many steps or many impacts. From 128 steps on an
# interval must give the same result, to the tolerance, with half as many, unless errors that grow a hundred
# thousand times would pass; from 1024 on always: such a motion may be chaotic. Two sliders between their
# stops may double an error with each impact: from 4 impacts on errors that grow a hundred times must pass,
# and from 8 on the check is always made, as it is after a kink of a force, or when the tip has come to
# another distance from a joint. If impacts follow each other faster than steps, both motions have the same
# pieces between them, and agree whatever their error is: after a kink such an agreement does not count.

MOST_DOUBLINGS = 14
MOST_STEPS = 2.0**MOST_DOUBLINGS
CHECKED_STEPS, CHECKED_ALWAYS = 128.0, 1024.0
GROWTH = 1e5
SOME_IMPACTS, GROWTH_BY_SOME = 4.0, 100.0
CHECKED_IMPACTS = 8.0
MANY_IMPACTS, MOST_STEPS_OF_MANY = 32.0, 256.0
"""With more steps, this many impacts multiply only rounding errors."""
STEPS_PER_IMPACT = 8.0
"""With fewer steps a comparison of a kinked interval with half as many does not count."""
STEPS_OF_HIDDEN_KINK = 16.0
"""Nor does it with fewer than these if a kink may have been passed back and forth between two stages: with
half as many steps it may have been between stages, too."""
KINKED_GROWTH, KINKED_SHARE = 16.0, 0.25
"""For a kinked interval: the factor with which its estimated error must still pass, and the largest change to
half as many steps, in tolerances: across a kink both are now and then, by chance, much smaller than the
error. With 8 impacts ``GROWTH`` times the estimated error must pass."""
TOO_FAST = 1.1
"""A link may have become faster by a tenth than the rate for which the number of steps was chosen."""
FARTHER, FAR = 4.0, 0.4
"""Ratio of the tip's distances from a joint, after and before, from which on an error at the tip may exceed
its estimate; and the travel of sliders in a step, in units of that distance, that may lead past the joint,
where all is fast."""
DOUBTFUL = 0.1
"""Fraction of the tolerance from which on the error of an effect's state may be too large."""
NEVER_SEEN = 1e300
"""Positions, before an interval is crossed for the first time, that are near no real ones."""


def first_doubling(failed: Any, error: Any, min_steps: Any, tip_tolerance: Any, interval: Any) -> Plan:
    """The first number of steps, after the common single step has ``failed``.

    The error falls like n^-7, and the error of a single step predicts little beyond 64 steps.
    """
    n: Any = 2.0
    for k in range(1, 7):  # all comparisons at once: none waits for another
        n = where(error > 4.0 * 2.0 ** (7 * k) * tip_tolerance, 2.0 ** (k + 1), n)
    allowed: Any = 1.0
    for k in range(MOST_DOUBLINGS):
        allowed = where(min_steps > 2.0**k, 2.0 ** (k + 1), allowed)
    n = maximum(where(failed, n, 1.0), allowed)
    return Plan(interval / n, failed, n)


def judge_doubling(error: Any, tip_tolerance: Any, steps: Any, interval: Any) -> Verdict:
    """Whether the errors so far pass, or no more steps are allowed; else the interval is repeated with twice
    the steps."""
    good = (error <= tip_tolerance) | (steps >= MOST_STEPS)
    return Verdict(good, interval / (2.0 * steps), 2.0 * steps)


class Crossed(NamedTuple):
    """Data of an interval after a trial step.

    Attributes
    ----------
    ended, accepted : whether a planned step ends with the trial step; whether it has no event
    steps_left, steps : planned steps to go and in all
    least : number of steps that the present rates require
    change : distance of the tip from the result of the previous time, m
    impacts : so far
    doubtful, kinked : whether the error may exceed its estimate; whether a force may have had a kink
    hidden_kink : whether it may have had one between the stages
    """

    ended: Any
    accepted: Any
    steps_left: Any
    steps: Any
    least: Any
    change: Any
    impacts: Any
    doubtful: Any = False
    kinked: Any = False
    hidden_kink: Any = False


def end_doubling(c: Crossed, error: Any, tip_tolerance: Any, min_steps: Any, interval: Any) -> Ending:
    """At the end of a step: whether it was the last; whether more than 16384 were needed.

    The interval is to be crossed again if a link has become too fast for its steps, or if its result differs
    from that of the previous time.
    """
    left = c.steps_left - 1.0
    last = logical_not(left > 0.0)
    grown = where(c.impacts < SOME_IMPACTS, 0.0, GROWTH_BY_SOME * error)
    grown = where(c.steps < CHECKED_STEPS, grown, GROWTH * error)
    always = (c.impacts >= CHECKED_IMPACTS) | (c.steps >= CHECKED_ALWAYS) | c.doubtful | c.kinked
    grown = where(always, 2.0 * tip_tolerance, grown)
    most = where(c.impacts < MANY_IMPACTS, MOST_STEPS, MOST_STEPS_OF_MANY)
    growth = where(c.impacts < CHECKED_IMPACTS, KINKED_GROWTH, GROWTH)
    sure = (growth * error <= tip_tolerance) & (c.change <= KINKED_SHARE * tip_tolerance)
    least = maximum(STEPS_PER_IMPACT * c.impacts, where(c.hidden_kink, STEPS_OF_HIDDEN_KINK, 1.0))
    sure = sure & (c.steps >= minimum(least, most))
    alike = where(c.kinked, sure, c.change <= tip_tolerance)
    same = (grown <= tip_tolerance) | alike
    min_steps = where(c.accepted, maximum(min_steps, c.least), min_steps)
    again = (c.ended & last & logical_not(same)) | ((min_steps > TOO_FAST * c.steps) & c.accepted)
    unsure = (c.steps < most) & again
    passed = (error <= tip_tolerance) & (min_steps <= MOST_STEPS) & same
    return Ending(last, interval / c.steps, logical_not(passed), left, unsure, min_steps)


# ---- dop853: each step as long as its error allows (Hairer, Norsett, Wanner I, II.4) ------------------

MOST_ADAPTIVE_STEPS = 1e6
SHORTEST_SHARE = 1e-13
"""Fraction of the interval below which no step is tried."""
CROSSED_SHARE = 1e-14
"""Fraction of the interval that is not worth a step."""


def first_adaptive(next_step: Any, min_steps: Any, interval: Any) -> Plan:
    """A first step as long as the last one of the previous interval, if there was one and it is not too
    long."""
    longest = interval / maximum(min_steps, 1.0)
    first = where(next_step > 0.0, where(next_step <= longest, next_step, longest), longest)
    return Plan(first, True, None, first)


def judge_adaptive(error: Any, h: Any, next_step: Any, min_steps: Any, interval: Any, taken: Any) -> Verdict:
    """Whether the error of a step, in units of the tolerance, is at most 1; the next step to try.

    A lane that has made a million steps, or would need one of 1e-13 of the interval, has no next step.
    """
    eighth = sqrt(sqrt(sqrt(maximum(error, 1e-12))))
    factor = where(eighth > 0.0, minimum(maximum(0.9 / eighth, 1.0 / 3.0), 6.0), 1.0 / 3.0)
    passed = error <= 1.0
    grown = minimum(h * factor, interval / maximum(min_steps, 1.0))
    grown = where(h < next_step, maximum(grown, next_step), grown)  # the end cut that step short
    shorter = h * minimum(factor, 0.9)
    hopeless = (taken > MOST_ADAPTIVE_STEPS) | ((shorter < SHORTEST_SHARE * interval) & logical_not(passed))
    following = cases((hopeless, 0.0), (passed, grown), default=shorter)
    return Verdict(passed | hopeless, shorter, None, following)


def end_adaptive(interval: Any, elapsed: Any, following: Any) -> Ending:
    """At the end of a step: whether the interval is crossed; the last two steps share the rest."""
    rest = interval - elapsed
    half = minimum(following, 0.5 * rest)
    left = where(rest <= following, rest, where(rest < 2.0 * following, half, following))
    given_up = logical_not(following > 0.0)
    return Ending(logical_not(rest > CROSSED_SHARE * interval) | given_up, left, given_up)
