"""Error control: what an estimate is in metres at the tip, and how many steps a lane needs at least."""

from __future__ import annotations

from redundant_envs.algebra import maximum, physics, sqrt, where

MOST_STEPS = 256
"""Most equal steps of a control interval; a lane that needs more is flagged."""


@physics
def tip_error(e5, e3):
    """Hairer's blend of the two embedded estimates of DOP853, in metres at the tip."""
    return where(e5 > 0.0, e5 * e5 / sqrt(e5 * e5 + 0.01 * e3 * e3), e5)


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
