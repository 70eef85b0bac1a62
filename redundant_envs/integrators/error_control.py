"""Error control: what an estimate is in metres at the tip, and what steps a lane takes for it."""

from __future__ import annotations

from redundant_envs.algebra import maximum, minimum, physics, sqrt, where


@physics
def blended_error(e5, e3):
    """Hairer's blend of the two embedded estimates of DOP853."""
    blend = e5 * e5 / sqrt(e5 * e5 + 0.01 * e3 * e3 + 1e-300)  # 1e-300: no division of 0 by 0
    return where(e3 < 1e150, blend, e3)  # the square of a larger e3 is infinite, and the blend 0


@physics
def tip_error(e5, e3):
    """Twice Hairer's blend, m. Of nine million random steps of both arms that pass by it two are off by more
    than twice the tolerance; of those that pass by the blend itself, 34."""
    return 2.0 * blended_error(e5, e3)


@physics
def tip_weight(norm, reach, tip_tolerance):
    """Metres at the tip per radian of a link, for the error of its angle in a step.

    The norm is that of the Jacobian's column, but for links shorter than a hundredth of the reach: they
    fall over within milliseconds, so their errors grow. Theirs count ten times, and stay below 1/400 rad.
    """
    return maximum(norm, minimum(0.01 * reach, maximum(10.0 * norm, 400.0 * tip_tolerance)))


@physics
def scale(before, after):
    """One over the error that dop853 allows a coordinate or velocity in a step: near rounding."""
    return 1.0 / (1e-14 + 1e-13 * maximum(abs(before), abs(after)))


@physics
def steps_of_spring(stiffness, mobility):
    """Steps per second that follow an oscillation: 2 rad of its phase in each."""
    return 0.5 * sqrt(stiffness * mobility)


@physics
def steps_of_damper(damping, mobility):
    """Steps per second that follow a decay: two of its time constants in each."""
    return 0.5 * damping * mobility


@physics
def more(a, b):
    return maximum(a, b)


@physics
def least_steps(fastest, steady, interval):
    """Steps of an interval before any estimate is asked: half a radian of the fastest link in each,
    and what springs and dampers need, since an estimate cannot see one it has not touched."""
    return interval * maximum(2.0 * fastest, steady)


# ---- the plan of a fixed step: that step alone -----------------------------------------------------


@physics(gives="left_first void")
def begin_fixed(h):
    """The step of the scene; what is known of the common step is of use."""
    return h, 0.0


@physics(gives="good left_retry")
def judge_fixed(left):
    """A fixed step asks for no accuracy."""
    return 1.0, left


@physics(gives="last left_again")
def end_fixed(left):
    """There is one step."""
    return 1.0, left


# ---- the plan of a tolerance: 1, 2, 4, ... 16384 equal steps, until the sum of their errors passes ---

# A sum of errors does not know how they grow, which matters where many steps are needed, or many impacts
# happen. From 128 steps on an interval must come out the same, to the tolerance, with half as many, unless
# errors that grow a hundred thousand times would pass; with 32 impacts always.


@physics
def more_steps(n, least):
    """Twice the steps if n is too few."""
    return where(n < 16384.0, where(n < least, 2.0 * n, n), n)


@physics
def steps_that_fail(n, failed, error, tip_tolerance):
    """Twice the steps if n would fail by far: the error falls like n^-7."""
    return where(failed * error > 4.0 * tip_tolerance * n**4 * n**3, 2.0 * n, n)


@physics(gives="left_first void steps_first")
def begin_doubling(marked, floor, error_sum, tip_tolerance, interval):
    """The first number of steps; whether the single step that all lanes make is of no use.

    The error of a single step says little about more than 64.
    """
    failed = where(marked == 1.0, 1.0, 0.0)
    n = steps_that_fail(1.0 + failed, failed, error_sum, tip_tolerance)
    n = steps_that_fail(n, failed, error_sum, tip_tolerance)
    n = steps_that_fail(n, failed, error_sum, tip_tolerance)
    n = steps_that_fail(n, failed, error_sum, tip_tolerance)
    n = steps_that_fail(n, failed, error_sum, tip_tolerance)
    n = steps_that_fail(n, failed, error_sum, tip_tolerance)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    n = more_steps(n, floor)
    return interval / n, failed, n


@physics(gives="good left_retry steps_retry")
def judge_doubling(error_sum, tip_tolerance, steps_of_lane, interval):
    """Whether the errors so far pass, or cannot; else the interval is begun anew with twice the steps."""
    good = where(error_sum <= tip_tolerance, 1.0, where(steps_of_lane >= 16384.0, 1.0, 0.0))
    return good, interval / (2.0 * steps_of_lane), 2.0 * steps_of_lane


@physics(gives="last left_again steps_left_again flagged unsure floor_new")
def end_doubling(
    ended, accepted, steps_left, steps_of_lane, interval, error_sum, tip_tolerance, floor, steps, change,
    events,
):  # fmt: skip
    """After a piece, and at the end of a step: whether it was the last; whether more than 16384 were needed.

    The interval is to be crossed again with twice the steps (``unsure``) if a link has become too fast
    for them by a tenth, as ``steps`` tells, or if it differs by ``change`` [m] from the time before.
    """
    left = steps_left - 1.0
    last = where(left > 0.0, 0.0, 1.0)
    grown = where(steps_of_lane < 128.0, 0.0, 1e5 * error_sum)
    grown = where(events < 32.0, grown, 2.0 * tip_tolerance)
    same = where(grown <= tip_tolerance, 1.0, where(change <= tip_tolerance, 1.0, 0.0))
    floor = where(accepted > 0.0, maximum(floor, steps), floor)
    again = maximum(ended * last * (1.0 - same), where(floor > 1.1 * steps_of_lane, accepted, 0.0))
    most = where(events < 32.0, 16384.0, 256.0)  # beyond, impacts multiply no more than rounding
    unsure = where(steps_of_lane < most, again, 0.0)
    passed = where(error_sum <= tip_tolerance, where(floor <= 16384.0, same, 0.0), 0.0)
    return last, interval / steps_of_lane, left, 1.0 - passed, unsure, floor


# ---- the plan of dop853: each step as long as its error allows (Hairer, Norsett, Wanner I, II.4) ----


@physics(gives="left_first void next_first")
def begin_adaptive(next_step, floor, interval):
    """A first step as long as the last one before, if there was one and it is not too long."""
    longest = interval / maximum(floor, 1.0)
    first = where(next_step > 0.0, where(next_step <= longest, next_step, longest), longest)
    return first, 1.0, first


@physics(gives="good left_retry next_new")
def judge_adaptive(error_sum, h, next_step, floor, interval, steps_left):
    """Whether the error of a step, in units of the tolerance, is at most 1; the next step to try.

    A lane that has made a million steps, or must make one of 1e-13 of the interval, has no next one.
    """
    eighth = sqrt(sqrt(sqrt(maximum(error_sum, 1e-12))))
    factor = where(eighth > 0.0, minimum(maximum(0.9 / eighth, 1.0 / 3.0), 6.0), 1.0 / 3.0)
    passed = where(error_sum <= 1.0, 1.0, 0.0)
    grown = minimum(h * factor, interval / maximum(floor, 1.0))
    grown = where(h < next_step, maximum(grown, next_step), grown)  # the end cut that step short
    shorter = h * minimum(factor, 0.9)
    hopeless = where(steps_left > 1e6, 1.0, where(shorter < 1e-13 * interval, 1.0 - passed, 0.0))
    following = where(hopeless > 0.0, 0.0, where(passed > 0.0, grown, shorter))
    return maximum(passed, hopeless), shorter, following


@physics(gives="last left_again flagged")
def end_adaptive(interval, elapsed_new, next_new):
    """At the end of a step: whether the interval is crossed; the last two steps share the rest."""
    rest = interval - elapsed_new
    half = minimum(next_new, 0.5 * rest)
    left = where(rest <= next_new, rest, where(rest < 2.0 * next_new, half, next_new))
    crossed = where(rest > 1e-14 * interval, 0.0, 1.0)
    given_up = where(next_new > 0.0, 0.0, 1.0)
    return maximum(crossed, given_up), left, given_up
