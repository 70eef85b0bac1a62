"""The judge of a control interval: is the tip where accurate references agree that it is?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIRMED = 0.1  # references agree if their tips differ by less than this, in units of the tolerance
LIMIT = 2.0  # an error beyond this is a miss, in units of the tolerance: an estimate is no bound


class Judgement(NamedTuple):
    """Of the lanes of an interval."""

    judged: NDArray[np.bool_]  # lanes whose references agree
    missed: NDArray[np.bool_]  # of these, the lanes whose tips are off
    error: Array  # distance from the first reference, in units of the tolerance


def agree(references: Sequence[Array], tolerance: float) -> NDArray[np.bool_]:
    """Lanes of which all references, tips (n, 2) in m, confirm the first one."""
    best, *others = references
    with np.errstate(all="ignore"):
        apart = [np.zeros(len(best)), *(np.linalg.norm(other - best, axis=1) for other in others)]
        return np.max(apart, axis=0) <= CONFIRMED * tolerance


def judge(tips: Array, references: Sequence[Array], tolerance: float, known: Any = True) -> Judgement:
    """Compare the tips of an interval, (n, 2), m, with those of references, the most accurate one first.

    The tolerance is the scene's, m; in lanes that are ``known``, nothing has a flag.
    """
    with np.errstate(all="ignore"):
        error = np.linalg.norm(tips - references[0], axis=1) / tolerance
    judged = agree(references, tolerance) & known
    return Judgement(judged, judged & ~(error <= LIMIT), error)
