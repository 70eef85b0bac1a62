"""Tables of runs: a row for each run, with its settings, scene, evaluation and learning curve.

A column has a dotted name, such as ``config.sac.gamma``. A cell is JSON, or a plain text where that is no
JSON; an empty cell means that the run has no such entry.
"""

from __future__ import annotations

import csv
import fnmatch
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.scene import Scene
from redundant_envs.tables import write_rows

from .. import command
from ..config import config_of
from ..run_folder import SELECTION, checked_evaluation, flat
from .runs import Group, Run, group, read_run, run_of

SECTIONS = ("run", "simulator", "config", "evaluation", "scene", "curve")
"""First parts of the names of columns."""


def write_runs(runs: Sequence[Run], path: Path) -> None:
    """Write runs as a CSV file that :func:`read_runs` reads; their names are the ends of their folders."""
    folders = [run.folder.absolute() for run in runs]
    above = os.path.commonpath([folder.parent for folder in folders])
    rows = []
    for run, folder in zip(runs, folders, strict=True):
        parts = (
            folder.relative_to(above).as_posix(), run.simulator, {**run.settings, "seed": run.seed},
            run.evaluation, run.scene, dict(zip(SELECTION, run.curve.T.tolist(), strict=True)),
        )  # fmt: skip
        cells = flat(dict(zip(SECTIONS, parts, strict=True)))
        # JSON, but a text as it is if that cannot be mistaken
        plain = {n for n, v in cells.items() if isinstance(v, str) and v and value_of(v) is v}
        rows.append({name: v if name in plain else json.dumps(v) for name, v in cells.items()})
    columns = dict.fromkeys(name for row in rows for name in row)
    write_rows(rows, sorted(columns, key=lambda name: SECTIONS.index(name.partition(".")[0])), path)


def read_runs(places: Iterable[str | Path]) -> list[Run]:
    """Runs from run folders, tables of :func:`write_runs`, and runs of a table.

    These are written ``TABLE.csv/NAME``, where the name may be a pattern such as ``*_sac/*``. ValueError if a
    folder is not an evaluated run, a table is damaged or has no such run, or there are no places.
    """
    runs: list[Run] = []
    for place in map(Path, places):
        table = next((p for p in (place, *place.parents) if p.suffix == ".csv" and p.is_file()), None)
        if table is None:
            runs.append(read_run(place))
        else:
            runs += _read_table(table, place.relative_to(table).as_posix())
    if not runs:
        raise ValueError("folders is empty; give at least one run folder")
    return runs


def read_groups(places: Iterable[str | Path]) -> list[Group]:
    """The groups of runs; ValueError as in :func:`read_runs` and :func:`group`."""
    return group(read_runs(places))


def _read_table(path: Path, pattern: str) -> list[Run]:
    """The runs of a table whose names have a pattern; "." are all."""
    name, names, runs = "", [], []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                names.append(name := str(value_of(row["run"])))
                if pattern == "." or fnmatch.fnmatchcase(name, pattern):
                    runs.append(_run(path / name, row))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, csv.Error) as error:
        reason = str(error).partition(";")[0]
        raise ValueError(
            f"{path} is no table of runs, or its run {name!r} is damaged ({reason}); write it again: "
            f"{command('table', 'RUNS', '--out', path)}"
        ) from error
    if not runs:
        raise ValueError(f"{path} has no run {pattern}; it has {', '.join(names[:3]) or 'none'} ...")
    return runs


def _run(folder: Path, row: dict[str, str]) -> Run:
    """The run of a row."""
    data: dict[str, Any] = {"simulator": None}
    for name, cell in row.items():
        *parents, last = name.split(".")
        place = data
        for parent in parents if cell else ():
            place = place.setdefault(parent, {})
        if cell:
            place[last] = value_of(cell)
    curve = np.array([data["curve"][name] for name in SELECTION], dtype=np.float64).T
    evaluation = checked_evaluation(data["evaluation"], folder)
    scene = Scene.from_dict(data["scene"]).to_dict()
    return run_of(folder, config_of(data["config"]), scene, evaluation, curve, data["simulator"])


def value_of(cell: str) -> Any:
    """What a cell that is not empty holds."""
    try:
        return json.loads(cell)
    except ValueError:
        return cell
