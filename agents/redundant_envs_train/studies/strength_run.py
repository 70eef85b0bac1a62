"""The study of motor strength as one command: train what is missing, draw figure and table."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from redundant_envs.figures import save_figure
from redundant_envs.progress import counted
from redundant_envs.scene import scene_data
from redundant_envs.tables import markdown, write_rows

from ..config import Config, load
from ..config.fields import checked
from ..new_folder import check_out
from ..training.many import train_many
from ..training.pool import count_of
from .strength import ARMS, COLUMNS, HOLDABLE, POSES, Row, expert_rows, learner_rows, read_rows, weakened
from .strength_figure import figure

LEARNERS = ("ppo", "sac")

Key = tuple[str, float, str]
"""Arm, factor and learner of a row."""


def trainings(factors: Sequence[float], seeds: Sequence[int]) -> dict[str, tuple[Key, Config]]:
    """Row and configuration of each learner by the name of its folder: presets with scaled effort limits."""
    chosen = {}
    for arm, (_, scene) in ARMS.items():
        for learner in LEARNERS:
            preset = load(f"{scene}_{learner}").to_dict()
            for factor in factors:
                data = scene_data(scene) if factor == 1.0 else weakened(scene, factor)
                for seed in seeds:
                    config = {**preset, "seed": seed, "env_kwargs": {"scene": data}}
                    run = checked(Config, config)
                    key = (arm, factor, run.label)
                    chosen[f"{arm.lower()}_{learner}_{factor!r}_seed{seed}"] = key, run
    return chosen


def run_study(
    factors: Sequence[float], seeds: Sequence[int], episodes: int, runs: Sequence[Path],
    processes: int | None, out: Path,
) -> str:  # fmt: skip
    """Train what is missing, and write strength.csv and strength.png.

    Parameters
    ----------
    factors : sequence of float
        Of the effort limits.
    seeds : sequence of int
        Of the learners trained here; none: no training.
    episodes : int
        Goals of computed torque and of the share that can be held.
    runs : sequence of Path
        Evaluated run folders: a learner that they contain for an arm and factor is not trained again.
    processes : int or None
        Trainings at a time.
    out : Path
        Folder; finished runs in it are kept.

    Returns
    -------
    str
        The rows as a Markdown table.
    """
    if not 2 <= episodes <= 1_000_000:
        raise ValueError(f"episodes is {episodes}; give a whole number from 2 to 1000000")
    if processes is not None:
        count_of(processes)
    given = learner_rows(runs)
    check_out(out)
    path = out / "strength.csv"
    rows = [row for row in read_rows(path) if not row.seeds] if path.is_file() else []
    if {(row.arm, row.factor, row.who, row.episodes) for row in rows} != {
        (arm, factor, who, episodes) for arm in ARMS for factor in factors for who in (HOLDABLE, *POSES)
    }:
        rows = []
        with counted("computed torque, and what can be held", len(ARMS)) as done:
            for arm in ARMS:
                rows += expert_rows(arm, factors, episodes)
                done(arm)
        write_rows(map(dataclasses.asdict, rows), COLUMNS, path)
    known = {(row.arm, row.factor, row.who) for row in given}
    chosen = {name: config for name, (key, config) in trainings(factors, seeds).items() if key not in known}
    if chosen:
        train_many(chosen, out / "runs", processes)
    trained = learner_rows([out / "runs" / name for name in chosen])
    rows = [*rows, *(row for row in (*given, *trained) if row.factor in factors)]
    write_rows(map(dataclasses.asdict, rows), COLUMNS, path)
    save_figure(figure(rows), out / "strength.png")
    return table(rows)


def table(rows: Sequence[Row]) -> str:
    """Hold success in percent, a line for each arm and factor."""
    who = list(dict.fromkeys(row.who for row in rows))
    found = {(row.arm, row.factor, row.who): row for row in rows}
    lines = []
    for arm, factor in dict.fromkeys((row.arm, row.factor) for row in rows):
        cells = []
        for name in who:
            row = found.get((arm, factor, name))
            more = (
                f" ({row.seeds} seed{'s' * (row.seeds > 1)})"
                if row and row.seeds and name != HOLDABLE
                else ""
            )
            cells.append(f"{100 * row.hold_success:.1f} %{more}" if row else "-")
        lines.append((arm, f"{factor:g}", *cells))
    return markdown(("arm", "limits times", *who), lines)
