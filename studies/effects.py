"""The bill of every effect and scene: what they cost beside a bare arm, and whether their ceilings hold."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from redundant_envs.effects import REGISTRY
from redundant_envs.effects.hooks import Effect
from redundant_envs.envs import cost
from redundant_envs.figures import bare as bare_axes
from redundant_envs.figures import new_figure, save_figure
from redundant_envs.files import exists, explained, read_yaml
from redundant_envs.machine import versions
from redundant_envs.robots.parameters import number
from redundant_envs.scene import Scene, load_scene, scene_names
from redundant_envs.values import check_keys, shown, typed, whole_number
from studies.timing import one_core

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "lanes", *cost.COLUMNS, "ceiling", "held",
)  # fmt: skip
KEYS = ("lanes", "turns", "seconds", "bare", "effects", "scenes")
OF_ENTRY = ("type", "bare", "numbers", "zero", "ceilings")
BARE = "bare "
"""Begins the names of bare arms in the table."""
MOST_TIMES = 1e6
"""Largest ceiling, times bare: an effect that costs more cannot be timed."""


class Ceilings(NamedTuple):
    """Most that a control step may cost, times bare."""

    step: float  # at one rk8 step
    tolerance: float  # at 1e-6 m


@dataclass(frozen=True)
class Entry:
    """An effect of the study.

    Attributes
    ----------
    name : str
    effect : Effect
    arm : Scene
        The bare arm to which it is added.
    ceilings : Ceilings
    zero : Effect, optional
        The same with zero magnitude.
    """

    name: str
    effect: Effect
    arm: Scene
    ceilings: Ceilings
    zero: Effect | None = None

    @property
    def pair(self) -> cost.Pair:
        """The arm with the effect, and without it."""
        return cost.alone(self.arm, self.effect)


@dataclass(frozen=True)
class Study:
    """The numbers of the study.

    Attributes
    ----------
    lanes, turns : int
    seconds : float
        After which a scene has no more turns, s.
    entries : dict of str to Entry
        Effects by the names of their entries.
    scenes : dict of str to Ceilings
        Ceilings of scenes by their names.
    """

    lanes: int
    turns: int
    seconds: float
    entries: dict[str, Entry]
    scenes: dict[str, Ceilings]


def load_study(path: Path) -> Study:
    """The study that a YAML file describes; a ValueError names a mistake, its file and line."""
    if not exists(path):
        raise ValueError(f"config is {shown(str(path))}; there is no such file")
    data = read_yaml(path, "config")
    with explained(path):
        return study_of(data)


def study_of(data: Any) -> Study:
    """The study from plain data."""
    given = _mapping("config", data, KEYS, KEYS)
    entries = {
        name: _entry(f"config.effects.{name}", name, entry, given["bare"])
        for name, entry in _mapping("config.effects", given["effects"]).items()
    }
    scenes = {}
    for name, ceilings in _mapping("config.scenes", given["scenes"], scene_names()).items():
        scenes[name] = _ceilings(f"config.scenes.{name}", ceilings)
    seconds = number("config.seconds", given["seconds"])
    if seconds <= 0.0:
        raise ValueError(f"config.seconds is {seconds}; it must be positive")
    lanes, turns = (whole_number(f"config.{name}", given[name]) for name in ("lanes", "turns"))
    return Study(lanes, turns, seconds, entries, scenes)


def _mapping(
    name: str, data: Any, valid: Iterable[str] | None = None, needed: Iterable[str] = ()
) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise ValueError(f"{name} is {shown(data)}; give a mapping")
    if valid is not None:
        check_keys(name, data, [*valid])
    for key in needed:
        if key not in data:
            raise ValueError(f"{name} lacks {key!r}; give all of {', '.join(needed)}")
    return data


def _entry(where: str, name: str, data: Any, bare: Any) -> Entry:
    given = _mapping(where, data, OF_ENTRY, ("numbers", "ceilings"))
    kind = given.get("type", name)
    numbers = _mapping(f"{where}.numbers", given["numbers"])
    effect = typed(where, {"type": kind, **numbers}, REGISTRY)
    zero = None
    if "zero" in given:
        changed = _mapping(f"{where}.zero", given["zero"])
        zero = typed(f"{where}.zero", {"type": kind, **numbers, **changed}, REGISTRY)
    arm = cost.bare(load_scene(given.get("bare", bare)))
    entry = Entry(name, effect, arm, _ceilings(f"{where}.ceilings", given["ceilings"]), zero)
    _ = entry.pair  # refuses an effect that does not fit the arm
    return entry


def _ceilings(where: str, data: Any) -> Ceilings:
    given = _mapping(where, data, Ceilings._fields, Ceilings._fields)
    found = []
    for name in Ceilings._fields:
        most = number(f"{where}.{name}", given[name])
        if not 0.0 < most <= MOST_TIMES:
            raise ValueError(f"{where}.{name} is {most:g} times bare; give above 0, at most {MOST_TIMES:g}")
        found.append(most)
    return Ceilings(*found)


def chosen(study: Study, names: Sequence[str]) -> Study:
    """The study of some effects and scenes alone; of all, if none is named."""
    if not names:
        return study
    known = [*study.entries, *scene_names()]
    for name in names:
        if name not in known:
            raise ValueError(f"effect is {name!r}; choose {', '.join(known)}")
    kept = {name: entry for name, entry in study.entries.items() if name in names}
    return dataclasses.replace(study, entries=kept)


def pairs_of(study: Study, names: Sequence[str]) -> dict[str, cost.Pair]:
    """Bare arms, each with an effect more, and scenes."""
    arms = {f"{BARE}{e.arm.robot.kind}": cost.Pair(e.arm, e.arm) for e in study.entries.values()}
    effects = {name: entry.pair for name, entry in study.entries.items()}
    scenes = {name: load_scene(name) for name in scene_names() if not names or name in names}
    return {**arms, **effects, **{name: cost.Pair(s, cost.bare(s)) for name, s in scenes.items()}}


def run(study: Study, names: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Time all effects and scenes of the study, or those named; two rows of :data:`COLUMNS` for each."""
    study = chosen(study, names)
    ceilings = {name: e.ceilings for name, e in study.entries.items()} | study.scenes
    about, rows = versions(), []
    with one_core():
        found = cost.costs(pairs_of(study, names), study.lanes, study.turns, study.seconds)
    of_accuracy = dict(zip(cost.TOLERANCES, Ceilings._fields, strict=True))
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
