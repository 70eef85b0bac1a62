"""Robust means of a few runs and their uncertainty, after rliable.

Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Statistic = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
"""(values, axis) -> one number for all values along the axis, such as :func:`interquartile_mean`."""
TAILS = (0.025, 0.975)
"""Quantiles at both ends of a 95 % interval."""
LEAST_RUNS = 5
"""Least number of runs of a stratum for an interval: with two or three runs it would reach from the lowest to
the highest, and miss the true value in every second or fourth case."""
MOST_NUMBERS = 4_000_000
"""Count of numbers that are resampled at a time: 32 MB."""


def interquartile_mean(values: ArrayLike, axis: int = 0) -> NDArray[np.float64]:
    """Mean of the values between the quartiles.

    The definition is rliable's, ``scipy.stats.trim_mean(values, 0.25)``: of n values the n // 4 lowest
    and the n // 4 highest are left out entirely. So it is the plain mean of up to three values.

    Parameters
    ----------
    values : array_like (..., n, ...)
        In any unit; n is at least 1.
    axis : int
        The axis of the n values.

    Returns
    -------
    ndarray (..., ...)
        Without that axis, in the unit of the values; NaN where one of the values is NaN.

    Raises
    ------
    ValueError
        There are no values.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[axis] == 0:
        raise ValueError(f"values has the shape {array.shape}; give at least one value along axis {axis}")
    n = array.shape[axis]
    middle = np.sort(array, axis=axis).take(np.arange(n // 4, n - n // 4), axis=axis).mean(axis=axis)
    unknown = np.isnan(array).any(axis=axis)  # NaN sorts last and would be left out as a high value
    return np.where(unknown, np.nan, middle)[()]


def stratified_bootstrap(
    samples: Sequence[ArrayLike], statistic: Statistic, resamples: int = 2000, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Percentile 95 % interval of a statistic over the runs of all strata.

    Runs are drawn again with replacement, each stratum (task) from its own runs. A run is drawn with all
    its numbers, so the points of a curve stay together.

    Parameters
    ----------
    samples : sequence of array_like (runs, ...)
        One per stratum; strata may differ in their number of runs.
    statistic : Statistic
        It is called with (resamples, runs of all strata, ...) and axis 1.
    resamples : int
        At least 1.
    seed : int
        The same seed and numbers of runs mean the same draws.

    Returns
    -------
    low, high : ndarray (...)
        In the unit of the samples; NaN where a stratum has fewer than ``LEAST_RUNS`` runs.

    Raises
    ------
    ValueError
        There are no strata, a stratum has no runs, or strata differ in shape beyond the runs.
    """
    strata = [np.asarray(runs, dtype=np.float64) for runs in samples]
    if not strata:
        raise ValueError("samples is empty; give one array (runs, ...) per stratum")
    for i, runs in enumerate(strata):
        if runs.ndim == 0 or len(runs) == 0:
            raise ValueError(f"samples[{i}] has the shape {runs.shape}; give at least one run")
        if runs.shape[1:] != strata[0].shape[1:]:
            raise ValueError(
                f"samples[{i}] has the shape {runs.shape}; give (runs, ...) with {strata[0].shape[1:]} "
                "after the runs, as samples[0] has"
            )
    if resamples < 1:
        raise ValueError(f"resamples is {resamples}; give at least 1")
    if min(len(runs) for runs in strata) < LEAST_RUNS:
        unknown = np.full(strata[0].shape[1:], np.nan)
        return unknown[()], unknown[()]
    generator = np.random.default_rng(seed)
    draws = [generator.integers(0, len(runs), (resamples, len(runs))) for runs in strata]
    parts = -(-resamples * sum(runs.size for runs in strata) // MOST_NUMBERS)
    found = []
    for part in np.array_split(np.arange(resamples), min(resamples, max(1, parts))):
        drawn = [runs[draw[part]] for runs, draw in zip(strata, draws, strict=True)]
        found.append(statistic(np.concatenate(drawn, axis=1), 1))
    low, high = np.quantile(np.concatenate(found), TAILS, axis=0)
    return low, high
