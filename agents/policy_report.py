"""The policy study in words, tables and figures; every sentence is written from the numbers."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.studies.plots import new_figure
from redundant_envs.studies.throughput import write_rows

from . import COMMAND
from .policy_study import FEW, TIMING_REPEATS, ArmResult, Row, Study, save_scenes, slug, stamp
from .statistics import wilson

PHYSICS_COLUMNS = (
    "arm", "env", "policy", "physics", "stepping", "reference", "episodes", "seed", "resamples",
    "hold_success", "hold_low", "hold_high", "hold_difference", "hold_difference_low",
    "hold_difference_high", "lost", "won", "sign_test_p", "mean_return", "return_difference",
    "return_difference_low", "return_difference_high", "median_abs_return_difference", "half_from",
    "ended", "control_steps", "numerics", "evaluations_per_step", "ns_per_step", "refused",
)  # fmt: skip
TRAINING_COLUMNS = (
    "arm", "env", "trained_under", "stepping", "train_seed", "env_steps", "train_seconds", "reference",
    "episodes", "seed", "hold_success", "mean_return", "ended", "own_hold_success", "own_mean_return",
    "own_ended",
)  # fmt: skip
DIFFERENCE_COLUMNS = (
    "arm", "env", "measure", "cheap", "policies_each", "mean_cheap", "mean_preset", "difference", "low",
    "high", "permutation_p", "reference", "resamples",
)  # fmt: skip

NONE, SMALL, OPEN, LARGE = "none", "small", "open", "large"
"""What an interval says: holds 0 within the margins; within them without 0; holds 0 and more; else."""
LOOKS = {  # Okabe and Ito's colours, and a shape each
    NONE: ("#0072B2", "o", "no measurable difference"),
    SMALL: ("#009E73", "s", "measurable, within the margin"),
    OPEN: ("#E69F00", "D", "not resolved"),
    LARGE: ("#D55E00", "^", "a difference"),
}


@dataclass(frozen=True)
class Difference:
    """A mean difference, its 95 % interval, and the margin (all in one unit) that counts as narrow.

    ``doubt`` says why the interval is not to be relied on; then it is taken to contain 0.
    """

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

    def sentence(self, what: str, unit: str = "") -> str:
        """What the interval says about it; the wording follows the verdict."""
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
    """Three digits, without an exponent where that is short."""
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


def hold_difference(row: Mapping[str, Any], study: Study) -> Difference:
    """Of hold success, in percentage points.

    Bootstrap intervals of few flips are too narrow; an exact test of the flips has to agree.
    """
    names = ("hold_difference", "hold_difference_low", "hold_difference_high")
    doubt = ""
    if row["sign_test_p"] > 0.05 and not row[names[1]] <= 0.0 <= row[names[2]]:
        doubt = (
            f"it leaves out 0, but {row['lost'] + row['won']} flips are few, and an exact sign test of "
            f"them gives p = {row['sign_test_p']:.2f}"
        )
    return difference_in(row, names, 100.0, 100.0 * study.narrow_hold, doubt)


def return_difference(row: Mapping[str, Any], study: Study, reference: Mapping[str, Any]) -> Difference:
    """Of the mean return; a mean that few episodes make has no interval to rely on."""
    names = ("return_difference", "return_difference_low", "return_difference_high")
    doubt = ""
    if 0 < row["half_from"] <= FEW and not row[names[1]] <= 0.0 <= row[names[2]]:
        doubt = f"it leaves out 0, but {row['half_from']} episodes make half of all the difference"
    return difference_in(row, names, 1.0, study.narrow_return * abs(reference["mean_return"]), doubt)


# ---- sentences -----------------------------------------------------------------------------------


def physics_sentence(row: Mapping[str, Any], reference: Mapping[str, Any], study: Study) -> str:
    """What a physics costs the policy."""
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
    parts += trouble(row)
    return f"**{row['physics']}**: {' '.join(parts)}"


def trouble(row: Mapping[str, Any]) -> list[str]:
    """What numerics did to the episodes, if anything."""
    parts = []
    if row["ended"]:
        parts.append(f"Numerics end {row['ended']} episodes early, which then count as not held.")
    if row["numerics"]:
        parts.append(f"Flags of numerics in {row['control_steps']} control steps: {row['numerics']}.")
    return parts


def conclusion(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Which physics make a difference to this policy, and which do not."""
    reference = next(row for row in rows if row["physics"] == study.reference)
    others = [row for row in rows if row is not reference and not row.get("refused")]
    if not others:
        return "There is nothing to compare the reference with."
    lines, same = [], {row["physics"] for row in others}
    for what, verdicts in (
        ("Hold success", [hold_difference(row, study).verdict for row in others]),
        ("Return", [return_difference(row, study, reference).verdict for row in others]),
    ):
        groups: dict[str, list[str]] = {}
        for row, verdict in zip(others, verdicts, strict=True):
            groups.setdefault(verdict, []).append(row["physics"])
        same &= set(groups.get(NONE, ()))
        words = "; ".join(
            f"{text}: {', '.join(groups[v])}" for v, (_, _, text) in LOOKS.items() if v in groups
        )
        lines.append(f"{what} against {study.reference}: {words}.")
    if reference["hold_success"] == 0.0:
        lines.append("This policy holds nothing: judge by one that does.")
    elif same:
        names = ", ".join(row["physics"] for row in others if row["physics"] in same)
        lines.append(
            "So accuracy makes no measurable difference to this policy between "
            f"{study.reference} and {names}."
        )
    return "\n\n".join(lines)


def training_sentence(row: Mapping[str, Any], study: Study) -> str:
    """What training under the cheap physics costs, for one measure."""
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


# ---- tables --------------------------------------------------------------------------------------


def physics_table(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Markdown table, a row per physics."""
    reference = next(row for row in rows if row["physics"] == study.reference)
    lines = [
        f"| physics | stepped by | hold success | minus {study.reference}, points | held only there, here "
        f"| mean return | minus {study.reference} | median of abs. differences | ended early "
        "| evaluations per control step | ns per control step |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        if row.get("refused"):
            lines.append(f"| {row['physics']} | cannot | | | | | | | | | |")
            continue
        hold, gain = "reference", "reference"
        if row is not reference:
            h, g = hold_difference(row, study), return_difference(row, study, reference)
            hold, gain = (f"{signed(d.value)} ({signed(d.low)} to {signed(d.high)})" for d in (h, g))
        lines.append(
            f"| {row['physics']} | {row['stepping']} | {percent(row['hold_success'])} | {hold} "
            f"| {row['lost']}, {row['won']} | {row['mean_return']:.2f} | {gain} "
            f"| {plain(row['median_abs_return_difference'])} | {row['ended']} "
            f"| {plain(row['evaluations_per_step'])} | {row['ns_per_step']:.0f} |"
        )
    return "\n".join(lines)


def training_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Markdown table, a row per trained policy."""
    reference = rows[0]["reference"]
    lines = [
        f"| trained under | stepped by | seed | hold success under {reference} | mean return under "
        f"{reference} | hold success under its own | mean return under its own | ended early under its own "
        "| train seconds |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['trained_under']} | {r['stepping']} | {r['train_seed']} | {percent(r['hold_success'])} "
        f"| {r['mean_return']:.2f} | {percent(r['own_hold_success'])} "
        f"| {r['own_mean_return']:.2f} | {r['own_ended']} | {r['train_seconds']:.0f} |"
        for r in sorted(rows, key=lambda r: r["trained_under"] == "preset")
    ]
    return "\n".join(lines)


# ---- figures -------------------------------------------------------------------------------------


def figure(result: ArmResult, study: Study, about: Mapping[str, str]) -> Any:
    """Differences of hold success and return from the reference, with intervals, per physics."""
    reference = next(row for row in result.rows if row["physics"] == study.reference)
    rows = [row for row in result.rows if row is not reference and not row.get("refused")]
    drawn = new_figure(2.4 + 0.45 * len(rows))
    panels = drawn.subplots(1, 2, sharey=True)
    holds = [hold_difference(row, study) for row in rows]
    returns = [return_difference(row, study, reference) for row in rows]
    _draw(panels[0], f"hold success minus {study.reference}, points", holds)
    _draw(panels[1], f"mean return minus {study.reference}", returns)
    names = [f"{row['physics']}\n{percent(row['hold_success'])} held" for row in rows]
    panels[0].set_yticks(range(len(rows)), names)
    panels[0].set_ylim(len(rows) - 0.5, -0.7)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    seen = {d.verdict for d in (*holds, *returns)}
    handles: list[Any] = [
        Line2D([], [], color=color, marker=marker, lw=2.0, label=text)
        for key, (color, marker, text) in LOOKS.items()
        if key in seen
    ]
    handles.append(Patch(color="0.92", label="margin"))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    drawn.suptitle(
        f"{result.name}: one policy, {reference['episodes']} paired episodes, 95 % bootstrap intervals\n"
        f"{study.reference}: {percent(reference['hold_success'])} held, mean return "
        f"{reference['mean_return']:.2f}\n"
        f"{about['machine']}, {about['date']}, commit {about['commit'] or 'unknown'}",
        fontsize=9, x=0.01, ha="left",
    )  # fmt: skip
    return drawn


def _draw(panel: Any, label: str, differences: Sequence[Difference]) -> None:
    """Intervals below each other; beyond the margin the axis is logarithmic if it must be."""
    margin = max((d.margin for d in differences), default=1.0)
    widest = max((abs(end) for d in differences for end in (d.low, d.high)), default=0.0)
    panel.axvspan(-margin, margin, color="0.92", lw=0)
    panel.axvline(0.0, color="0.4", lw=0.8)
    for y, d in enumerate(differences):
        color, marker, _ = LOOKS[d.verdict]
        panel.plot([d.low, d.high], [y, y], color=color, lw=2.0, solid_capstyle="butt")
        panel.plot(d.value, y, marker, color=color, ms=6)
        panel.annotate(
            signed(d.value), (d.value, y), (0, 7), textcoords="offset points", ha="center", fontsize=8,
            bbox={"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 0.6},
        )  # fmt: skip
    edge = max(1.15 * widest, 1.4 * margin)
    if widest > 10.0 * margin:
        edge = 4.0 * widest
        panel.set_xscale("symlog", linthresh=margin, linscale=1.0)
        first = math.ceil(math.log10(margin) - 1e-9)
        ticks = [10.0**k for k in range(first, math.floor(math.log10(edge)) + 1)]
        ticks = [*(-t for t in reversed(ticks)), 0.0, *ticks]
        panel.set_xticks(ticks, [f"{t:g}" for t in ticks])
        panel.set_xticks([], minor=True)
        label += f"\n(logarithmic beyond ±{plain(margin)})"
    panel.set_xlim(-edge, edge)
    panel.set_xlabel(label, fontsize=8.5)
    panel.tick_params(labelsize=8)
    panel.spines[["top", "right"]].set_visible(False)


def save_figure(drawn: Any, path: Path) -> None:
    """As PNG and SVG; the same numbers give the same files."""
    import matplotlib

    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context({"svg.hashsalt": "redundant-envs", "svg.fonttype": "path"}):
        drawn.savefig(path.with_suffix(".svg"), metadata={"Date": None, "Creator": None})
    memory = io.BytesIO()
    drawn.savefig(memory, format="png", dpi=150, metadata={"Software": None})
    path.with_suffix(".png").write_bytes(memory.getvalue())


# ---- the folder ----------------------------------------------------------------------------------


def write_report(study: Study, results: Sequence[ArmResult], folder: Path) -> Path:
    """Write tables, figures, scenes and report.md of a study."""
    about = stamp()
    save_scenes(study, results, folder)
    _write(folder / "physics.csv", [r for a in results for r in a.rows], PHYSICS_COLUMNS, about)
    trained = [r for a in results for r in a.trained]
    if trained:
        _write(folder / "training.csv", trained, TRAINING_COLUMNS, about)
        differences = [r for a in results for r in a.training.values()]
        _write(folder / "training_differences.csv", differences, DIFFERENCE_COLUMNS, about)
    for result in results:
        _write_episodes(folder / f"episodes_{slug(result.name)}.csv", result, study, about)
        save_figure(figure(result, study, about), folder / "figures" / slug(result.name))
    target = folder / "report.md"
    target.write_text(report_text(study, results, about), encoding="utf-8")
    return target


def report_text(study: Study, results: Sequence[ArmResult], about: Mapping[str, str]) -> str:
    """report.md."""
    last = study.seed + study.episodes - 1
    lines = [
        "# What the physics costs a policy", "",
        ", ".join(f"{k} {v}" for k, v in about.items() if v) + ".", "",
        f"One trained policy per arm, deterministic, in the same {study.episodes} episodes (seeds "
        f"{study.seed} to {last}, used for nothing else) under each physics: equal starts and goals, "
        "checked to the bit. Task, reward and motors are the same; only the stepping of the scene "
        f"differs. Differences are taken episode by episode from `{study.reference}`; intervals are the "
        f"middle 95 % of {study.resamples} bootstrap resamples of the episodes. They tell what other "
        "episodes would give this policy, not what another policy would get. About one in twenty such "
        "intervals misses its true value, so one that just misses 0 among so many is no evidence. "
        f"Margins, chosen before: {percent(study.narrow_hold)} of the episodes for hold success, "
        f"{percent(study.narrow_return)} of the reference's mean return.", "",
        "ns per control step: the compiled environment step (motors, physics, reward, observation) of "
        f"one lane on one core, on the policy's own actions, the best of {TIMING_REPEATS} of each step. "
        "Evaluations: of the equations of motion, per control step.", "",
    ]  # fmt: skip
    for result in results:
        lines += _arm_text(result, study)
    lines += [
        "## Files", "",
        f"* `study.yaml`: what was asked for. Again: `{COMMAND} study policy --config FOLDER/study.yaml`.",
        "* `physics.csv`: the tables of the first part, a row per arm and physics.",
        "* `episodes_<arm>.csv`: every episode under every physics, with its goal.",
        "* `figures/`: the differences and their intervals, PNG and SVG.",
        "* `scenes/`: the scenes as they were simulated; `python -m redundant_envs scene FILE --source` "
        "prints the simulator of one.",
        *(["* `training.csv`, `training_differences.csv`: the second part."] if study.train_seeds else []),
    ]  # fmt: skip
    if study.train_seeds or not all(arm.run for arm in study.arms.values()):
        lines.append(
            f"* `runs/`: the policies that the study trained; `{COMMAND} report FOLDER` completes one."
        )
    return "\n".join([*lines, ""])


def _arm_text(result: ArmResult, study: Study) -> list[str]:
    rows = result.rows
    reference = next(row for row in rows if row["physics"] == study.reference)
    lines = [
        f"## {result.name}", "",
        f"{result.env}; the policy: {result.policy}.", "",
        conclusion(rows, study), "",
        f"![{result.name}](figures/{slug(result.name)}.png)", "",
        physics_table(rows, study), "",
        *(f"* {physics_sentence(row, reference, study)}" for row in rows if row is not reference), "",
    ]  # fmt: skip
    if trouble(reference):
        lines += [f"**{study.reference}** itself: {' '.join(trouble(reference))}", ""]
    if result.trained:
        cheap = study.arms[result.name].cheap
        changed = f", with {', '.join(study.train_overrides)}" if study.train_overrides else ""
        lines += [
            f"### {result.name}: trained under {cheap}, evaluated under {study.reference}", "",
            f"{study.train_seeds} policies trained under {cheap} and {study.train_seeds} with the same "
            f"seeds under the preset's own physics{changed}, all in the same episodes as above. Intervals "
            "are over the policies, resampled within each group.", "",
            training_table(result.trained), "",
            *(f"* {training_sentence(row, study)}" for row in result.training.values()), "",
        ]  # fmt: skip
    return lines


def _write(path: Path, rows: Sequence[Row], columns: Sequence[str], about: Mapping[str, str]) -> None:
    write_rows([{**about, **_short(row)} for row in rows], (*about, *columns), path)


def _short(row: Row) -> Row:
    """Floats with 8 digits."""
    return {k: float(f"{v:.8g}") if isinstance(v, float) else v for k, v in row.items()}


def _write_episodes(path: Path, result: ArmResult, study: Study, about: Mapping[str, str]) -> None:
    any_one = result.episodes[study.reference]
    names = ["seed", "goal_x", "goal_y"]
    columns = [study.seed + np.arange(len(any_one.hold)), *any_one.goal.T]
    for label, e in result.episodes.items():
        names += [f"{slug(label)}_{k}" for k in ("hold", "return", "steps", "ended")]
        columns += [e.hold, e.returns, e.steps, e.ended]
    rows = [
        {
            n: (int(v) if float(v).is_integer() else round(float(v), 9))
            for n, v in zip(names, line, strict=True)
        }
        for line in zip(*columns, strict=True)
    ]
    write_rows(rows, names, path)
    stamped = f"# {', '.join(f'{k} {v}' for k, v in about.items())}\n"
    path.write_text(stamped + path.read_text(encoding="utf-8"), encoding="utf-8")


def _number(x: Any) -> float:
    """Whole numbers and flags without a point."""
    return int(x) if float(x).is_integer() else round(float(x), 9)
