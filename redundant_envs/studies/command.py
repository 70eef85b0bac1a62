"""The commands of ``python -m redundant_envs study``. Each imports what it needs: --help is instant."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from redundant_envs.disk import add_force, check_kept, check_plain
from redundant_envs.files import config_folder
from redundant_envs.tables import table, write_rows
from redundant_envs.values import say

STUDIES = (
    "throughput", "environments", "effects", "stops", "impacts", "intervals", "estimates", "accuracy",
)  # fmt: skip


def add_studies(parser: argparse.ArgumentParser) -> None:
    """Give the command ``study`` its studies."""
    studies = parser.add_subparsers(dest="study", required=True)
    p = studies.add_parser("throughput", help="nanoseconds per step of the compiled core")
    p.add_argument("--config", type=Path, metavar="YAML", help="default: configs/studies/throughput.yaml")
    p.set_defaults(handler=throughput)
    _add_study_out(p)
    p = studies.add_parser("environments", help="speed of the Gymnasium environments")
    p.add_argument("--lanes", type=int, default=4096)
    p.add_argument("--rounds", type=int, default=10)
    p.set_defaults(handler=environments)
    _add_study_out(p)
    p = studies.add_parser("effects", help="cost of every effect and scene, and whether ceilings hold")
    p.add_argument("name", nargs="*", metavar="NAME", help="effect or scene; default: all")
    p.add_argument("--config", type=Path, metavar="YAML", help="default: configs/studies/effects.yaml")
    p.set_defaults(handler=effects)
    _add_study_out(p)
    p = studies.add_parser("stops", help="cost of the hard stops of the RPRP scene")
    p.add_argument("--lanes", type=int, default=4096)
    p.set_defaults(handler=stops)
    _add_study_out(p)
    for name, what in (
        ("impacts", "whether error control finds every impact at hard stops"),
        ("intervals", "whether the tolerance is kept in families of hard scenes"),
    ):
        p = studies.add_parser(name, help=what)
        p.add_argument("--intervals", type=int, default=100_000, help="over all families")
        p.add_argument("--processes", type=int, default=1, help="number of processes, each with its families")
        p.add_argument("--seed", type=int, default=0)
        p.add_argument(
            "--tolerances", type=float, nargs="+", default=(), metavar="M",
            help="judge the same intervals at each of these, m (default: each family at its own)",
        )  # fmt: skip
        p.set_defaults(handler=intervals)
        _add_study_out(p)
    p = studies.add_parser("estimates", help="errors of single steps beside their estimates")
    p.add_argument("--steps", type=int, default=16384, help="of each family")
    p.add_argument("--seed", type=int, default=0)
    p.set_defaults(handler=estimates)
    _add_study_out(p)
    p = studies.add_parser("accuracy", help="error against cost, beside MuJoCo and SciPy")
    p.add_argument("--config", type=Path, metavar="YAML", help="default: configs/studies/accuracy.yaml")
    p.add_argument("--out", type=Path, default=Path("runs/studies"), metavar="FOLDER")
    p.add_argument(
        "--redraw", type=Path, metavar="FOLDER",
        help="instead, draw the figures again from the tables of an earlier run, into its folder",
    )  # fmt: skip
    p.set_defaults(handler=accuracy)
    add_force(p)


def _add_study_out(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--out", type=Path, default=Path("runs/studies"), metavar="FOLDER", help="folder, or a .csv file"
    )
    add_force(p)


def throughput(options: argparse.Namespace) -> None:
    """Time the compiled core."""
    from redundant_envs.studies import throughput as study

    config = study.load_config(options.config or config_folder("studies") / "throughput.yaml")
    path = _target(options, "throughput")
    _report(study.run(config), study.COLUMNS, "dgemm_gflops", path)


def environments(options: argparse.Namespace) -> None:
    """Time the environments."""
    from redundant_envs.studies import environments as study

    path = _target(options, "environments")
    _report(study.run(options.lanes, options.rounds), study.COLUMNS, "env", path)


def effects(options: argparse.Namespace) -> None:
    """Time effects and scenes beside bare arms; write a table and a picture."""
    from redundant_envs.studies import effects as study

    config = study.load_study(options.config or config_folder("studies") / "effects.yaml")
    path = _target(options, "effects", "effects.png", "effects.svg")
    rows = study.run(config, options.name)
    _report(rows, study.COLUMNS, "at", path)
    say(study.verdict(rows))
    say("\n".join(str(picture) for picture in study.save_pictures(rows, path.parent)))


def stops(options: argparse.Namespace) -> None:
    """Time intervals with and without stops, on states of random actions."""
    from redundant_envs.studies import stops as study

    if options.lanes < 8:
        raise ValueError(f"lanes is {options.lanes}; give at least 8")
    path = _target(options, "stops")
    rows = study.run({"random actions": study.random_policy(0)}, options.lanes)
    _report(rows, study.COLUMNS, "states", path)


def intervals(options: argparse.Namespace) -> None:
    """Check intervals of many families of scenes."""
    from redundant_envs.studies import intervals as study

    for name, least in (("intervals", 1), ("seed", 0), ("processes", 1)):
        if getattr(options, name) < least:
            raise ValueError(f"{name} is {getattr(options, name)}; give at least {least}")
    path = _target(options, options.study)
    rows = study.run(options.study, options.intervals, options.seed, options.processes, options.tolerances)
    _report(rows, study.COLUMNS, "family", path)


def estimates(options: argparse.Namespace) -> None:
    """Compare single steps with their estimates."""
    from redundant_envs.studies import estimates as study

    for name, least in (("steps", 1), ("seed", 0)):
        if getattr(options, name) < least:
            raise ValueError(f"{name} is {getattr(options, name)}; give at least {least}")
    path = _target(options, "estimates")
    _report(study.run(options.steps, options.seed), study.COLUMNS, "estimate", path)


def accuracy(options: argparse.Namespace) -> None:
    """Measure errors and costs; write tables, figures and a page."""
    from redundant_envs.studies import accuracy_config, accuracy_report

    command = "python -m redundant_envs study accuracy"
    if options.config:
        command += f" --config {options.config}"
    study = accuracy_config.load_study(options.config or config_folder("studies") / "accuracy.yaml")
    if options.redraw:
        from redundant_envs.studies import accuracy_plots

        check_plain(options.redraw)
        drawn = accuracy_plots.read(study, options.redraw)
        say("\n".join(str(path) for path in accuracy_plots.save_figures(drawn, study, options.redraw)))
        return
    check_kept(accuracy_report.files(options.out), options.force, [options.config] if options.config else ())
    page, *others = accuracy_report.write(study, command, options.out)
    say(page.read_text(encoding="utf-8"))
    say("\n".join(str(path) for path in (page, *others)))


def _target(options: argparse.Namespace, name: str, *pictures: str) -> Path:
    """The CSV file of a study, which exists only if --force replaces it, as pictures beside it do."""
    path: Path = options.out if options.out.suffix == ".csv" else options.out / f"{name}.csv"
    config = getattr(options, "config", None)
    files = [path, *(path.with_name(picture) for picture in pictures)]
    check_kept(files, options.force, [config] if config else ())
    return path


def _report(rows: list[dict[str, Any]], columns: Sequence[str], first: str, path: Path) -> None:
    """Write a study's rows as CSV and print them; values common to all rows are printed once, on one line."""
    write_rows(rows, columns, path)
    start = columns.index(first)
    if rows:
        say(", ".join(f"{c} {rows[0][c]}" for c in columns[:start] if rows[0][c]))
    say(table(columns[start:], ([row[c] for c in columns[start:]] for row in rows)))
    say(path)
