"""Factors of the effort limits in the study of motor strength."""

from __future__ import annotations

from redundant_envs.values import shown

FACTORS = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3)  # effort limits, in units of those of the reach scenes
MOST_FACTORS, MOST_FACTOR = 100, 10.0
DIGITS = 6


def factors_of(text: str) -> tuple[float, ...]:
    """Factors as a user writes them, ``0.6,0.5``; those of the study for an empty text."""
    if not text:
        return FACTORS
    try:
        factors = tuple(round(float(part), DIGITS) for part in text.split(","))
    except ValueError:
        factors = ()
    if not 1 <= len(set(factors)) == len(factors) <= MOST_FACTORS or not all(
        0.0 < f <= 10.0 for f in factors
    ):
        raise ValueError(
            f"factors is {shown(text)}; give different numbers above 0 and up to {MOST_FACTOR:g}, such "
            "as 0.6,0.5"
        )
    return factors
