"""Intervals, tests, and robust means of a few runs: those of rliable (Agarwal et al. 2021, "Deep
reinforcement learning at the edge of the statistical precipice")."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Statistic = Callable[..., Any]  # (samples, axis) -> the statistic over this axis
NORMAL_95 = 1.959963984540054
MIN_RUNS = 5  # with two or three an interval would miss the true value in every second or fourth case
MIN_PAIRS = 20  # least number of pairs whose bootstrap says anything
CHANCE = 0.05  # largest probability by chance of what is called a difference
RESAMPLES, SEED = 2000, 0
MAX_NUMBERS = 4_000_000  # count of numbers that are resampled at a time: 32 MB


def wilson(successes: int, trials: int, z: float = NORMAL_95) -> tuple[float, float]:
    """Wilson score interval of a success rate (95 % by default)."""
    p = successes / trials
    scale = 1.0 + z * z / trials
    middle = (p + z * z / (2 * trials)) / scale
    half = z * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials)) / scale
    return max(0.0, middle - half), min(1.0, middle + half)


def sign_test(a: int, b: int) -> float:
    """Two-sided p of a against b changes, if both directions were equally likely; 1 without any."""
    count, term, tail = a + b, 1, 1
    for k in range(min(a, b)):
        term = term * (count - k) // (k + 1)  # of binomial coefficients
        tail += term
    return min(1.0, tail / 2 ** (count - 1)) if count else 1.0


def differs(a: ArrayLike, b: ArrayLike, statistic: Statistic = np.mean) -> bool:
    """Whether a statistic of paired samples, in the same order, differs beyond chance at a level of 95 %: for
    truth values by the exact sign test of the pairs that differ, otherwise by a bootstrap of pairs."""
    pairs = np.stack([np.asarray(a), np.asarray(b)], axis=1)
    if pairs.dtype == np.bool_:
        won, lost = (int((pairs[:, i] & ~pairs[:, 1 - i]).sum()) for i in (0, 1))
        return sign_test(won, lost) < CHANCE
    if len(pairs) < MIN_PAIRS:
        return False
    resampled = bootstrap(pairs, RESAMPLES, SEED, statistic)
    low, high = middle_95(resampled[:, 0] - resampled[:, 1])
    return bool(low > 0.0 or high < 0.0)


def interquartile_mean(values: ArrayLike, axis: int = 0) -> Array:
    """Mean of the values between the quartiles: rliable's, ``scipy.stats.trim_mean(values, 0.25)``, which
    leaves out the n // 4 lowest and highest entirely. So it is the plain mean of up to three values."""
    array = np.sort(np.asarray(values, dtype=np.float64), axis=axis)
    n = array.shape[axis]
    return array.take(np.arange(n // 4, n - n // 4), axis=axis).mean(axis=axis)


def bootstrap(samples: ArrayLike, resamples: int, seed: int, statistic: Statistic = np.mean) -> Array:
    """A statistic of (n, ...) samples drawn again with replacement, (resamples, ...); entries are drawn as a
    whole, so pairs and curves stay together, and equal n means the same draws."""
    values = np.asarray(samples, dtype=np.float64)
    n = len(values)
    generator = np.random.default_rng(seed)
    parts = min(resamples, -(-resamples * values.size // MAX_NUMBERS))
    counts = [len(part) for part in np.array_split(np.arange(resamples), parts)]
    return np.concatenate([statistic(values[generator.integers(0, n, (k, n))], axis=1) for k in counts])


def middle_95(values: Array) -> tuple[Any, Any]:
    """The interval with 2.5 % of the values on either side, over the first axis."""
    low, high = np.quantile(values, (0.025, 0.975), axis=0)
    return low, high


def run_interval(runs: ArrayLike) -> tuple[Array, Array]:
    """95 % bootstrap interval of the interquartile mean of (runs, ...); NaN for fewer than ``MIN_RUNS``."""
    values = np.asarray(runs, dtype=np.float64)
    if len(values) < MIN_RUNS:
        return np.full(values.shape[1:], np.nan), np.full(values.shape[1:], np.nan)
    return middle_95(bootstrap(values, RESAMPLES, SEED, interquartile_mean))
