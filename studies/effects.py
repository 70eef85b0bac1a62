"""The bill of every effect and scene: what they cost beside a bare arm, and whether their ceilings hold."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

from redundant_envs.effects import OWN
from redundant_envs.effects.hooks import Effect, snake_case
from redundant_envs.effects.numbers import example_of
from redundant_envs.envs import cost
from redundant_envs.scenes import config_folder
from redundant_envs.scenes.files import read_text
from redundant_envs.scenes.scene import Scene, load_scene, scene_names
from redundant_envs.support.extras import needs
from redundant_envs.support.machine import versions
from redundant_envs.support.values import check_keys
from redundant_envs_train.config import Model, Real, Whole, load_model, number
from studies.speed import one_core

with needs("train"):
    from pydantic import model_validator

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "lanes", *cost.COLUMNS, "ceiling", "held",
)  # fmt: skip
PAGES = config_folder("studies").parents[1] / "docs" / "effects"
"""Pages of effects, whose tables of costs have the ceilings: these follow from measurements."""
ARM, ARM_WITH_SLIDERS = "four_r_reach", "rprp_reach"
"""Scenes whose bare arms effects are added to: the first, or the second where an effect needs sliders."""
BARE = "bare "
"""Begins the names of bare arms in the table."""
MAX_TIMES = 1e6
"""Largest ceiling, times bare: an effect that costs more cannot be timed."""


class Ceilings(Model):
    """Most that a control step may cost, times bare."""

    step: Real = number(..., 1e-9, MAX_TIMES, "ceiling at one rk8 step")
    tolerance: Real = number(..., 1e-9, MAX_TIMES, "ceiling at 1e-6 m")


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
    scenes: Mapping[str, Ceilings]  # of scenes by their names

    @cached_property
    def entries(self) -> dict[str, Entry]:
        """The examples of all effects of the package, with the ceilings of their pages."""
        arm, with_sliders = (cost.bare(load_scene(name)) for name in (ARM, ARM_WITH_SLIDERS))
        entries = {}
        for name, kind in OWN.items():
            example = example_of(kind)
            numbers, zero, variants = example.numbers, example.zero, example.variants
            every = {name: numbers, **{f"{name} {k}": {**numbers, **args} for k, args in variants.items()}}
            for (of, args), ceilings in zip(every.items(), ceilings_of(kind), strict=True):
                effect = kind(**args)
                nothing = kind(**{**args, **zero}) if zero and of == name else None
                entries[of] = Entry(effect, arm if _fits(effect, arm) else with_sliders, ceilings, nothing)
        return entries

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_keys("scenes", self.scenes, scene_names())
        return self


def ceilings_of(kind: type[Effect]) -> list[Ceilings]:
    """The ceilings of the examples of an effect, from the table of costs on its page."""
    page = PAGES / f"{snake_case(kind.__name__)}.md"
    rows = re.findall(rf"^\| `{kind.__name__}\(.*\)` \| (\S+) \| (\S+) \|$", read_text(page, "page"), re.M)
    needed = 1 + len(example_of(kind).variants)
    if len(rows) != needed:
        raise ValueError(
            f"{page} has ceilings of {len(rows)} examples of {needed}; give each a row in the table of costs"
        )
    return [Ceilings(step=float(step), tolerance=float(tolerance)) for step, tolerance in rows]


def _fits(effect: Effect, arm: Scene) -> bool:
    with contextlib.suppress(ValueError):
        return bool(cost.alone(arm, effect))
    return False


load_study = functools.partial(load_model, Study)


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
        costs = cost.costs(pairs, study.lanes, study.turns, study.seconds)
    of_accuracy = dict(zip(cost.TOLERANCES, Ceilings.model_fields, strict=True))
    for row in costs:
        most = getattr(ceilings.get(row["of"]), of_accuracy[row["at"]], "")
        held = "" if most == "" else row["times_bare"] <= most
        rows.append({**about, "lanes": study.lanes, **row, "ceiling": most, "held": held})
    return rows


def verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line about the ceilings."""
    judged = [row for row in rows if row["held"] != ""]
    missed = [f"{r['of']} at {r['at']} ({r['times_bare']} > {r['ceiling']})" for r in judged if not r["held"]]
    line = f"{len(judged) - len(missed)} of {len(judged)} ceilings hold"
    return f"{line}; not {', '.join(missed)}" if missed else line
