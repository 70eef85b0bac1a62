"""Failures that are known and not mended yet: counted for themselves, so that others are seen.

Each has a file in the folder open, which a test plays: it is expected to fail, and the test says when it does
not any more. Then delete the line here, and move the file to the folder found.
"""

from __future__ import annotations

from .cases import Case

KNOWN = "known: "
"""What the names of known failures begin with."""


def has_limit_springs(case: Case) -> bool:
    return any(effect["type"] == "LimitSpring" for effect in case["scene"]["effects"])


def has_equal_steps(case: Case) -> bool:
    return case["scene"].get("tolerance") is None and case["scene"].get("integrator") != "dop853"


def is_known(case: Case, invariant: str) -> bool:
    """Whether a case is of a kind that is known to break a promise."""
    if invariant in ("tolerance_is_kept_or_flagged", "the_energy_book_closes"):
        return has_limit_springs(case)  # the stiffness jumps, and the work has no error estimate
    if invariant == "no_lost_lane_depends_on_others":
        return True  # of a lane whose effort is not finite only the flag means something
    if invariant == "observations_are_finite":
        return bool(case["goal"]) and has_equal_steps(case)  # no speed bound ends a motion that explodes
    if invariant == "observations_lie_in_their_space":
        return bool(case["goal"]) and (has_equal_steps(case) or has_limit_springs(case))  # tips fly off
    return False


def kind_of(case: Case, invariant: str) -> str:
    """The name under which a violation is counted."""
    return f"{KNOWN}{invariant}" if is_known(case, invariant) else invariant
