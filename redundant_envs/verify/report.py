"""All checks of some subjects, and their table as text and JSON; the command."""

import json
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from redundant_envs.support import tables
from redundant_envs.support.disk import write_text
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.values import say
from redundant_envs.verify import (
    accuracy,
    bits,
    conservation,
    engines,
    environments,
    equations,
    evaluators,
    forces,
    hints,
    impacts,
    kinematics,
    recorded_bits,
    symmetries,
)
from redundant_envs.verify.checks import STATES, Check, Outcome, Sample, checks_of
from redundant_envs.verify.promises import Mode, Verdict
from redundant_envs.verify.subjects import Subject, kind_of, subject_from, subjects_of

CHECKS: tuple[Check, ...] = checks_of(
    equations, kinematics, forces, hints, conservation, symmetries, accuracy, impacts,
    bits, evaluators, engines, environments,
)  # fmt: skip
"""All checks, in the order of the table. A new one is a function in one of these modules."""
COLUMNS = ("check", "found", "promised", "", "where")


@dataclass(frozen=True)
class Report:
    """The outcomes of checks."""

    outcomes: tuple[Outcome, ...]

    @property
    def misses(self) -> tuple[str, ...]:
        """The faults, in words."""
        return tuple(f"{o.check}: {o.finding.words}" for o in self.outcomes if o.verdict is Verdict.MISSED)

    @property
    def good(self) -> bool:
        """Whether no promise is missed."""
        return not self.misses


def checks_in(mode: Mode) -> list[Check]:
    return [c for c in CHECKS if c.mode <= mode]


def verify(
    thing: Any,
    states: int | None = None,
    mode: Mode = Mode.STANDARD,
    done: Callable[[str], None] = lambda name: None,
    checks: Iterable[Check] | None = None,
) -> Report:
    """Check an arm, a scene, an effect, a task, a class of these, or a :class:`Subject` in a number of random
    states, and by checks, that follow from the mode unless given; ``done`` receives the name of each check
    when it is done."""
    subject = subject_from(kind_of(thing).__name__, thing)
    trial = Sample(subject, STATES[mode] if states is None else states)
    outcomes = []
    for one in checks_in(mode) if checks is None else checks:
        outcomes.append(one.run(trial))
        done(f"{subject.name}: {one.name}")
    return Report(tuple(outcomes))


def about(subject: Subject) -> str:
    """Description of a subject, in one line."""
    scene = subject.scene
    step = f"{scene.integrator} {1000.0 * scene.control_dt / scene.substeps:.3g} ms"
    if scene.tolerance is not None or scene.integrator == "dop853":
        to = "" if scene.tolerance is None else f" to {scene.tolerance:g} m"
        step = f"{scene.integrator}{to} in {1000.0 * scene.control_dt:.3g} ms"
    effects = ", ".join(type(x).__name__ for x in scene.effects) or "no effects"
    return f"{subject.name}: {scene.robot.kind}, {effects}; {step}"


def cells(outcome: Outcome) -> tuple[str, str, str, str, str]:
    """A line of the table."""
    finding, promise = outcome.finding, outcome.promise
    value = "" if math.isnan(finding.found) else f"{finding.found:.3g}"
    if outcome.verdict is Verdict.MEASURED and promise.unit:
        value += f" {promise.unit.partition(',')[0]}"
    promised = str(promise) if outcome.verdict is not Verdict.MEASURED else promise.unit.partition(", ")[2]
    return outcome.check, value, promised, outcome.verdict.value, finding.where


def text_table(outcomes: Iterable[Outcome]) -> str:
    """Outcomes as text in aligned columns; checks that are not applicable are listed below, by reason."""
    left: defaultdict[str, Counter[str]] = defaultdict(Counter)
    shown = []
    for o in outcomes:
        if o.verdict is Verdict.NOT_APPLICABLE:
            left[o.finding.words][o.check.partition(": ")[0]] += 1
        else:
            shown.append(o)
    lines = [tables.table(COLUMNS, map(cells, shown), "<")]
    for reason, kinds in left.items():
        names = ", ".join(kind if n == 1 else f"{kind} ({n} checks)" for kind, n in kinds.items())
        lines.append(f"not applicable, {reason}: {names}")
    return "\n".join(lines)


def notes(outcomes: Iterable[Outcome]) -> list[str]:
    """Faults, and advice for the reader, in words."""
    missed = [f"MISSED: {o.check}: {o.finding.words}" for o in outcomes if o.verdict is Verdict.MISSED]
    return missed + [o.finding.words for o in outcomes if o.verdict is Verdict.MEASURED and o.finding.words]


def as_json(reports: Iterable[tuple[str, Report]]) -> str:
    """All outcomes as JSON; numbers that JSON cannot represent are null."""

    def plain(o: Outcome) -> dict[str, Any]:
        return {
            "check": o.check, "family": o.family, "verdict": o.verdict.value,
            "found": o.finding.found, "bound": o.promise.bound,
            "relation": o.promise.relation, "unit": o.promise.unit, "where": o.finding.where,
            "words": "" if o.verdict is Verdict.KEPT else o.finding.words,
        }  # fmt: skip

    subjects = [{"subject": title, "outcomes": [plain(o) for o in r.outcomes]} for title, r in reports]
    text = json.dumps({**versions(), "good": all(r.good for _, r in reports), "subjects": subjects})
    return json.dumps(json.loads(text, parse_constant=lambda _: None), indent=1) + "\n"


def run(words: Sequence[str], states: int | None, mode: str, json_file: Path | None) -> int:
    """Verify subjects and print tables; returns 1 if a promise is broken."""
    subjects, chosen, reports = subjects_of(words), Mode[mode.upper()], list[tuple[str, Report]]()
    checks = len(checks_in(chosen))
    with counted("verify", checks * len(subjects), checks) as done:
        for subject in subjects:
            title, report = about(subject), verify(subject, states, chosen, done)
            reports.append((title, report))
            say(f"{title}\n{text_table(report.outcomes)}")
            for note in notes(report.outcomes):
                say(f"  {subject.name}: {note}")
            say(flush=True)
    if json_file is not None:
        write_text(json_file, as_json(reports))
    missed = sum(len(r.misses) for _, r in reports)
    num_kept = sum(o.verdict is Verdict.KEPT for _, r in reports for o in r.outcomes)
    say(f"{num_kept} promises kept, {missed} missed")
    if missed:
        say(f"redundant_envs: verify found {missed} broken promise{'s'[: missed > 1]}", file=sys.stderr)
    return int(missed > 0)


def compare_bits(everything: bool) -> int:
    """Print whether recorded motions have the same bits on this machine; returns 1 if one differs."""
    names = list(recorded_bits.RECORDED if everything else recorded_bits.SHORT)
    with counted("recorded bits", len(names)) as done:
        other = recorded_bits.differing(names, done)
    for name in other:
        say(f"{name}: other bits")
    say(f"{len(names) - len(other)} of {len(names)} recorded motions have the same bits on this machine")
    return int(bool(other))
