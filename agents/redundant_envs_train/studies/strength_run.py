"""The study of motor strength as one command: train what is missing, draw figure and table."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from redundant_envs.figures import bare, new_figure, save_figure
from redundant_envs.progress import counted
from redundant_envs.scene import scene_data
from redundant_envs.tables import markdown, write_rows

from ..config import Config, load
from ..config.fields import checked
from ..run_folder import check_out
from ..training.many import train_many
from ..training.pool import count_of
from .strength import (
    ARMS,
    COLORS,
    COLUMNS,
    HOLDABLE,
    POSES,
    Row,
    expert_rows,
    learner_rows,
    read_rows,
    weakened,
)  # fmt: skip

LEARNERS = ("ppo", "sac")
MARKERS = dict(zip(COLORS, ("o", "v", "s", "^"), strict=True))
"""A marker for each, so that they can be distinguished without colours."""
AREA = "#D9D9D9"

Key = tuple[str, float, str]  # arm, factor and learner of a row


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
    """Train what is missing, and write strength.csv and strength.png into ``out``; returns a Markdown table.

    ``seeds`` are of the learners trained here; without any nothing is trained. ``episodes`` are the goals of
    computed torque and of the share that can be held. A learner for which ``runs``, evaluated run folders,
    have an arm and factor is not trained again, and finished runs in ``out`` are kept.
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
            more = f" ({row.seeds} seed{'s' * (row.seeds > 1)})" if row and row.seeds else ""
            cells.append(f"{100 * row.hold_success:.1f} %{more}" if row else "-")
        lines.append((arm, f"{factor:g}", *cells))
    return markdown(("arm", "limits times", *who), lines)


def figure(rows: Sequence[Row]) -> Any:
    """A panel for each arm with rows: hold success [%] over the factor of the effort limits.

    The share that can be held at all is a grey area. Intervals are bands. The legend is below the panels.
    """
    arms = [arm for arm in ARMS if any(row.arm == arm for row in rows)]
    if not arms:
        raise ValueError("rows is empty; give those of expert_rows and learner_rows")
    result = new_figure(4.0 * len(arms) + 0.6, 3.9, 120)
    panels = result.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    handles: dict[str, Any] = {}
    for panel, arm in zip(panels, arms, strict=True):
        handles |= _draw(panel, [row for row in rows if row.arm == arm])
        panel.set_title(arm, loc="left", fontweight="bold")
        panel.set_xlabel("motor strength (effort limits times ...)")
        bare(panel)
    panels[0].set_ylabel("hold success, %")
    panels[0].set_ylim(0.0, 103.0)
    shown = [who for who in (HOLDABLE, *COLORS) if who in handles]
    result.legend([handles[who] for who in shown], shown, loc="outside lower center", ncols=3, frameon=False)
    return result


def _draw(panel: Any, rows: Sequence[Row]) -> dict[str, Any]:
    """Area, bands and curves of an arm; returns their handles for the legend."""
    handles: dict[str, Any] = {}
    for who in (HOLDABLE, *COLORS):
        own = sorted((row for row in rows if row.who == who), key=lambda row: row.factor)
        if not own:
            continue
        x = [row.factor for row in own]
        y = [100.0 * row.hold_success for row in own]
        if who == HOLDABLE:
            handles[who] = panel.fill_between(x, 0.0, y, color=AREA, linewidth=0.0)
            continue
        low, high = ([100.0 * getattr(row, end) for row in own] for end in ("low", "high"))
        panel.fill_between(x, low, high, color=COLORS[who], alpha=0.2, linewidth=0.0)
        (handles[who],) = panel.plot(
            x, y, color=COLORS[who], marker=MARKERS[who], markersize=4.5, linewidth=1.8
        )
    factors = sorted({row.factor for row in rows})
    panel.set_xticks(factors, [f"{factor:g}" for factor in factors])
    return handles
