"""Robust means of a few runs and their uncertainty, after rliable.

Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

TAILS = (0.025, 0.975)
"""Quantiles at both ends of a 95 % interval."""
LEAST_RUNS = 5
"""Least number of runs for an interval: with two or three it would reach from the lowest to the highest, and
miss the true value in every second or fourth case."""
RESAMPLES, SEED = 2000, 0
MOST_NUMBERS = 4_000_000
"""Count of numbers that are resampled at a time: 32 MB."""


def interquartile_mean(values: ArrayLike, axis: int = 0) -> NDArray[np.float64]:
    """Mean of the finite values between the quartiles, without the axis, in the unit of the values.

    The definition is rliable's, ``scipy.stats.trim_mean(values, 0.25)``: of n values the n // 4 lowest
    and the n // 4 highest are left out entirely. So it is the plain mean of up to three values.
    """
    array = np.sort(np.asarray(values, dtype=np.float64), axis=axis)
    n = array.shape[axis]
    middle: NDArray[np.float64] = array.take(np.arange(n // 4, n - n // 4), axis=axis).mean(axis=axis)
    return middle


def bootstrap_interval(runs: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Percentile 95 % interval of the interquartile mean of runs, which are drawn again with replacement.

    A run is drawn with all its numbers, so the points of a curve stay together. Equal numbers of runs mean
    the same draws.

    Parameters
    ----------
    runs : array_like (runs, ...)

    Returns
    -------
    low, high : ndarray (...)
        In the unit of the runs; NaN for fewer than ``LEAST_RUNS`` runs.
    """
    values = np.asarray(runs, dtype=np.float64)
    if len(values) < LEAST_RUNS:
        unknown = np.full(values.shape[1:], np.nan)
        return unknown, unknown
    draws = np.random.default_rng(SEED).integers(0, len(values), (RESAMPLES, len(values)))
    parts = np.array_split(draws, min(RESAMPLES, -(-RESAMPLES * values.size // MOST_NUMBERS)))
    found = np.concatenate([interquartile_mean(values[part], 1) for part in parts])
    low, high = np.quantile(found, TAILS, axis=0)
    return low, high
