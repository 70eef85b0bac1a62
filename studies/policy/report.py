"""Folder of a policy study: tables, figures, scenes and report.md."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import yaml

from redundant_envs.support import palette
from redundant_envs.support.bounded import read_rows
from redundant_envs.support.disk import replacing, write_text
from redundant_envs.support.figures import bare, literal, new_figure, save_figure
from redundant_envs.support.tables import write_rows
from redundant_envs_train import COMMAND
from redundant_envs_train.pages import page

from . import words
from .episodes import TIMING_REPEATS
from .run import STYLE, ArmResult, Row, stamp
from .settings import Study, load_study, slug
from .words import LOOKS, Difference, hold_difference, percent, reference_of, return_difference, signed


def write_report(study: Study, results: Sequence[ArmResult], folder: Path) -> Path:
    """Write tables, figures, scenes and report.md of a study."""
    about = stamp()
    for arm in results:
        for label, evaluation in arm.episodes.items():
            path = folder / "scenes" / f"{slug(arm.name)}_{slug(label)}.yaml"
            write_text(path, yaml.safe_dump(evaluation.scene.to_dict(), **STYLE))
    _write(folder / "physics.csv", [r for a in results for r in a.rows], about)
    trained = [r for a in results for r in a.trained]
    if trained:
        _write(folder / "training.csv", trained, about)
        differences = [r for a in results for r in a.training.values()]
        _write(folder / "training_differences.csv", differences, about)
    for result in results:
        _write_episodes(folder / f"episodes_{slug(result.name)}.csv", result, study, about)
    return _write_page(study, results, about, folder, ("svg", "png"))


def rewrite_report(folder: Path) -> Path:
    """Write the figures that are PNG and report.md of a study again, from its study.yaml and its tables;
    ValueError for another folder."""
    study = load_study(folder / "study.yaml")
    try:
        tables = [_read(folder / f"{name}.csv") for name in ("physics", "training", "training_differences")]
        about = {name: tables[0][0][name] for name in stamp()}
        results = []
        for name in study.arms:
            rows, trained, differences = ([row for row in table if row["arm"] == name] for table in tables)
            training = {row["measure"]: row for row in differences}
            results.append(ArmResult(name, rows[0]["env"], rows[0]["policy"], rows, {}, trained, training))
        return _write_page(study, results, about, folder, ["png"])
    except (LookupError, TypeError, StopIteration, jinja2.UndefinedError) as error:
        fix = "give a folder that the policy study wrote"
        raise ValueError(f"a table in {folder} is missing or damaged ({error!r}); {fix}") from error


def _read(path: Path) -> list[Row]:
    """Rows of a table with its numbers; none if the study has no such table."""
    rows = [*read_rows(path, "table")] if path.is_file() else []
    return [{name: _typed(name, cell) for name, cell in row.items()} for row in rows]


def _typed(name: str, cell: str) -> Any:
    if name in stamp() or not re.fullmatch(r"[-+.e\d]+", cell):
        return cell
    return int(cell) if cell.isdigit() else float(cell)


def _write_page(
    study: Study, results: Sequence[ArmResult], about: Mapping[str, str], folder: Path, kinds: Sequence[str]
) -> Path:
    for result in results:
        drawn = figure(result, study, about)
        for kind in kinds:
            save_figure(drawn, folder / "figures" / f"{slug(result.name)}.{kind}", dpi=150)
    target = folder / "report.md"
    text = page(
        "report", Path(__file__).parent, study=study,
        results=[(arm, reference_of(arm.rows, study)) for arm in results],
        about=", ".join(f"{k} {v}" for k, v in about.items() if v), repeats=TIMING_REPEATS, command=COMMAND,
        all_given=all(arm.run for arm in study.arms.values()), slug=slug, words=words,
    )  # fmt: skip
    write_text(target, text)
    return target


def _write(path: Path, rows: Sequence[Row], about: Mapping[str, str]) -> None:
    """Write rows as CSV, floats with 8 digits."""
    whole = [{**about, **row} for row in rows]
    short = [{k: float(f"{v:.8g}") if isinstance(v, float) else v for k, v in row.items()} for row in whole]
    write_rows(short, list(dict.fromkeys(name for row in short for name in row)), path)


def _write_episodes(path: Path, result: ArmResult, study: Study, about: Mapping[str, str]) -> None:
    any_one = result.episodes[study.reference]
    names = ["seed", "goal_x", "goal_y"]
    columns = [study.seed + np.arange(len(any_one.hold)), *any_one.goal.T]
    for label, e in result.episodes.items():
        names += [f"{slug(label)}_{k}" for k in ("hold", "return", "steps", "ended")]
        columns += [e.hold, e.returns, e.steps, e.ended]
    head = f"# {', '.join(f'{k} {v}' for k, v in about.items())}\n{','.join(names)}"
    table = np.column_stack(columns)
    with replacing(path) as part:
        np.savetxt(part, table, "%.12g", delimiter=",", header=head, comments="", encoding="utf-8")


def figure(result: ArmResult, study: Study, about: Mapping[str, str]) -> Any:
    """Differences of hold success and return from the reference, with intervals, per physics."""
    reference = reference_of(result.rows, study)
    rows = [row for row in result.rows if row is not reference]
    drawn = new_figure(7.0, 2.4 + 0.45 * len(rows))
    panels = drawn.subplots(1, 2, sharey=True)
    holds = [hold_difference(row, study) for row in rows]
    returns = [return_difference(row, study, reference) for row in rows]
    _draw(panels[0], f"goals held minus {literal(study.reference)}, of a hundred", holds)
    _draw(panels[1], f"mean return minus {literal(study.reference)}", returns)
    names = [f"{row['physics']}\n{percent(row['hold_success'])} held" for row in rows]
    panels[0].set_yticks(range(len(rows)), map(literal, names))
    panels[0].set_ylim(len(rows) - 0.5, -0.7)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    seen = {d.verdict for d in (*holds, *returns)}
    handles: list[Any] = [
        Line2D([], [], color=color, marker=marker, lw=2.0, label=text)
        for key, (color, marker, text) in LOOKS.items()
        if key in seen
    ]
    handles.append(Patch(color=palette.css(palette.REACH), label="margin"))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    drawn.suptitle(
        literal(f"{result.name}: {words.finding(result.rows, study)}"), fontsize=10, fontweight="bold",
        x=0.01, ha="left",
    )  # fmt: skip
    title = (
        f"One policy, {reference['episodes']} paired episodes, 95 % bootstrap intervals; "
        f"{study.reference}: {percent(reference['hold_success'])} held, mean return "
        f"{reference['mean_return']:.2f}\n"
        f"{about['machine']}, {about['date']}, commit {about['commit'] or 'unknown'}"
    )
    panels[0].set_title(literal(title), fontsize=8, loc="left")
    return drawn


def _draw(panel: Any, label: str, differences: Sequence[Difference]) -> None:
    """Intervals below each other, and the margin."""
    margin = max((d.margin for d in differences), default=1.0)
    widest = max((abs(end) for d in differences for end in (d.low, d.high)), default=0.0)
    panel.axvspan(-margin, margin, color=palette.css(palette.REACH), lw=0)
    panel.axvline(0.0, color=palette.GREY, lw=0.8)
    for y, d in enumerate(differences):
        color, marker, _ = LOOKS[d.verdict]
        panel.plot([d.low, d.high], [y, y], color=color, lw=2.0, solid_capstyle="butt")
        panel.plot(d.value, y, marker, color=color, ms=6)
        panel.annotate(
            signed(d.value), (d.value, y), (0, 7), textcoords="offset points", ha="center", fontsize=8,
            bbox={"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 0.6},
        )  # fmt: skip
    edge = max(1.15 * widest, 1.4 * margin)
    panel.locator_params(axis="x", nbins=5)  # their labels do not touch
    panel.set_xlim(-edge, edge)
    panel.set_xlabel(label, fontsize=8.5)
    panel.tick_params(labelsize=8)
    bare(panel)
