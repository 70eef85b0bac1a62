"""Pure functions of samples."""

from __future__ import annotations

import math

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
