"""Numbers of a scene and of a task by their names, and whether many sets of them are valid: those of lanes,
and the ends of ranges."""

import dataclasses
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import validate_hooks
from redundant_envs.effects.numbers import fields_with
from redundant_envs.robots.parameters import LARGEST, LARGEST_RATIO, SMALLEST
from redundant_envs.scenes.ranges import Range
from redundant_envs.support.values import replaced, shown

Table = dict[str, NDArray[np.float64]]  # parameter name -> values of some lanes
ROUNDING = 1e-12
"""Relative change of a number by its class that is taken for rounding, as where shares are scaled again."""
OF_ARM = ("masses", "lengths")  # names of the numbers of an arm
ENTRY = re.compile(r"(masses|lengths)(\[\d+\])?|[ml]\d+")  # these, and names of one of them


def names_of(scene: Any, name: str, of_task: Iterable[str] = ()) -> list[str]:
    """Scalar parameters of a user's name: "masses" -> m1, m2, ..., "masses[1]" or "m2" -> m2,
    "gravity.down" -> down[0], down[1]."""
    scalars: dict[str, list[str]] = {kind: [] for kind in OF_ARM}
    for parameter in scene.parameters():
        scalars[parameter] = [parameter]
        whole = next((k for k in OF_ARM if parameter[0] == k[0] and parameter[1:].isdigit()), "")
        if whole:
            scalars[f"{whole}[{int(parameter[1:]) - 1}]"] = [parameter]
        if whole or "[" in parameter:
            scalars.setdefault(whole or parameter.partition("[")[0], []).append(parameter)
    scalars |= {key: [key] for key in of_task}
    if isinstance(name, str) and name in scalars:
        return scalars[name]
    valid = sorted({entry.partition("[")[0] for entry in scalars if "." in entry})
    raise ValueError(f"parameter is {shown(name)}; this scene has {', '.join((*OF_ARM, *valid, *of_task))}")


def check_values(scene: Any, task: Any, values: Table, changed: list[str]) -> None:
    """ValueError unless the numbers of the arm, of each effect and of the task of which some change are valid
    and fit together."""
    for kind in OF_ARM:
        names = names_of(scene, kind)
        if not set(changed).isdisjoint(names):
            _check_positive(kind, np.stack([values[p] for p in names], axis=1))
    for effect in scene.effects:
        keys = [f"{effect.key}.{name}" for name in effect.parameters()]  # another key may begin with its key
        if not {*changed}.isdisjoint(keys):
            _check_effect(scene, effect, keys, values)
    for mass, sums in scene.attached.moving_masses(values, scene.attached.states.initial).items():
        _check_positive(f"{mass} with {', '.join(scene.attached.carried[mass])}", sums[:, None])
    scene.attached.check_inertias(scene.robot, values)
    if task is not None and task.parameters().keys() & changed:
        for numbers in _distinct(values, "", task.parameters()):  # its own checks decide
            _check_kept("", dataclasses.replace(task, **numbers), numbers)


def _check_positive(name: str, columns: NDArray[np.float64]) -> None:
    if not columns.size:  # of no lanes
        return
    least, most = columns.min(), columns.max()
    if not least > 0.0:
        raise ValueError(f"{name} has the entry {least}; it must be positive")
    if least < SMALLEST or most > LARGEST:
        raise ValueError(f"{name} has entries from {least} to {most}; give {SMALLEST} to {LARGEST}")
    ratio = float((columns.max(axis=1) / columns.min(axis=1)).max())
    if ratio > LARGEST_RATIO:
        raise ValueError(f"{name} spans a ratio of {ratio:.1e}; at most {LARGEST_RATIO:.0e} is supported")


def _check_effect(scene: Any, effect: Any, names: list[str], values: Table) -> None:
    """Build the effect with each lane's numbers, so that its own checks apply."""
    for numbers in _distinct(values, f"{effect.key}.", names):
        fields = {f.name for f in dataclasses.fields(effect)}
        field_values = {name: number for name, number in numbers.items() if name.partition("[")[0] in fields}
        new_effect = replaced(effect, **fields_with(effect, field_values)).fitted(scene.robot)
        _check_kept(f"{effect.key}.", new_effect, numbers)
        hooks = [a.hook for a in scene.attached if a.key == effect.key]
        validate_hooks.check_numbers(effect.key, new_effect, scene.robot, hooks)


def _distinct(values: Table, before: str, names: Iterable[str]) -> list[dict[str, float]]:
    """The different numbers of lanes by their names, without what these begin with."""
    suffixes = [name.removeprefix(before) for name in names]
    if suffixes and len(values[before + suffixes[0]]) == 1:
        return [{name: float(values[before + name][0]) for name in suffixes}]
    rows = np.unique(np.stack([values[before + name] for name in suffixes], axis=1), axis=0)
    return [dict(zip(suffixes, row, strict=True)) for row in rows.tolist()]


def _check_kept(before: str, owner: Any, numbers: Mapping[str, float]) -> None:
    """ValueError if a class makes other numbers of those that it is given, as one that scales them may:
    lanes would have the given ones."""
    values = owner.parameters()
    for name, value in numbers.items():
        if not math.isclose(values.get(name, math.nan), value, rel_tol=ROUNDING):
            raise ValueError(
                f"{before}{name} is {value}, and {type(owner).__name__} makes {values.get(name)} of it; give "
                "numbers that it keeps, all of them that depend on each other"
            )


def is_of_task(name: str) -> bool:
    """Whether a name can only be that of a number of a task, which only an environment knows."""
    return "." not in name and ENTRY.fullmatch(name) is None


def entries_of(scene: Any, drawn: Iterable[Range], of_task: Iterable[str] = ()) -> dict[Range, list[str]]:
    """The scalar parameters that ranges draw; ValueError if a name is unknown, or two ranges draw one."""
    entries: dict[Range, list[str]] = {}
    for one in drawn:
        try:
            entries[one] = names_of(scene, one.name, of_task)
        except ValueError as error:
            more = "" if of_task else ", and the numbers of the task of an environment"
            raise ValueError(f"randomize has an unknown name: {error}{more}") from None
    check_named_once("randomize draws", {one.name: names for one, names in entries.items()})
    return entries


def check_named_once(what: str, names_by_owner: Mapping[str, Iterable[str]]) -> None:
    """ValueError, which begins with ``what``, if two of the names given mean the same scalar parameter."""
    owners: dict[str, str] = {}
    for owner, names in names_by_owner.items():
        for name in names:
            if (other := owners.setdefault(name, owner)) != owner:
                raise ValueError(f"{what} {name} twice, by {other!r} and {owner!r}; leave one out")


def ends_of(drawn: Mapping[Range, list[str]], nominal: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """The least and the largest value of each scalar parameter that ranges draw."""
    ends = {}
    for one, names in drawn.items():
        for name in names:
            low, high = sorted(one.drawn(end, nominal[name]) for end in one.distribution.ends)
            ends[name] = low, high
    return ends


def check_ranges(scene: Any, drawn: Mapping[Range, list[str]], task: Any = None) -> None:
    """ValueError unless numbers at the ends of ranges pass the checks of fixed numbers, alone and together.

    Tried are all numbers at their lower ends, all at their upper ones, one range or entry alone at its upper
    end, and for each range a number inside, or every one of a choice. So any two numbers meet at all their
    ends: arms, effects and tasks compare no more with each other, such as the ends of a travel.
    """
    if not drawn:
        return
    nominal = {**scene.parameters(), **({} if task is None else task.parameters())}
    sets = list(_sets_of_ends(drawn, nominal))
    table = {name: np.array([one.get(name, value) for one in sets]) for name, value in nominal.items()}
    changed = list(sets[0])
    try:
        for name in changed:
            if not np.isfinite(table[name]).all():
                raise ValueError(f"{name} is {nominal[name]}, and a factor of it is no number; leave it out")
        check_values(scene, task, table, changed)
    except ValueError as error:
        raise ValueError(f"randomize draws what a fixed number may not be: {error}") from None


def _sets_of_ends(
    drawn: Mapping[Range, list[str]], nominal: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    def at(one: Range, value: float) -> dict[str, float]:
        return {name: one.drawn(value, nominal[name]) for name in drawn[one]}

    lowest, highest = (
        {name: x for one in drawn for name, x in at(one, one.distribution.ends[k]).items()} for k in (0, 1)
    )
    yield lowest
    yield highest
    for one, names in drawn.items():
        for together in [names] if one.shared else [[name] for name in names]:
            yield {**lowest, **{name: highest[name] for name in together}}
        for value in one.distribution.inside:
            yield {**lowest, **at(one, value)}
