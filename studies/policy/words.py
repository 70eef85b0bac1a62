"""The results of the policy study in words; every sentence is generated from the numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from redundant_envs_train.statistics import wilson

from .episodes import FEW
from .settings import Study

NONE, SMALL, OPEN, LARGE = "none", "small", "open", "large"
"""Verdicts on an interval: contains 0 within the margins; within them without 0; contains 0 and more;
else."""
LOOKS = {  # Okabe and Ito's colours, and a shape each
    NONE: ("#0072B2", "o", "no measurable difference"),
    SMALL: ("#009E73", "s", "measurable, within the margin"),
    OPEN: ("#E69F00", "D", "not resolved"),
    LARGE: ("#D55E00", "^", "a difference"),
}


@dataclass(frozen=True)
class Difference:
    """A mean difference, its 95 % interval, and the margin that counts as narrow, in one unit. ``doubt`` says
    why the interval is not reliable; then it is taken to contain 0."""

    value: float
    low: float
    high: float
    margin: float
    doubt: str = ""

    @property
    def verdict(self) -> str:
        """One of NONE, SMALL, OPEN, LARGE."""
        zero = bool(self.doubt) or self.low <= 0.0 <= self.high
        if max(abs(self.low), abs(self.high)) <= self.margin:
            return NONE if zero else SMALL
        return OPEN if zero else LARGE

    @property
    def text(self) -> str:
        """The difference and its interval."""
        return f"{signed(self.value)} ({signed(self.low)} to {signed(self.high)})"

    def sentence(self, what: str, unit: str = "") -> str:
        """The sentence about a difference; the wording follows the verdict."""
        interval = f"95 % interval {signed(self.low)} to {signed(self.high)}"
        value, size = amount(signed(self.value), unit), amount(plain(abs(self.value)), unit)
        margin, width = amount(plain(self.margin), unit), amount(plain(self.high - self.low), unit)
        direction = "higher" if self.value > 0.0 else "lower"
        zero = self.doubt or "it contains 0"
        return {
            NONE: f"{what}: no measurable difference ({value}, {interval}, {width} wide: {zero}).",
            SMALL: f"{what}: measurably {direction}, but by less than {margin} ({value}, {interval}).",
            OPEN: f"{what}: not resolved ({value}, {interval}: {zero} and reaches beyond {margin}).",
            LARGE: f"{what}: {direction} by {size} ({interval}).",
        }[self.verdict]


def plain(x: float) -> str:
    """Three digits, without an exponent if that is short."""
    return f"{x:.3g}" if x == 0.0 or 1e-4 <= abs(x) < 1e3 else f"{x:.2g}" if abs(x) < 1e-4 else f"{x:.0f}"


def signed(x: float) -> str:
    """With its sign, unless it is 0."""
    return plain(x) if x == 0.0 else ("+" if x > 0.0 else "-") + plain(abs(x))


def amount(number: str, unit: str) -> str:
    """A number with its unit: "2 points", "1 point"."""
    return f"{number} {unit.removesuffix('s') if number.lstrip('+-') == '1' else unit}".rstrip()


def percent(x: float) -> str:
    """A share in percent."""
    return f"{100 * x:.1f} %"


def difference_in(
    row: Mapping[str, Any], names: Sequence[str], scale: float, margin: float, doubt: str = ""
) -> Difference:
    """A difference from the names of its value and of both ends of its interval."""
    value, low, high = (scale * float(row[name]) for name in names)
    return Difference(value, low, high, margin, doubt)


def reference_of(rows: Sequence[Mapping[str, Any]], study: Study) -> Mapping[str, Any]:
    """The row of the physics that the others are compared with."""
    return next(row for row in rows if row["physics"] == study.reference)


def hold_difference(row: Mapping[str, Any], study: Study) -> Difference:
    """Of hold success, in points; as bootstrap intervals of few flips are too narrow, an exact test has to
    agree."""
    names = ("hold_difference", "hold_difference_low", "hold_difference_high")
    doubt = ""
    if row["sign_test_p"] > 0.05 and not row[names[1]] <= 0.0 <= row[names[2]]:
        doubt = (
            f"it leaves out 0, but {row['lost'] + row['won']} flips are few, and an exact sign test of "
            f"them gives p = {row['sign_test_p']:.2f}"
        )
    return difference_in(row, names, 100.0, 100.0 * study.narrow_hold, doubt)


def return_difference(row: Mapping[str, Any], study: Study, reference: Mapping[str, Any]) -> Difference:
    """Of the mean return; if few episodes dominate a mean, its interval is not reliable."""
    names = ("return_difference", "return_difference_low", "return_difference_high")
    doubt = ""
    if 0 < row["half_from"] <= FEW and not row[names[1]] <= 0.0 <= row[names[2]]:
        doubt = f"it leaves out 0, but {row['half_from']} episodes make half of all the difference"
    return difference_in(row, names, 1.0, study.narrow_return * abs(reference["mean_return"]), doubt)


def physics_sentence(row: Mapping[str, Any], reference: Mapping[str, Any], study: Study) -> str:
    """The effect of a physics on the policy."""
    if row.get("refused"):
        return f"**{row['physics']}**: this arm cannot be stepped so: {row['refused']}"
    n, flips = row["episodes"], row["lost"] + row["won"]
    if row["hold_success"] == reference["hold_success"] == 0.0:
        parts = ["Hold success: the policy holds nothing under either, which says nothing."]
    elif not flips:
        parts = [
            f"Hold success: no measurable difference: not one of {n} episodes changes between held and not "
            f"held (up to {percent(wilson(0, n)[1])} of all could, unseen)."
        ]
    else:
        parts = [
            hold_difference(row, study).sentence("Hold success", "points"),
            f"Of {n} episodes, held only under {row['reference']}: {row['lost']}, only here: {row['won']}.",
        ]
    parts.append(return_difference(row, study, reference).sentence("Return"))
    half, few = plain(row["median_abs_return_difference"]), row["half_from"]
    parts.append(
        f"Half of the episodes differ by {half} or less; {few} {'makes' if few == 1 else 'make'} half of all "
        "the difference."
    )
    return f"**{row['physics']}**: {' '.join([*parts, *trouble(row)])}"


def trouble(row: Mapping[str, Any]) -> list[str]:
    """The effect of numerics on the episodes, if there is any."""
    parts = []
    if row["ended"]:
        parts.append(f"Numerics end {row['ended']} episodes early, which then count as not held.")
    if row["numerics"]:
        parts.append(f"Flags of numerics in {row['control_steps']} control steps: {row['numerics']}.")
    return parts


def conclusion(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Which physics make a difference to this policy, and which do not."""
    reference = reference_of(rows, study)
    others = [row for row in rows if row is not reference and not row.get("refused")]
    if not others:
        return "There is nothing to compare the reference with."
    lines, same = [], {row["physics"] for row in others}
    holds = [hold_difference(row, study).verdict for row in others]
    returns = [return_difference(row, study, reference).verdict for row in others]
    for what, verdicts in (("Hold success", holds), ("Return", returns)):
        groups: dict[str, list[str]] = {}
        for row, verdict in zip(others, verdicts, strict=True):
            groups.setdefault(verdict, []).append(row["physics"])
        same &= set(groups.get(NONE, ()))
        found = (f"{text}: {', '.join(groups[v])}" for v, (_, _, text) in LOOKS.items() if v in groups)
        lines.append(f"{what} against {study.reference}: {'; '.join(found)}.")
    if reference["hold_success"] == 0.0:
        lines.append("This policy holds nothing: judge by one that does.")
    elif same:
        names = ", ".join(row["physics"] for row in others if row["physics"] in same)
        which = f"{study.reference} and {names}"
        lines.append(f"So accuracy makes no measurable difference to this policy between {which}.")
    return "\n\n".join(lines)


def training_sentence(row: Mapping[str, Any], study: Study) -> str:
    """The effect of training under the cheap physics, for one measure."""
    if row["measure"] == "hold_success":
        scale, margin, unit, what = 100.0, 100 * study.narrow_hold, "points", "Hold success"
    else:
        scale, margin, unit, what = 1.0, study.narrow_return * abs(row["mean_preset"]), "", "Return"
    n, doubt = row["policies_each"], ""
    if n < FEW and row["permutation_p"] > 0.05 and not row["low"] <= 0.0 <= row["high"]:
        doubt = f"it leaves out 0, but an exact permutation test gives p = {row['permutation_p']:.2f}"
    d = difference_in(row, ("difference", "low", "high"), scale, margin, doubt)
    text = d.sentence(
        f"{what} under {row['reference']} after training under {row['cheap']}, against the preset's own", unit
    )
    if n < FEW:
        text += f" {n} policies against {n} are few: such an interval is too narrow rather than too wide."
    return text
