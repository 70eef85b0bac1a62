"""Promises, findings and verdicts of checks."""

import enum
import math
from typing import NamedTuple


class Mode(enum.IntEnum):
    """Extent of the checks; each mode includes the ones before it."""

    QUICK = 0
    STANDARD = 1
    FULL = 2


class Verdict(enum.Enum):
    """What a check says of a promise."""

    KEPT = "kept"
    MISSED = "MISSED"
    MEASURED = "measured"
    NOT_APPLICABLE = "not applicable"


class NotApplicable(Exception):
    """A check does not apply to a subject; the message is the reason."""


class Promise(NamedTuple):
    """Condition on a number."""

    bound: float  # NaN if nothing is promised
    unit: str  # "" for a ratio
    relation: str  # "at most", "at least", "" or "equal bits": of the lanes that differ it promises none

    def holds(self, value: float) -> bool:
        """Whether a number is as promised; NaN never is."""
        return value >= self.bound if self.relation == "at least" else value <= self.bound

    def __str__(self) -> str:
        if self.relation in ("", "equal bits"):
            return self.relation or "-"
        return f"{self.relation} {self.bound:.3g} {self.unit}".rstrip()


def at_most(bound: float, unit: str = "") -> Promise:
    return Promise(bound, unit, "at most")


def at_least(bound: float) -> Promise:
    return Promise(bound, "", "at least")


EQUAL_BITS = Promise(0.0, "lanes differ", "equal bits")


def nothing(unit: str) -> Promise:
    """Promise for a number that is only measured."""
    return Promise(math.nan, unit, "")


class Finding(NamedTuple):
    """A number, and the state in which it was found."""

    found: float
    where: str = ""  # state and joint of the worst case
    words: str = ""  # the fault, if the promise is missed, or advice for a reader of a measured number
