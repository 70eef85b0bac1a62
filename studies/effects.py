"""The bill of every effect and scene: what they cost beside a bare arm, and whether their ceilings hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self

from redundant_envs.effects import REGISTRY
from redundant_envs.effects.hooks import Effect
from redundant_envs.envs import cost
from redundant_envs.extras import needs
from redundant_envs.figures import bare as bare_axes
from redundant_envs.figures import new_figure, save_figure
from redundant_envs.machine import versions
from redundant_envs.scene import Scene, load_scene, scene_names
from redundant_envs.values import check_keys, typed
from redundant_envs_train.config import Model, Real, Text, Whole, checked, merged, number, read, value
from studies.speed import one_core

with needs("train"):
    from pydantic import model_validator

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "lanes", *cost.COLUMNS, "ceiling", "held",
)  # fmt: skip
BARE = "bare "
"""Begins the names of bare arms in the table."""
MOST_TIMES = 1e6
"""Largest ceiling, times bare: an effect that costs more cannot be timed."""


class Ceilings(Model):
    """Most that a control step may cost, times bare."""

    step: Real = number(..., 1e-9, MOST_TIMES, "ceiling at one rk8 step")
    tolerance: Real = number(..., 1e-9, MOST_TIMES, "ceiling at 1e-6 m")


class EntryOfFile(Model):
    """An effect of the study as its file has it."""

    type: Text = value("", "class of the effect, by default the name of the entry")
    bare: Text = value("", "scene of the bare arm, by default that of the study")
    numbers: Mapping[str, Any]
    ceilings: Ceilings
    zero: Mapping[str, Any] | None = value(None, "numbers of the same effect with zero magnitude")


class Entry(NamedTuple):
    """An effect of the study."""

    effect: Effect
    arm: Scene  # the bare arm to which it is added
    ceilings: Ceilings
    zero: Effect | None  # the same with zero magnitude

    @property
    def pair(self) -> cost.Pair:
        """The arm with the effect, and without it."""
        return cost.alone(self.arm, self.effect)


class Study(Model):
    """The numbers of the study."""

    lanes: Whole = number(..., 1, 1e6, "lanes of a batch")
    turns: Whole = number(..., 1, 1e6, "turns of a scene")
    seconds: Real = number(..., 1e-9, 1e6, "time after which a scene has no more turns", "s")
    bare: Text
    effects: Mapping[str, EntryOfFile]
    scenes: Mapping[str, Ceilings]  # of scenes by their names

    @cached_property
    def entries(self) -> dict[str, Entry]:
        """Effects by the names of their entries."""
        return {name: self._entry(name, given) for name, given in self.effects.items()}

    def _entry(self, name: str, given: EntryOfFile) -> Entry:
        where, numbers = f"effects.{name}", {"type": given.type or name, **given.numbers}
        effect = typed(where, numbers, REGISTRY)
        zero = None if given.zero is None else typed(f"{where}.zero", {**numbers, **given.zero}, REGISTRY)
        return Entry(effect, cost.bare(load_scene(given.bare or self.bare)), given.ceilings, zero)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_keys("scenes", self.scenes, scene_names())
        for entry in self.entries.values():
            _ = entry.pair  # refuses an effect that does not fit the arm
        return self


def load_study(path: Path) -> Study:
    """The study that a YAML file describes; a ValueError names a mistake, its file and line."""
    study: Study = merged(path, read(path, "configs/studies"), (), lambda data: checked(Study, data))
    return study


def pairs_of(study: Study, names: Sequence[str] = ()) -> dict[str, cost.Pair]:
    """Effects and scenes, or those that are named, each beside its bare arm; and these arms."""
    known = [*study.entries, *scene_names()]
    for name in names:
        if name not in known:
            raise ValueError(f"effect is {name!r}; choose {', '.join(known)}")
    entries = {name: entry for name, entry in study.entries.items() if not names or name in names}
    arms = {f"{BARE}{e.arm.robot.kind}": cost.Pair(e.arm, e.arm) for e in entries.values()}
    scenes = {name: load_scene(name) for name in scene_names() if not names or name in names}
    bare = {name: cost.Pair(scene, cost.bare(scene)) for name, scene in scenes.items()}
    return {**arms, **{name: entry.pair for name, entry in entries.items()}, **bare}


def run(study: Study, names: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Time all effects and scenes of the study, or those named; two rows of :data:`COLUMNS` for each."""
    ceilings = {name: e.ceilings for name, e in study.entries.items()} | dict(study.scenes)
    about, rows, pairs = versions(), [], pairs_of(study, names)
    with one_core():
        found = cost.costs(pairs, study.lanes, study.turns, study.seconds)
    of_accuracy = dict(zip(cost.TOLERANCES, Ceilings.model_fields, strict=True))
    for row in found:
        most = getattr(ceilings.get(row["of"]), of_accuracy[row["at"]], "")
        held = "" if most == "" else row["times_bare"] <= most
        rows.append({**about, "lanes": study.lanes, **row, "ceiling": most, "held": held})
    return rows


def verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line about the ceilings."""
    judged = [row for row in rows if row["held"] != ""]
    missed = [f"{r['of']} at {r['at']} ({r['times_bare']} > {r['ceiling']})" for r in judged if not r["held"]]
    return f"{len(judged) - len(missed)} of {len(judged)} ceilings hold" + "".join(
        f"; not {m}" if k == 0 else f", {m}" for k, m in enumerate(missed)
    )


def figure(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Times bare of effects and scenes, with their ceilings; a panel for each accuracy."""
    names = list(dict.fromkeys(row["of"] for row in rows if not row["of"].startswith(BARE)))[::-1]
    made = new_figure(9.0, 1.4 + 0.24 * len(names), 150)
    panels = made.subplots(1, len(cost.TOLERANCES), sharey=True)
    for panel, accuracy in zip(panels, cost.TOLERANCES, strict=True):
        of = {row["of"]: row for row in rows if row["at"] == accuracy}
        times = [of[name]["times_bare"] for name in names]
        panel.barh(range(len(names)), [t - 1.0 for t in times], left=1.0, height=0.6, color="#0072B2")
        most = [(of[name]["ceiling"], k) for k, name in enumerate(names) if of[name]["ceiling"] != ""]
        if most:
            panel.plot(*zip(*most, strict=True), "|", color="#D55E00", ms=9, mew=2, label="ceiling")
            panel.legend(frameon=False, fontsize=8, loc="lower right")
        panel.axvline(1.0, color="0.3", lw=0.8)
        panel.set_xscale("log")
        ticks = [t for t in (0.5, 1, 2, 5, 10, 100, 1000, 10000) if t <= 2.0 * max(times, default=1.0)]
        panel.set_xticks(ticks, [f"{t:g}" for t in ticks])
        panel.minorticks_off()
        panel.set_title(f"at {accuracy}", loc="left", fontsize=10)
        panel.set_xlabel("time of a control step, times bare [logarithmic]", fontsize=9)
        bare_axes(panel)
    panels[0].set_yticks(range(len(names)), names, fontsize=8)
    return made


def save_pictures(rows: Sequence[Mapping[str, Any]], folder: Path) -> list[Path]:
    """Draw the figure as PNG and SVG."""
    return [save_figure(figure(rows), folder / f"effects.{kind}") for kind in ("png", "svg")]
