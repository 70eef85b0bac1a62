"""Error estimates in metres at the tip, and the number of steps that rates require without one."""

from __future__ import annotations

from typing import Any

from redundant_envs.algebra import maximum, minimum, sqrt, where


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


def least_steps(fastest: Any, least_step_rate: Any, interval: Any) -> Any:
    """Number of steps of an interval before any estimate is used: half a radian of the fastest link in each,
    and as many as springs and dampers require, since an estimate cannot see a spring before it is touched."""
    return interval * maximum(2.0 * fastest, least_step_rate)
