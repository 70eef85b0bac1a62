"""Differences between episodes under two physics, and between two groups of policies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...statistics import bootstrap_means, middle_95, permutation_test, sign_test
from .episodes import Evaluation

Array = NDArray[np.float64]
BOOTSTRAP_SEED = 0
FEW = 10
"""With fewer seeds, or this few episodes, a bootstrap interval alone is not reliable."""


def compare(
    here: Evaluation, reference: Evaluation, resamples: int, seed: int = BOOTSTRAP_SEED
) -> dict[str, Any]:
    """Differences from the reference, episode by episode, with 95 % intervals of their means."""
    if not (np.array_equal(here.start, reference.start) and np.array_equal(here.goal, reference.goal)):
        raise ValueError("episodes have other starts or goals than under the reference; they are no pairs")
    pairs = np.column_stack([here.hold.astype(float) - reference.hold, here.returns - reference.returns])
    means = bootstrap_means(pairs, resamples, seed)
    hold, gain = pairs.mean(axis=0).tolist()
    lost, won = (int(np.count_nonzero(pairs[:, 0] == flip)) for flip in (-1.0, 1.0))
    return {
        "hold_difference": hold,
        **_bounds("hold_difference", middle_95(means[:, 0])),
        "lost": lost,
        "won": won,
        "sign_test_p": sign_test(lost, won),
        "return_difference": gain,
        **_bounds("return_difference", middle_95(means[:, 1])),
        "median_abs_return_difference": float(np.median(np.abs(pairs[:, 1]))),
        "half_from": half_from(pairs[:, 1]),
    }


def half_from(differences: Array) -> int:
    """Smallest number of differences that make up half of the sum of their sizes; 0 if all are 0."""
    sizes = np.sort(np.abs(differences))[::-1]
    return int(np.searchsorted(np.cumsum(sizes), 0.5 * sizes.sum()) + 1) if sizes[0] else 0


def compare_groups(a: Array, b: Array, resamples: int) -> dict[str, Any]:
    """Difference of the means of two groups, a minus b, with a 95 % bootstrap interval.

    Below ``FEW`` samples in each also the p of an exact permutation test.
    """
    means = bootstrap_means(a, resamples, BOOTSTRAP_SEED) - bootstrap_means(b, resamples, BOOTSTRAP_SEED + 1)
    low, high = middle_95(means)
    p = permutation_test(a, b) if max(len(a), len(b)) < FEW else ""
    return {"difference": float(np.mean(a) - np.mean(b)), "low": low, "high": high, "permutation_p": p}


def _bounds(name: str, interval: tuple[float, float]) -> dict[str, float]:
    return {f"{name}_low": interval[0], f"{name}_high": interval[1]}
