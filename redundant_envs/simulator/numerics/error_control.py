"""Step control: error estimates, which steps a lane takes, and whether they are accurate enough."""

import math
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import logical_not, maximum, minimum, sqrt, where


def blended_error(higher: Any, lower: Any) -> Any:
    """Hairer's blend of two embedded estimates, of which ``higher`` has the higher order."""
    blend = higher * higher / sqrt(higher * higher + 0.01 * lower * lower + 1e-300)  # 1e-300: no 0 / 0
    return where(lower < 1e150, blend, lower)  # the square of a larger one is infinite, and the blend 0


SHARPNESS = 45.0
"""Chosen so that single steps of many scenes are off by at most two thirds of their estimate (0021)."""
SHARPNESS_OF_SPRINGS = 1000.0
"""That of scenes with declared springs and stops: a step of an oscillation may be off by its whole estimate,
and a slider that swings back until it just touches its stop may multiply that by a hundred."""


def tip_error(e6: Any, e5: Any, e3: Any, *, sharpness: float = SHARPNESS) -> Any:
    """Error of a step, m, from estimates that fall with its length like h^7, h^6 and h^4.

    Their quotient q of e5 and e3 falls like h^2, so e6 times the root of q falls like h^8. Where e6 is small
    by chance e5 times q is larger, and where e5 is, e6 takes its place in q. In a step with a kink, where no
    order counts, twice the larger of e5 and e6 is enough.
    """
    higher = maximum(e5, e6)
    q = higher / maximum(higher, e3 + 1e-300)  # 1e-300: no 0 / 0
    smooth = minimum(sharpness * e6 * sqrt(q), 2.0 * higher)
    return where(e3 < 1e150, maximum(smooth, e5 * q), e3)  # if e3 is infinite, q is 0


def tip_weight(norm: Any, reach: Any, tip_tolerance: Any) -> Any:
    """Metres at the tip per radian of a link, for the error of its angle in a step: the norm of the
    Jacobian's column. Links shorter than a hundredth of the reach fall over within milliseconds, so their
    errors grow: they count ten times, and stay below 1/400 rad."""
    return maximum(norm, minimum(0.01 * reach, maximum(10.0 * norm, 400.0 * tip_tolerance)))


def rounding_scale(before: Any, after: Any, strikes: bool) -> Any:
    """Reciprocal of the error that dop853 allows for a coordinate or velocity in a step: near rounding, or a
    hundredth of that if sliders may strike: a hundred elastic impacts multiply an error by thousands."""
    scale = 1.0 / (1e-14 + 1e-13 * maximum(abs(before), abs(after)))
    return 100.0 * scale if strikes else scale


# ---- a tolerance: 1, 2, 4, ... 16384 equal steps, until the sum of their errors passes ----------------

# A sum of errors ignores their growth with many steps or impacts. Where that matters an interval must give
# the same result, to the tolerance, with half as many steps: docs/design.md has the reasons.

MAX_DOUBLINGS = 14
MAX_STEPS = 2.0**MAX_DOUBLINGS
CHECKED_STEPS, CHECKED_ALWAYS = 128.0, 1024.0
GROWTH = 1e5
SOME_IMPACTS, GROWTH_BY_SOME = 4.0, 100.0
CHECKED_IMPACTS = 8.0
MANY_IMPACTS, MAX_STEPS_OF_MANY = 32.0, 256.0
"""With more steps, this many impacts multiply only rounding errors."""
MANY_SHARE, MAX_MANY_SHARE, MANY_ROUNDING = 1e-3, 0.1, 1e-13
"""The largest change to half as many steps after so many impacts, in tolerances: a tenth in
place of a thousandth where rounding alone may be that much, 1e-13 m."""
STEPS_PER_IMPACT = 8.0
"""With fewer steps a comparison of a kinked interval with half as many does not count."""
STEPS_OF_HIDDEN_KINK = 16.0
"""Nor does it with fewer than these if a kink may have been passed back and forth between two stages: with
half as many steps it may have been between stages, too."""
KINKED_GROWTH, KINKED_SHARE = 16.0, 0.25
"""For a kinked interval: the factor with which its estimated error must still pass, with 8 impacts
``GROWTH``, and the largest change to half as many steps, in tolerances."""
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


@branches
def steps_for_error(failed: Any, error: Any, tip_tolerance: Any) -> Any:
    """Number of steps that the error of a single step calls for, or 1 if that did not fail. The estimate
    falls like n^-7, and that of a single step predicts little beyond 64 steps."""
    if not failed:
        return 1.0
    for k in range(6, 0, -1):
        if error > 2.0 ** (7 * k) * tip_tolerance:
            return 2.0 ** (k + 1)
    return 2.0


@branches
def steps_allowed(min_steps: Any) -> Any:
    """The least power of two that is not below a number of steps."""
    for k in range(MAX_DOUBLINGS - 1, -1, -1):
        if min_steps > 2.0**k:
            return 2.0 ** (k + 1)
    return 1.0


class Crossed(NamedTuple):
    """An interval that was crossed with equal steps."""

    steps: Any  # their number
    error: Any  # the sum of the errors, m
    tip_tolerance: Any  # what is allowed, m
    change: Any  # distance of the tip from the result of the previous time, m
    impacts: Any  # so far
    doubtful: Any = False  # whether the error may exceed its estimate
    kinked: Any = False  # whether a force may have had a kink
    hidden_kink: Any = False  # whether it may have had one between the stages


@branches
def growth_allowed(c: Crossed) -> Any:
    """Whether errors that grow as much as the steps and impacts of an interval permit would still pass."""
    if c.impacts >= CHECKED_IMPACTS or c.steps >= CHECKED_ALWAYS or c.doubtful or c.kinked:
        return False
    if not c.steps < CHECKED_STEPS:
        return GROWTH * c.error <= c.tip_tolerance
    return c.impacts < SOME_IMPACTS or GROWTH_BY_SOME * c.error <= c.tip_tolerance


@branches
def confirmed(c: Crossed) -> Any:
    """Whether the result of the previous time confirms that of an interval."""
    if not c.kinked:
        if c.impacts < MANY_IMPACTS:
            return c.change <= c.tip_tolerance
        most = minimum(MAX_MANY_SHARE * c.tip_tolerance, MANY_ROUNDING)
        return c.change <= maximum(MANY_SHARE * c.tip_tolerance, most)
    growth = KINKED_GROWTH if c.impacts < CHECKED_IMPACTS else GROWTH
    least = maximum(STEPS_PER_IMPACT * c.impacts, STEPS_OF_HIDDEN_KINK if c.hidden_kink else 1.0)
    accurate = (growth * c.error <= c.tip_tolerance) & (c.change <= KINKED_SHARE * c.tip_tolerance)
    return accurate & (c.steps >= minimum(least, most_steps(c.impacts)))


@branches
def growth_over_pieces(steps: Any, impacts: Any) -> Any:
    """Factor by which an error may have grown over the pieces of an interval with so many steps; 1 with one
    or two, as without instants, for whose growth estimates leave room."""
    if impacts >= SOME_IMPACTS:
        return math.inf
    if steps <= 2.0:
        return 1.0
    if steps <= 8.0:
        return 10.0
    return 1e3 if steps <= 32.0 else math.inf


@branches
def most_steps(impacts: Any) -> Any:
    """Largest number of steps into which an interval is divided."""
    return MAX_STEPS if impacts < MANY_IMPACTS else MAX_STEPS_OF_MANY


# ---- dop853: each step as long as its error allows (Hairer, Norsett, Wanner I, II.4) ------------------

MAX_ADAPTIVE_STEPS = 1e6
SHORTEST_SHARE = 1e-13
"""Fraction of the interval below which no step is tried."""
CROSSED_SHARE = 1e-14
"""Fraction of the interval that is not worth a step."""


@branches
def first_adaptive(next_step: Any, min_steps: Any, interval: Any) -> Any:
    """Length of a first step, s: that of the last one of the previous interval, unless it is too long."""
    longest = interval / maximum(min_steps, 1.0)
    return next_step if next_step > 0.0 and next_step <= longest else longest


class Judgement(NamedTuple):
    """What the error of an adaptive step says."""

    accepted: Any  # whether the step counts
    shorter: Any  # length of the step if it is repeated, s
    following: Any  # length of the next step; 0 if there is none, s


@branches
def judge_adaptive(
    error: Any, h: Any, next_step: Any, min_steps: Any, interval: Any, taken: Any
) -> Judgement:
    """Whether the error of a step, in units of the tolerance, is at most 1; the next step to try, of which
    there is none after a million steps ``taken``, or if it were 1e-13 of the interval. The end of the
    interval may have cut the planned ``next_step`` short, to ``h``."""
    eighth = sqrt(sqrt(sqrt(maximum(error, 1e-12))))
    factor = minimum(maximum(0.9 / eighth, 1.0 / 3.0), 6.0) if eighth > 0.0 else 1.0 / 3.0
    passed = error <= 1.0
    grown = minimum(h * factor, interval / maximum(min_steps, 1.0))
    if h < next_step:  # such a step lengthens none
        grown = maximum(grown, next_step)
    shorter = h * minimum(factor, 0.9)
    hopeless = (taken > MAX_ADAPTIVE_STEPS) | ((shorter < SHORTEST_SHARE * interval) & logical_not(passed))
    if hopeless:
        return Judgement(True, shorter, 0.0)
    return Judgement(passed, shorter, grown if passed else shorter)


@branches
def rest_of_interval(rest: Any, following: Any) -> Any:
    """Length of the next planned step, s: the last two steps share the rest of the interval."""
    if rest <= following:
        return rest
    return minimum(following, 0.5 * rest) if rest < 2.0 * following else following
