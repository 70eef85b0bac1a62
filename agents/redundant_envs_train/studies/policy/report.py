"""Folder of a policy study: tables, figures, scenes and report.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.figures import save_figure
from redundant_envs.tables import markdown, write_rows

from ... import COMMAND
from ...pages import page
from .episodes import TIMING_REPEATS
from .figure import figure
from .run import ArmResult, Row, save_scenes, stamp
from .settings import Study, slug
from .words import (
    conclusion,
    hold_difference,
    percent,
    physics_sentence,
    plain,
    return_difference,
    signed,
    training_sentence,
    trouble,
)  # fmt: skip

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


def physics_table(rows: Sequence[Mapping[str, Any]], study: Study) -> str:
    """Markdown table, a row per physics."""
    reference = next(row for row in rows if row["physics"] == study.reference)
    minus, lines = f"minus {study.reference}", []
    for row in rows:
        if row.get("refused"):
            lines.append((row["physics"], "cannot", *[""] * 9))
            continue
        hold, gain = "reference", "reference"
        if row is not reference:
            h, g = hold_difference(row, study), return_difference(row, study, reference)
            hold, gain = (f"{signed(d.value)} ({signed(d.low)} to {signed(d.high)})" for d in (h, g))
        lines.append(
            (
                row["physics"], row["stepping"], percent(row["hold_success"]), hold,
                f"{row['lost']}, {row['won']}", f"{row['mean_return']:.2f}", gain,
                plain(row["median_abs_return_difference"]), row["ended"], plain(row["evaluations_per_step"]),
                f"{row['ns_per_step']:.0f}",
            )
        )  # fmt: skip
    head = (
        "physics", "stepped by", "hold success", f"{minus}, points", "held only there, here", "mean return",
        minus, "median of abs. differences", "ended early", "evaluations per control step",
        "ns per control step",
    )  # fmt: skip
    return markdown(head, lines)


def training_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Markdown table, a row per trained policy."""
    reference = rows[0]["reference"]
    head = (
        "trained under", "stepped by", "seed", f"hold success under {reference}",
        f"mean return under {reference}", "hold success under its own", "mean return under its own",
        "ended early under its own", "train seconds",
    )  # fmt: skip
    lines = (
        (r["trained_under"], r["stepping"], r["train_seed"], percent(r["hold_success"]),
         f"{r['mean_return']:.2f}", percent(r["own_hold_success"]), f"{r['own_mean_return']:.2f}",
         r["own_ended"], f"{r['train_seconds']:.0f}")
        for r in sorted(rows, key=lambda r: r["trained_under"] == "preset")
    )  # fmt: skip
    return markdown(head, lines)


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
        drawn = figure(result, study, about)
        for kind in ("svg", "png"):
            save_figure(drawn, folder / "figures" / f"{slug(result.name)}.{kind}", dpi=150)
    target = folder / "report.md"
    target.write_text(report_text(study, results, about), encoding="utf-8")
    return target


def report_text(study: Study, results: Sequence[ArmResult], about: Mapping[str, str]) -> str:
    """report.md."""
    parts = []
    for result in results:
        reference = next(row for row in result.rows if row["physics"] == study.reference)
        parts.append((result, reference, [row for row in result.rows if row is not reference]))
    return page(
        "policy_study", study=study, results=parts,
        about=", ".join(f"{k} {v}" for k, v in about.items() if v), repeats=TIMING_REPEATS, command=COMMAND,
        all_given=all(arm.run for arm in study.arms.values()),
        **{f.__name__: f for f in (
            conclusion, percent, physics_sentence, physics_table, slug, training_sentence, training_table,
            trouble,
        )},
    )  # fmt: skip


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
        {name: _number(value) for name, value in zip(names, line, strict=True)}
        for line in zip(*columns, strict=True)
    ]
    write_rows(rows, names, path)
    stamped = f"# {', '.join(f'{k} {v}' for k, v in about.items())}\n"
    path.write_text(stamped + path.read_text(encoding="utf-8"), encoding="utf-8")


def _number(x: Any) -> float:
    """Whole numbers and flags without a point."""
    return int(x) if float(x).is_integer() else round(float(x), 9)
