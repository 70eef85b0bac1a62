"""The program of a scene's simulator as text, and a count of its operations."""

import contextlib
import dataclasses
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from redundant_envs.compiler.tracing.flow import LaneFunction, Program
from redundant_envs.compiler.tracing.graph import COMPARISONS, Operation, located, reached
from redundant_envs.compiler.tracing.listing import lines
from redundant_envs.effects.hooks import Actuation, Field, Inertia
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.simulator.batch.advance import advance_kernel
from redundant_envs.simulator.batch.blocks import Blocks
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.simulator.lane.fields import LOG, Layout
from redundant_envs.simulator.lane.memory import traced
from redundant_envs.support.notebook import as_html, table
from redundant_envs.tasks import ReachTask, Task
from redundant_envs.tasks.checks import check_task

PACKAGE = Path(__file__).parents[1]
PARTS = {
    "robots": "arm", "simulator/numerics": "integrator", "simulator/events": "integrator",
    "simulator/lane": "interval", "simulator/batch": "interval", "language/limits.py": "integrator",
}  # fmt: skip
"""Folders and files of the package, and the owner to which the operations written there are attributed."""
OF_ENVIRONMENT = ("action", "observation", "reward", "reset")  # entries of a bill beside the motion
COUNTED = {
    "+": ("additions",), "-": ("additions",), "*": ("products",), "fma": ("additions", "products"),
    "/": ("divisions",), "sqrt": ("roots",), "select": ("selections",),
    **dict.fromkeys(COMPARISONS, ("comparisons",)),
}  # fmt: skip
"""Kinds as which an operation counts; a minimum is a comparison and a selection."""
COMMON = ("interval", "step", "common", "common_held", "end")
"""Functions of the step that all lanes take together, counted by its parts, and of lanes at rest."""
BYTES = 8
Counts = dict[str, Counter[str]]  # operations by owner and kind


class Operations(NamedTuple):
    """Operations of one step of a lane, and bytes of its memory; a sine and a cosine are one pair."""

    additions: int = 0
    products: int = 0
    divisions: int = 0
    roots: int = 0
    sine_pairs: int = 0
    comparisons: int = 0
    selections: int = 0
    bytes: int = 0


class Bill(dict[str, Operations]):
    """Operations by owner; in a notebook a table."""

    def _repr_html_(self) -> str:
        heads = ("of", *(name.replace("_", " ") for name in Operations._fields))
        return as_html(self, lambda: table(heads, [(owner, *counts) for owner, counts in self.items()]))


def listing(scene: Scene, track_work: bool = False) -> str:
    """The traced program of a scene, instruction by instruction. Each function of a lane is a list of
    operations under the function, file and line that they come from; ``%3`` is the result of operation 3,
    ``name <- %3`` stores it in a field of the lane. Kernels follow: the loops and branches around these
    functions."""
    check_scene(scene)
    with located():
        kernel, blocks = advance_kernel(Dynamics(scene, track_work))
        names = {blocks.layout.row_of(name): name for name in blocks.layout.fields}
        efforts = blocks.interval.dynamics.commands

        def name_of(space: str, k: int) -> str:
            return efforts[k] if space == "efforts" else names.get((space, k), f"{space}[{k}]")

        return "\n".join(lines(Program([kernel]), name_of)).replace(f"{PACKAGE.parent}/", "") + "\n"


def bill(scene: Scene, track_work: bool = False, task: Task | None = None) -> Bill:
    """Cost of a control step of a lane, by effect; "arm", "integrator" and "interval" are the rest of its
    motion, "action", "observation", "reward" and "reset" that of an environment.

    Operations are counted in the step that all lanes take together, stages as often as they are evaluated,
    before products are joined with sums. Effects with events (stops, dry friction, contact, laws that change)
    also have what the step of all has because of them, and, once each, the programs with which a lane crosses
    an event; several share these in proportion to their boundaries. An operation that two owners need counts
    for the first, one of the arm that only a uniform field or an inertia requires for the effect that adds
    it. "action" turns actions into efforts, "reward" is all that follows a step: faults, memory of the task,
    reward, ends of episodes. Bytes are those of the fields, and of what "observation" writes.

    Parameters
    ----------
    scene : Scene
    track_work : bool
        Also count the work of motors and of forces without a potential.
    task : Task, optional
        Of the environment, by default that of the Reach environments; then a scene with a slider without
        limits, which they cannot have, has no entries of an environment. One without motors has no "action".

    Raises
    ------
    ValueError
        If the task does not fit the scene.
    """
    check_scene(scene)
    counts, blocks = _of_motion(scene, track_work)
    rest = dataclasses.replace(scene, randomize=None)  # a range may be of an effect that is left out
    if owned := Counter(b.owner for b in blocks.interval.features.boundaries):
        rest = _without(rest, owned)
        _add(counts, _of_events(owned, counts, _of_motion(rest, track_work)[0], blocks))
    for key in dict.fromkeys(a.key for a in rest.attached.of(Field, Inertia)):
        rest = dataclasses.replace(rest, effects=tuple(e for e in rest.effects if e.key != key))
        without, _ = _of_motion(rest, track_work)
        more = counts["arm"] - without["arm"]  # with an inertia the arm's own elimination is not used
        counts.setdefault(key, Counter()).update(more)
        counts["arm"] -= more
    arm = scene.robot
    owners = dict.fromkeys((*arm.coordinates, *arm.rates, *arm.parameter_values()), "arm")
    for effect in scene.effects:
        names = (*effect.parameters(), *effect.states(arm))
        owners |= dict.fromkeys((f"{effect.key}.{name}" for name in names), effect.key)
    for name, field in blocks.layout.fields.items():
        if field.lifetime is not LOG:
            counts.setdefault(owners.get(name, "interval"), Counter())["bytes"] += BYTES
    if task is None and {*arm.sliders()} <= scene.travel().keys():
        task = ReachTask()
    if task is not None:
        check_task(task, scene)
        _add(counts, _of_environment(scene, task, blocks.layout))
    return Bill((owner, Operations(**counts[owner])) for owner in sorted(counts))


def _without(scene: Scene, keys: Iterable[str]) -> Scene:
    """A scene without some effects; links of motors stay if others need them."""
    for more in (set[str](), scene.attached.keys_of(Actuation)):
        left = tuple(e for e in scene.effects if e.key not in keys or e.key in more)
        with contextlib.suppress(ValueError):  # the units of the links that are left do not meet
            return dataclasses.replace(scene, effects=left)
    return scene


def _of_motion(scene: Scene, track_work: bool) -> tuple[Counts, Blocks]:
    """Operations of the motion, and the blocks of the program."""
    with located():
        _, blocks = advance_kernel(Dynamics(scene, track_work))
        step = next(blocks.functions[n] for n in ("interval", "step", "common") if n in blocks.functions)
        counts: Counts = {part: Counter() for part in PARTS.values()}
        _add(counts, _of_function(step))
        if "interval" not in blocks.functions:  # else the updates are a part of it
            update = traced("update", blocks.layout, blocks.interval.update_effect_states)
            _add(counts, _counted(reached(update.results)))
    return counts, blocks


def _of_events(owned: Counter[str], full: Counts, without: Counts, blocks: Blocks) -> Counts:
    """Operations that boundaries cause, for the effects that own some of them, and as much less for the
    owners in the step of all lanes: the difference of that step with and without these effects, and the
    programs of events."""
    programs = (f for name, f in blocks.functions.items() if name not in COMMON)
    caused = sum((kinds for f in programs for kinds in _of_function(f).values()), Counter[str]())
    counts: Counts = {}
    for part in {*PARTS.values()}:
        counts[part] = Counter(without[part])
        counts[part].subtract(full[part])
        caused.subtract(counts[part])
    most = max(owned, key=lambda key: owned[key])
    for key, boundaries in owned.items():
        counts[key] = Counter({k: n * boundaries // owned.total() for k, n in caused.items()})
    for kind in caused:  # what is left over by rounding
        counts[most][kind] += caused[kind] - sum(counts[key][kind] for key in owned)
    return counts


def _of_function(function: LaneFunction) -> Counts:
    """Operations of a function and of the stages that it calls, by owner."""
    nodes = reached(function.results)
    counts = _counted(nodes)
    if stages := [n for n in nodes if n.name == "stage"]:
        _add(counts, _counted(stages[0].extra.traced()[1]), len(stages))
    return counts


def _of_environment(scene: Scene, task: Task, motion: Layout) -> Counts:
    """Operations of an environment beside those of the motion, and bytes beside those of its layout."""
    counts: Counts = {}
    with located():
        episode = Episode(Dynamics(scene), task)
        layout = episode.layout()
        each = {"reward": episode.finish_control_step, "observation": episode.observe, "reset": episode.reset}
        functions = {name: traced(name, layout, part) for name, part in each.items()}
        if scene.action_units():
            inputs = {"actions": ("f32", episode.actions)}
            functions["action"] = traced("action", layout, episode.command, inputs=inputs)
        for part, function in functions.items():
            _add(counts, {part: Counter(), **_counted(reached(function.results), part)})
        # The end of a control step updates the states of effects, too, as the motion does.
        update = traced("update", layout, episode.interval.update_effect_states)
        _add(counts, _counted(reached(update.results), "reward"), -1)
    owners = dict.fromkeys((*episode.draws, "resetting"), "reset") | dict.fromkeys(episode.actions, "action")
    for owner in (owners.get(name, "reward") for name in layout.fields if name not in motion):
        if owner in functions:
            counts[owner]["bytes"] += BYTES
    for written in functions["observation"].outputs:
        counts["observation"]["bytes"] += int(written.element[1:]) // 8
    return counts


def _add(counts: Counts, more: Counts, times: int = 1) -> None:
    for owner, kinds in more.items():
        counts.setdefault(owner, Counter()).update({kind: times * n for kind, n in kinds.items()})


def _counted(nodes: Iterable[Operation], part: str | None = None) -> Counts:
    """Operations by owner; without an owner they count for a ``part``, or by the folder of their source."""
    counts: Counts = {}
    for n in nodes:
        if n.origin is None or n.name == "load":
            continue
        counter = counts.setdefault(n.origin.owner or part or _part_of(Path(n.origin.file)), Counter())
        if n.origin.function == "sincos":
            counter["sine_pairs"] += n.name == "bit" and n.extra == 0
        else:
            counter.update(COUNTED.get(n.name, ()))
    return counts


def _part_of(file: Path) -> str:
    """The owner of operations that are written in a file; those of a user's file belong to the arm."""
    place = file.relative_to(PACKAGE).as_posix() if file.is_relative_to(PACKAGE) else "robots"
    return next((part for folder, part in PARTS.items() if place.startswith(folder)), "arm")
