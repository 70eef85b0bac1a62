"""Pure functions of samples."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

NORMAL_95 = 1.959963984540054


def wilson(successes: int, trials: int, z: float = NORMAL_95) -> tuple[float, float]:
    """Wilson score interval of a success rate (95 % by default)."""
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"successes is {successes} of {trials} trials; give 0 <= successes <= trials")
    p = successes / trials
    scale = 1.0 + z * z / trials
    middle = (p + z * z / (2 * trials)) / scale
    half = z * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials)) / scale
    return max(0.0, middle - half), min(1.0, middle + half)


def sign_test(a: int, b: int) -> float:
    """Two-sided p of a against b changes, if both directions were equally likely; 1 without any."""
    tail = sum(math.comb(a + b, k) for k in range(min(a, b) + 1))
    return min(1.0, tail / 2 ** (a + b - 1)) if a + b else 1.0


def permutation_test(a: NDArray[np.float64], b: NDArray[np.float64], most: int = 200_000) -> float:
    """Two-sided p of the difference of two means: the share of all splits that differ as much."""
    both = np.concatenate([a, b])
    splits = math.comb(len(both), len(a))
    if splits > most:
        raise ValueError(
            f"permutation test of {len(a)} and {len(b)} samples has {splits} splits; at most {most}"
        )
    sums = both[list(itertools.combinations(range(len(both)), len(a)))].sum(axis=1)
    differences = np.abs(sums / len(a) - (both.sum() - sums) / len(b))
    return float(np.mean(differences >= differences[0] * (1.0 - 1e-9)))  # the first split is theirs


def bootstrap_means(samples: ArrayLike, resamples: int, seed: int) -> NDArray[np.float64]:
    """Means of (n, ...) samples drawn again with replacement, (resamples, ...).

    All of an entry is drawn together: columns of differences stay paired.
    """
    values = np.asarray(samples, dtype=np.float64)
    n = len(values)
    if n < 2 or resamples < 1:
        raise ValueError(f"bootstrap of {n} samples, {resamples} times; give at least 2, at least once")
    generator = np.random.default_rng(seed)
    parts = -(-resamples * n // 1_000_000)  # a million indices at a time
    return np.concatenate(
        [
            values[generator.integers(0, n, (len(part), n))].mean(axis=1)
            for part in np.array_split(np.arange(resamples), parts)
        ]
    )


def middle_95(values: NDArray[np.float64]) -> tuple[float, float]:
    """The interval with 2.5 % of the values on either side."""
    low, high = np.quantile(values, (0.025, 0.975))
    return float(low), float(high)
