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
from studies.accuracy import PanelResult, Row
from studies.accuracy_config import PEERS, Study
from studies.accuracy_methods import brief


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
            cheaper = "" if math.isnan(answer.ratio) else f"{answer.ratio:.0f} x"
            lines.append([*of, *who(answer.ours), *theirs, cheaper])
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
    """Energy errors of long motions: all of MuJoCo's, and those of ours that an answer names."""
    lines = []
    for result in results:
        cheapest = [a.ours for a in accuracy.answers(result.rows, study.thresholds_mm) if a.ours]
        named = {(row["method"], row["setting"]) for row in cheapest}
        for row in result.long_rows:
            who = row["method"], row["setting"]
            if "energy_rate_median" in row and (row["peer"] or who in named):
                lines.append([result.panel.name, ", ".join(who), f"{row['energy_rate_median']:.0e}"])
    return markdown(["arm", "configuration", "energy"], lines)


def page_text(study: Study, results: Sequence[PanelResult], command: str, figures: Sequence[Path]) -> str:
    """The page, of a command and with pictures of the same folder."""
    stamp = results[0].rows[0]
    packages = (f"{name} {stamp[name]}" for name in ("python", "llvmlite", "numpy", *PEERS) if stamp[name])
    return page(
        "accuracy", Path(__file__).parent, study=study, command=command, stamp=stamp, brief=brief,
        packages=", ".join(packages), figures=[path.name for path in figures],
        dt=f"{1e3 * study.control_dt:g}", answers=answer_table(study, results),
        absent=[(peer, INSTALL.format("verify")) for peer in PEERS if not stamp[peer]],
        stepping=", ".join(f"{name} {value}" for name, value in study.reference.scene.items()),
        references=reference_table(results), motions=long_table(study, results),
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
    write_rows([row for r in results for row in r.long_rows], accuracy.LONG_COLUMNS, tables[1])
    figures = accuracy_plots.save_figures(results, study, folder)
    shown = [path for path in figures if path.suffix == ".png"]
    write_text(text, page_text(study, results, command, shown))
    return [text, *tables, *figures]
