"""Where the target of a curve will be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CURVE = (
    "phase", "spin", "along", "across", "eight", "tilt_s", "tilt_c", "centre_x", "centre_y", "wait", "rise"
)  # fmt: skip


def targets_of(numbers: Mapping[str, Array], dt: float, steps: int) -> Array:
    """Places (n, steps + 1, 2) of the target [m] at 0, dt, .., from the numbers of the task and its curve."""
    c = {name: numbers[name][:, None] for name in CURVE}
    with np.errstate(over="ignore"):
        ramp = np.clip((np.arange(steps) * dt - c["wait"]) / c["rise"], 0.0, 1.0)
    phase = c["phase"] + c["spin"] * dt * np.cumsum(np.pad(ramp, ((0, 0), (1, 0))), axis=1)
    x = c["along"] * np.cos(phase)
    y = c["across"] * np.where(c["eight"] > 0.5, np.sin(2.0 * phase), np.sin(phase))
    turned = c["tilt_c"] * x - c["tilt_s"] * y, c["tilt_s"] * x + c["tilt_c"] * y
    return np.stack([c["centre_x"] + turned[0], c["centre_y"] + turned[1]], axis=-1)
