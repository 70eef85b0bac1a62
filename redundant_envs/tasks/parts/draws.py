"""Draws that must fit: for goals, curves and obstacles of an episode."""

from collections.abc import Callable, Sequence
from typing import Any

from redundant_envs.language.algebra import cases, physics


def first_that_fits(
    gives: Sequence[str], candidates: Sequence[Sequence[str]], fits: Sequence[str]
) -> Callable[..., Any]:
    """A function that gives the first of some candidates that fits, or the last one if none does.

    Parameters
    ----------
    gives : sequence of str
        Names of the quantities that it gives.
    candidates : sequence of sequences of str
        For each candidate the quantities of which it consists, as many as there are in ``gives``.
    fits : sequence of str
        For each candidate but the last a quantity that is positive where the candidate fits.
    """
    width = len(gives)

    @physics(gives=gives, takes=(*fits, *(name for candidate in candidates for name in candidate)))
    def first_that_fits(*values: Any) -> Any:
        fitting, rest = values[: len(fits)], values[len(fits) :]
        rows = [rest[k : k + width] for k in range(0, len(rest), width)]
        chosen = zip(*rows, strict=True)
        results = tuple(
            cases(*((fit > 0.0, x) for fit, x in zip(fitting, column, strict=False)), default=column[-1])
            for column in chosen
        )
        return results if width > 1 else results[0]

    return first_that_fits
