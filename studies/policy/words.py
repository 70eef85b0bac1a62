"""The results of the policy study in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from redundant_envs.support import palette

from .episodes import FEW
from .settings import Study

NONE, SMALL, OPEN, LARGE = "none", "small", "open", "large"
"""Verdicts on an interval: contains 0 within the margins; within them without 0; contains 0 and more;
else."""
LOOKS = {
    NONE: (palette.BLUE, "o", "no measurable difference"),
    SMALL: (palette.GREEN, "s", "measurable, within the margin"),
    OPEN: (palette.AMBER, "D", "not resolved"),
    LARGE: (palette.VERMILION, "^", "a difference"),
}


@dataclass(frozen=True)
class Difference:
    """A mean difference, its 95 % interval, and the margin that counts as narrow, in one unit. An interval of
    few samples is unreliable: if an exact test disagrees (``doubtful``), it is taken to contain 0."""

    value: float
    low: float
    high: float
    margin: float
    doubtful: bool

    @property
    def verdict(self) -> str:
        """One of NONE, SMALL, OPEN, LARGE."""
        zero = self.doubtful or self.low <= 0.0 <= self.high
        if max(abs(self.low), abs(self.high)) <= self.margin:
            return NONE if zero else SMALL
        return OPEN if zero else LARGE

    @property
    def text(self) -> str:
        """The difference and its interval."""
        return f"{signed(self.value)} ({signed(self.low)} to {signed(self.high)})"


def plain(x: float) -> str:
    """Three digits, without an exponent if that is short."""
    return f"{x:.3g}" if x == 0.0 or 1e-4 <= abs(x) < 1e3 else f"{x:.2g}" if abs(x) < 1e-4 else f"{x:.0f}"


def signed(x: float) -> str:
    """With its sign, unless it is 0."""
    return plain(x) if x == 0.0 else ("+" if x > 0.0 else "-") + plain(abs(x))


def percent(x: float) -> str:
    """A share in percent."""
    return f"{100 * x:.1f} %"


def reference_of(rows: Sequence[Mapping[str, Any]], study: Study) -> Mapping[str, Any]:
    """The row of the physics that the others are compared with."""
    return next(row for row in rows if row["physics"] == study.reference)


def hold_difference(row: Mapping[str, Any], study: Study) -> Difference:
    """Of hold success, in points; of few flips an exact sign test has to agree."""
    value, low, high = (100.0 * row[f"hold_difference{end}"] for end in ("", "_low", "_high"))
    return Difference(value, low, high, 100.0 * study.narrow_hold, row["sign_test_p"] > 0.05)


def return_difference(row: Mapping[str, Any], study: Study, reference: Mapping[str, Any]) -> Difference:
    """Of the mean return; if few episodes dominate a mean, its interval is not reliable."""
    value, low, high = (row[f"return_difference{end}"] for end in ("", "_low", "_high"))
    margin = study.narrow_return * abs(reference["mean_return"])
    return Difference(value, low, high, margin, 0 < row["half_from"] <= FEW)


def training_difference(row: Mapping[str, Any], study: Study) -> Difference:
    """Of hold success, in points, or mean return, after training under the cheap physics."""
    holds = row["measure"] == "hold_success"
    margin = 100 * study.narrow_hold if holds else study.narrow_return * abs(row["mean_preset"])
    value, low, high = ((100.0 if holds else 1.0) * row[end] for end in ("difference", "low", "high"))
    return Difference(value, low, high, margin, row["policies_each"] < FEW and row["permutation_p"] > 0.05)


def finding(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Which physics make a difference to the reference, in a sentence without its point."""
    reference, of_verdict = reference_of(rows, study), dict[str, list[str]]()
    for row in (row for row in rows if row is not reference):
        both = hold_difference(row, study), return_difference(row, study, reference)
        for verdict in {difference.verdict for difference in both}:
            of_verdict.setdefault(verdict, []).append(row["physics"])
    large, unsettled = of_verdict.get(LARGE, []), of_verdict.get(OPEN, [])
    parts = [f"{', '.join(large)} {'makes' if len(large) == 1 else 'make'} a difference"] * bool(large)
    parts += [f"{', '.join(unsettled)} may make a difference"] * bool(unsettled)
    return f"{' and '.join(parts) or 'no physics makes a difference beyond the margins'} to {study.reference}"


def verdict(results: Sequence[Any], study: Study) -> str:
    """What the physics costs the policies of all arms, in sentences."""
    sentences = [f"{arm.name}: {finding(arm.rows, study)}." for arm in results]
    for arm in (arm for arm in results if arm.training):
        found = training_difference(arm.training["hold_success"], study)
        trained = f"Training under {study.arms[arm.name].cheap} changes what {arm.name} holds under"
        what = f"{trained} {study.reference} by {found.text} points"
        sentences.append(f"{what}: {LOOKS[found.verdict][2]}.")
    return " ".join(sentences)


def conclusion(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Which physics make a difference to this policy, and which do not."""
    reference = reference_of(rows, study)
    others = [row for row in rows if row is not reference]
    lines = []
    holds = [hold_difference(row, study).verdict for row in others]
    returns = [return_difference(row, study, reference).verdict for row in others]
    for what, verdicts in (("Hold success", holds), ("Return", returns)):
        groups: dict[str, list[str]] = {}
        for row, verdict in zip(others, verdicts, strict=True):
            groups.setdefault(verdict, []).append(row["physics"])
        texts = (f"{text}: {', '.join(groups[v])}" for v, (_, _, text) in LOOKS.items() if v in groups)
        lines.append(f"{what} against {study.reference}: {'; '.join(texts)}.")
    if reference["hold_success"] == 0.0:
        lines.append("This policy holds nothing: judge by one that does.")
    return " ".join(lines)
