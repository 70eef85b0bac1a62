"""The page of all success rates with their 95 % intervals, from the tables in docs/results:
``python -m studies.results`` writes docs/results/README.md."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from redundant_envs.support.bounded import read_rows
from redundant_envs.support.disk import write_text
from redundant_envs.support.tables import markdown
from redundant_envs_train.evidence.runs import Group, read_groups, read_runs
from redundant_envs_train.evidence.table import results_of
from redundant_envs_train.statistics import MIN_RUNS, wilson

RESULTS = Path(__file__).parents[1] / "docs" / "results"
INTRODUCTION = f"""# Success rates and their 95 % intervals

`python -m studies.results` writes this page from the tables beside it. In brackets are 95 % intervals: those
of the goals by Wilson's method, which say what other goals would give the same policy, and those of the
seeds by a bootstrap of their interquartile mean (IQM), which say what other trainings would give; these are
unknown for fewer than {MIN_RUNS} seeds. Where two intervals of one kind do not overlap, the difference is
beyond that kind of chance. Controllers that are not trained, and experts, have no seeds.
"""
Rows = list[dict[str, str]]


def cell(rate: float, goals: int) -> str:
    """A rate in percent with its interval; below 1 it is never rounded up to 100 %."""
    low, high = (100.0 * end for end in wilson(round(rate * goals), goals))
    return f"{100.0 * rate if rate == 1.0 else min(100.0 * rate, 99.9):.1f} % [{low:.1f} to {high:.1f}]"


def rows_of(name: str) -> Rows:
    return [*read_rows(RESULTS / f"{name}.csv", "table")]


def learners_table(name: str) -> str:
    """A line for each group of the runs of a table."""
    heads = "environment", "learner", "seeds", "median seed", "worst seed", "IQM of the seeds", "expert"
    return markdown(heads, map(_line, read_groups([RESULTS / f"{name}.jsonl"])))


def _line(same: Group) -> tuple[str, ...]:
    goals = same.runs[0].evaluation["episodes"]
    held, expert = same.numbers("hold_success"), same.numbers("expert_hold_success")
    shown = results_of(same)["hold, IQM [95 % interval]"]
    rates = (cell(rate, goals) for rate in (statistics.median(held), min(held)))
    return same.title, same.learner, str(len(held)), *rates, shown, cell(statistics.median(expert), goals)


def runs_table(name: str) -> str:
    """A line for each run of a table, by its name, which tells how it differs from the others."""
    path, lines = RESULTS / f"{name}.jsonl", []
    for run in read_runs([path]):
        held, expert = (run.evaluation[f"{who}hold_success"] for who in ("", "expert_"))
        goals = run.evaluation["episodes"]
        lines.append((f"`{run.folder.relative_to(path)}`", cell(held, goals), cell(expert, goals)))
    return markdown(("run", "success", "expert"), lines, formatted=True)


def experts_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each task and arm of the study of redundancy."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for r in rows:
        shown = cell(float(r["success"]), int(r["episodes"]))
        found.setdefault((r["task"], r["arm"]), {})[r["controller"]] = shown
    heads = ("nearest pose", "expert")
    return markdown(
        ("task", "arm", *heads), [(*key, *(by[who] for who in heads)) for key, by in found.items()]
    )


def strengths_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each row of the study of strength, whose intervals of several seeds are the union of
    theirs."""
    lines = []
    for r in rows:
        rate, *ends = (f"{100.0 * float(r[name]):.1f}" for name in ("hold_success", "low", "high"))
        seeds = r["seeds"] if int(r["seeds"]) else "-"
        lines.append(
            (r["arm"], f"{float(r['factor']):g}", r["who"], seeds, f"{rate} % [{' to '.join(ends)}]")
        )
    return markdown(("arm", "limits times", "controller", "seeds", "goals held"), lines)


def ilqr_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each arm and strength of the study of iLQR."""
    lines = []
    for r in rows:
        goals, rest = int(r["goals"]), float(r["can_be_held"])
        parts = {"ilqr_of_those": round(rest * goals), "ilqr_of_others": round((1.0 - rest) * goals)}
        of = (cell(float(r[name]), count) if r[name] and count else "-" for name, count in parts.items())
        whole = (cell(float(r[name]), goals) for name in ("can_be_held", "ilqr"))
        lines.append((r["arm"], f"{float(r['factor']):g}", *whole, *of))
    heads = ("arm", "limits times", "can be held at rest", "iLQR, of all goals", "of these", "of the others")
    return markdown(heads, lines)


def tried_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each policy of the study of poses."""
    shown = [
        (f"`{r['run']}`", *(cell(float(r[c]), int(r["episodes"])) for c in ("held", "expert_held")))
        for r in rows
    ]
    return markdown(("run", "success", "expert"), shown, formatted=True)


def physics_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each arm and physics of the policy study."""
    lines = [(r["arm"], r["physics"], cell(float(r["hold_success"]), int(r["episodes"]))) for r in rows]
    return markdown(("arm", "physics", "goals held"), lines)


def trainings_table(rows: Iterable[Mapping[str, str]]) -> str:
    """A line for each training of the policy study."""
    columns = ("hold_success", "own_hold_success")
    lines = [
        (
            r["arm"],
            r["trained_under"],
            r["train_seed"],
            *(cell(float(r[c]), int(r["episodes"])) for c in columns),
        )
        for r in rows
    ]
    return markdown(("arm", "trained under", "seed", "under exact", "under its own"), lines)


def page() -> str:
    """The whole page."""
    sections = {
        "Presets, in [Learners](../learners.md) and the README": learners_table("runs"),
        "Stock algorithms, in [Learners](../learners.md#stock-algorithms)": learners_table("baselines"),
        "Parts of SAC, in [Learners](../learners.md)": runs_table("ablations"),
        "Modes of actions, in [Action modes](../action_modes.md)": runs_table("mode_runs"),
        "Redundancy: learners, in [What redundancy buys](../redundancy.md)": learners_table(
            "redundancy_runs"
        ),
        "Redundancy: experts, in [What redundancy buys](../redundancy.md)": experts_table(
            rows_of("redundancy")
        ),
        "[What was tried](tried.md)": tried_table(rows_of("tried")),
        "Weak motors: strengths, in [Where learning pays](../strength.md)": strengths_table(
            rows_of("strength/strength")
        ),
        "Weak motors: presets, in [Where learning pays](../strength.md)": learners_table("weak"),
        "Weak motors: iLQR, in [Where learning pays](../strength.md)": ilqr_table(rows_of("ilqr")),
        "Physics, in [What the physics costs a policy](policy/report.md)": physics_table(
            rows_of("policy/physics")
        ),
        "Training under other physics, in the [same report](policy/report.md)": trainings_table(
            rows_of("policy/training")
        ),
    }
    return "\n".join([INTRODUCTION, *(f"## {title}\n\n{table}\n" for title, table in sections.items())])


if __name__ == "__main__":
    write_text(RESULTS / "README.md", page())
    sys.stdout.write(f"{RESULTS / 'README.md'}\n")
