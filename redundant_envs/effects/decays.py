"""Exponential decays over a time of any length, for the closed forms of states."""

from __future__ import annotations

from redundant_envs.algebra import maximum, physics, where

FEW = 1e-3
"""Time constants below which a series is used: rounding would be 1e-13 of it, and the next term of the series
is 1e-14."""


@physics
def series(x):
    """(1 - e^-x) / x where x is small."""
    return 1.0 - 0.5 * x + 0.16666666666666666 * x**2 - 0.041666666666666664 * x**3


@physics
def decayed(x, left):
    """1 - e^-x, with ``left`` = e^-x: the difference would lose the digits of a short time."""
    return where(x > FEW, 1.0 - left, x * series(x))


@physics
def mean(x, left):
    """(1 - e^-x) / x, with ``left`` = e^-x: the mean of the decay until then."""
    return where(x > FEW, (1.0 - left) / maximum(x, FEW), series(x))
