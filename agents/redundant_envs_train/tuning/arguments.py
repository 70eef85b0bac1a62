"""Checks of a study's numbers, before anything large is imported."""

from __future__ import annotations

from ..config import Config
from ..training.pool import count_of

MOST_TRIALS = 10_000
MOST_SEED = 2**32 - 1


def check_arguments(config: Config, trials: int, seed: int, processes: int) -> None:
    """ValueError for impossible arguments of a study."""
    if not 1 <= trials <= MOST_TRIALS:
        raise ValueError(f"trials is {trials}; give a whole number from 1 to {MOST_TRIALS}")
    if not 0 <= seed <= MOST_SEED:
        raise ValueError(f"seed is {seed}; give a whole number from 0 to {MOST_SEED}")
    count_of(processes)
    if config.max_seconds is not None:
        raise ValueError(
            f"max_seconds is {config.max_seconds:g}; trials are compared at equal steps: give "
            "max_seconds=null and total_steps"
        )
