"""Options of resets: what they give to lanes, at once or when the next episodes of these begin."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.arguments import check_of_reward, reach_of
from redundant_envs.model import parameters
from redundant_envs.model.memory import Memory
from redundant_envs.scenes.numbers import Table, names_of
from redundant_envs.simulator.lane.episode import Episode, fixed
from redundant_envs.support.values import check_keys, shown
from redundant_envs.tasks.base import hard_stops

PARAMETERS = "parameters"
LARGEST_START = {"q": 1e6, "qd": 1e100, "goal": 1e100}
"""Largest values of a start: sines are exact up to 1e6 rad, and squares of the others are floats."""
OPTION_KEYS = [*LARGEST_START, PARAMETERS]
Lanes = NDArray[np.int64]


class OptionValues(NamedTuple):
    """What one option gives to some lanes."""

    names: tuple[str, ...]  # parameters, those that options have set among them; or fields of a start
    lanes: Lanes
    values: NDArray[np.float64]  # (lanes, names)


Given = dict[str, OptionValues]  # options by their names, checked


def within(options: Given, lanes: Lanes, others: bool = False) -> Given:
    """What options give to these lanes, or to all ``others``."""
    parts = {}
    for key, part in options.items():
        chosen = np.isin(part.lanes, lanes, invert=others)
        if chosen.any():
            parts[key] = OptionValues(part.names, part.lanes[chosen], part.values[chosen])
    return parts


def over(options: Given, more: Given) -> Given:
    """Options of which ``more`` replace others of the same name and lane."""
    merged = {**options, **more}
    for key in options.keys() & more.keys():
        (_, lanes, values), part = options[key], more[key]
        rest = ~np.isin(lanes, part.lanes)
        together = np.concatenate([lanes[rest], part.lanes]), np.concatenate([values[rest], part.values])
        merged[key] = OptionValues(part.names, *together)
    return merged


def checked_options(options: Any) -> dict[str, Any]:
    """Options of a reset as a new dictionary, or a ValueError if they are not a mapping."""
    if not isinstance(options, Mapping | None):
        raise ValueError(f"options is {shown(options)}; give a mapping with some of {', '.join(OPTION_KEYS)}")
    return dict(options or {})


def checked_reset(
    episode: Episode, memory: Memory, options: Mapping[str, Any], lanes: Lanes, waiting: Given,
    keep: bool = False,
) -> Given:  # fmt: skip
    """What options give to lanes, and what waits for these and is not given now. Parameters are set on top of
    the environment's own, or with ``keep`` of those that lanes have or wait for. ValueError if an option is
    not valid, or if no episode can begin with all of them."""
    parts = within(waiting, lanes)
    if not options and not parts:
        return parts
    scene, task = episode.dynamics.scene, episode.task
    check_keys("options", options, OPTION_KEYS)
    numbers = options.get(PARAMETERS)
    if task.goal_conditioned and isinstance(numbers, Mapping):
        check_of_reward(scene, task, numbers)
    if numbers is not None:
        parameters.check_given(scene, numbers, task.parameters())
        named = {entry for name in numbers for entry in names_of(scene, name, task.parameters())}
        # For each number that episodes draw, whether these options set it: it is not drawn then.
        marks = {fixed(n): np.full(len(lanes), float(n in named)) for n in episode.randomized.entries}
        if keep:
            coming = _coming(episode, memory, lanes, parts)
            marks = {mark: np.maximum(flags, coming.pop(mark)) for mark, flags in marks.items()}
            numbers = {**coming, **numbers}
        rows = parameters.lane_values(scene, memory, lanes, numbers, True, task) | marks
        parts[PARAMETERS] = OptionValues(tuple(rows), lanes, np.stack([*rows.values()], axis=1))
    if options.get("goal") is not None and not episode.goal:
        raise ValueError(f"options['goal'] is given, and the task {task.name} has no goal; leave it out")
    if options.get("goal") is not None and episode.replaces_goal:
        raise ValueError(
            f"options['goal'] is given, and the task {task.name} computes its goal anew in every step, from "
            "what the episode has drawn; leave it out"
        )
    starts = {"q": scene.robot.coordinates, "qd": scene.robot.rates, "goal": episode.goal}
    for key in (key for key in starts if options.get(key) is not None):
        where, names = f"options[{key!r}]", starts[key]
        if np.ndim(options[key]) == 0 and len(names) > 1:
            raise ValueError(f"{where} is {shown(options[key])}; give ({len(names)},) numbers, one for each")
        values = parameters.table(where, options[key], len(lanes), len(names))
        most, largest = float(np.abs(values).max(initial=0.0)), LARGEST_START[key]
        if most > largest:
            raise ValueError(f"{where} has an entry of size {most:g}; give at most {largest:g}")
        parts[key] = OptionValues(names, lanes, values)
    _check_starts(episode, memory, parts, lanes)
    return parts


def _rows(lanes: Lanes, some: Lanes) -> Lanes:
    """Places of some lanes among lanes."""
    order = np.argsort(lanes)
    return order[np.searchsorted(lanes, some, sorter=order)]


def _coming(episode: Episode, memory: Memory, lanes: Lanes, options: Given) -> Table:
    """The numbers that lanes have once these options are in force."""
    of_task, marks = episode.task.parameters(), map(fixed, episode.randomized.entries)
    names = tuple(dict.fromkeys((*episode.dynamics.scene.parameters(), *of_task, *marks)))
    values = {name: column.copy() for name, column in parameters.present(memory, lanes, names).items()}
    if PARAMETERS in options:
        part = options[PARAMETERS]
        for name, column in zip(part.names, part.values.T, strict=True):
            values[name][_rows(lanes, part.lanes)] = column
    return values


def _check_starts(episode: Episode, memory: Memory, options: Given, lanes: Lanes) -> None:
    """ValueError if a start or a goal is impossible with the numbers that lanes will have."""
    if not {"q", "goal"} & options.keys():
        return
    scene, coming = episode.dynamics.scene, _narrowest(episode, _coming(episode, memory, lanes, options))

    def of(part: OptionValues) -> Table:
        rows = _rows(lanes, part.lanes)
        return {name: values[rows] for name, values in coming.items()}

    if "q" in options:  # beyond a spring it is allowed, beyond a stop it is not
        parameters.check_stops(scene, options["q"].values, of(options["q"]), "options['q']: ")
    if "goal" in options:
        part = options["goal"]
        radius, reach = np.linalg.norm(part.values, axis=1), reach_of(scene, of(part))
        if (radius > reach).any():
            lane = int(np.argmax(radius - reach))
            raise ValueError(
                f"options['goal'] is {radius[lane]:.6g} m from the base; the arm reaches "
                f"{reach[lane]:.6g} m: choose a goal within it"
            )


def _narrowest(episode: Episode, values: Table) -> Table:
    """Numbers of lanes with the shortest lengths and travels that a reset may draw: a start or a goal that
    options give has to be possible in every episode."""
    scene, narrowed = episode.dynamics.scene, dict(values)
    lowers = {lower for _, lower, _ in hard_stops(scene)}
    for entry, (low, high) in episode.randomized.ends().items():
        if entry in values:
            end = high if entry in lowers else low
            narrowed[entry] = np.where(values[fixed(entry)] > 0.0, values[entry], end)
    return narrowed
