"""The accuracy study as files: tables, figures, and a page with one line for the cost of each error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from redundant_envs.support.disk import write_text
from redundant_envs.support.extras import INSTALL, needs
from redundant_envs.support.tables import markdown, write_rows
from redundant_envs_train.pages import page
from studies import accuracy, accuracy_plots
from studies.accuracy import Answer, PanelResult, Row
from studies.accuracy_config import PEERS, Study
from studies.accuracy_long import PATH_SECONDS, error_names
from studies.accuracy_methods import brief

LONG_HEADS = {
    "energy_rate": "energy",
    "momentum": "momentum",
    "penetration_mm": "beyond a stop, mm",
    "impact_time_s": "first impact, s",
}
"""Metric -> its heading; a metric that no row has is left out."""


def duration(nanoseconds: float) -> str:
    """Three digits with a fitting unit: "35.2 ns", "3.41 us", "1.36 ms"."""
    for unit, size in (("ns", 1.0), ("us", 1e3)):
        if nanoseconds < 999.5 * size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds / 1e6:.3g} ms"


def who(row: Row | None) -> list[str]:
    """A configuration, its cost and its evaluations; "not reached" if there is none."""
    if row is None:
        return ["not reached", "", ""]
    return [f"{row['method']}, {row['setting']}", duration(row["ns_best"]), f"{row['evaluations']:g}"]


def advantage(answer: Answer, bar: float | None) -> str:
    """The ratio of costs, and whether it reaches the goal."""
    if math.isnan(answer.ratio):
        return ""
    if bar is None:
        return f"{answer.ratio:.0f} x"
    return f"{answer.ratio:.0f} x ({'above' if answer.ratio >= bar else '**below**'} {bar:g})"


def answer_table(study: Study, results: Sequence[PanelResult]) -> str:
    """Lines with an arm, an error and its cost."""
    cost = f"{1e3 * study.control_dt:g} ms cost"
    head = ["arm", "99 % of states within", "our cheapest", cost, "evaluations"]
    head += ["MuJoCo's cheapest", cost, "evaluations", "we are cheaper by"]
    lines = []
    for result in results:
        run = any(row["peer"] == "mujoco" for row in result.rows)
        for answer in accuracy.answers(result.rows, study.thresholds_mm):
            theirs = who(answer.mujoco) if run else ["not run", "", ""]
            of = result.panel.name, f"{brief(answer.threshold_mm)} mm"
            lines.append([*of, *who(answer.ours), *theirs, advantage(answer, result.panel.bar)])
    return markdown(head, lines)


def reference_table(results: Sequence[PanelResult]) -> str:
    """Accuracy of the reference, a line for each panel and check."""
    head = ["arm", "compared with", "states", "largest difference of the tips", "digits that agree"]
    lines = [
        [result.panel.name, a.by, str(a.states), f"{1e3 * a.metres:.1e} mm", f"{a.digits:.1f}"]
        for result in results
        for a in result.agreements
    ]
    return markdown(head, lines)


def long_table(study: Study, results: Sequence[PanelResult]) -> str:
    """Long motions: all of MuJoCo's, and those of ours that an answer names."""
    heads = {f"tip_mm_{name}": after(name) for name in error_names(study)}
    found = {key for result in results for row in result.long_rows for key in row}
    heads |= {name: head for name, head in LONG_HEADS.items() if f"{name}_median" in found}
    head, lines = ["arm", "configuration", *heads.values()], []
    for result in results:
        cheapest = [a.ours for a in accuracy.answers(result.rows, study.thresholds_mm) if a.ours]
        named = {(row["method"], row["setting"]) for row in cheapest}
        for row in result.long_rows:
            who = row["method"], row["setting"]
            if row["peer"] or who in named:
                values = (row.get(f"{name}_median") for name in heads)
                cells = ("" if x is None else f"{x:.0e}" for x in values)
                lines.append([result.panel.name, ", ".join(who), *cells])
    return markdown(head, lines)


def after(name: str) -> str:
    """ "1_s" -> "tip, 1 s, mm"; "2_lyapunov" -> "2 Lyapunov times"."""
    count, _, unit = name.partition("_")
    text = "s" if unit == "s" else "Lyapunov time" + ("s" if count != "1" else "")
    return f"tip after {count} {text}, mm"


def page_text(study: Study, results: Sequence[PanelResult], command: str, figures: Sequence[Path]) -> str:
    """The page, of a command and with pictures of the same folder."""
    stamp = results[0].rows[0]
    packages = (f"{name} {stamp[name]}" for name in ("python", "llvmlite", "numpy", *PEERS) if stamp[name])
    free = {r.panel.name: r.free for r in results if r.free is not None}
    doubts = [x for motions in free.values() for x in motions.doubt.values()]
    return page(
        "accuracy", Path(__file__).parent, study=study, command=command, stamp=stamp, brief=brief,
        packages=", ".join(packages), figures=[path.name for path in figures],
        dt=f"{1e3 * study.control_dt:g}", answers=answer_table(study, results),
        absent=[(peer, INSTALL.format("verify")) for peer in PEERS if not stamp[peer]],
        stepping=", ".join(f"{name} {value}" for name, value in study.reference.scene.items()),
        references=reference_table(results), path_seconds=PATH_SECONDS, motions=long_table(study, results),
        exponents=", ".join(f"{name} {motions.exponent:.2g}" for name, motions in free.items()),
        doubt=f"{1e3 * max(doubts, default=math.nan):.0e}",
    )  # fmt: skip


def files(folder: Path) -> list[Path]:
    """The page, the tables and the figures in a folder."""
    tables = [folder / name for name in ("accuracy.md", *accuracy_plots.TABLES)]
    return [*tables, *accuracy_plots.files(folder)]


def write(study: Study, command: str, folder: Path) -> list[Path]:
    """Run a study and write the page, both tables as CSV, and the figures; returns their paths."""
    with needs("plot"):  # checked before the study runs for minutes
        import matplotlib  # noqa: F401
        import PIL  # noqa: F401
    results = accuracy.run(study)
    text, *tables = files(folder)[: 1 + len(accuracy_plots.TABLES)]
    write_rows([row for r in results for row in r.rows], accuracy.COLUMNS, tables[0])
    write_rows([row for r in results for row in r.long_rows], accuracy.long_columns(study), tables[1])
    write_text(text, page_text(study, results, command, []))
    figures = accuracy_plots.save_figures(results, study, folder)
    shown = [path for path in figures if path.suffix == ".png"]
    write_text(text, page_text(study, results, command, shown))
    return [text, *tables, *figures]
