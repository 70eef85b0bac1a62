"""Which limit a position is beyond, and which positions count as equal."""

from typing import Any

from redundant_envs.language.algebra import cases

ROUNDING = 8.881784197001252e-16
"""Relative distance of four ulps: positions and times that are nearer count as equal."""


def side_beyond(position: Any, lower: Any, upper: Any) -> Any:
    """Side of the limit that a position is beyond: 1 upper, -1 lower, 0 none; also for arrays."""
    return cases((position < lower, -1.0), (position > upper, 1.0), default=0.0)
