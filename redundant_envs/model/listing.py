"""The program of a scene's simulator as text, and a count of its operations."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from redundant_envs.batch.advance import advance_kernel
from redundant_envs.batch.blocks import Blocks
from redundant_envs.effects.hooks import Field, Inertia
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import LOG
from redundant_envs.scene import Scene, check_scene
from redundant_envs.tracing.flow import Program
from redundant_envs.tracing.graph import Operation, located, reached
from redundant_envs.tracing.listing import lines

PACKAGE = Path(__file__).parents[1]
PARTS = {
    "robots": "arm", "numerics": "integrator", "events": "integrator", "lane": "interval",
    "batch": "interval",
}  # fmt: skip
"""Folders of the package, and the owner to which the operations written there are attributed."""
COUNTED = {"+": "additions", "-": "additions", "*": "products", "/": "divisions", "sqrt": "roots"}
BYTES = 8


class Operations(NamedTuple):
    """Operations of one step of a lane, and bytes of its memory; a sine and a cosine are one pair."""

    additions: int = 0
    products: int = 0
    divisions: int = 0
    roots: int = 0
    sine_pairs: int = 0
    bytes: int = 0


def listing(scene: Scene, track_work: bool = False) -> str:
    """The traced program of a scene, instruction by instruction.

    Each function of a lane is a list of operations under the function, file and line that they come from;
    ``%3`` is the result of operation 3, ``name <- %3`` stores it in a field of the lane. Kernels
    follow: the loops and branches around these functions.
    """
    check_scene(scene)
    with located():
        kernel, blocks = advance_kernel(Dynamics(scene, track_work))
        names = {blocks.layout.row_of(name): name for name in blocks.layout.fields}
        efforts = blocks.interval.dynamics.commands

        def name_of(space: str, k: int) -> str:
            return efforts[k] if space == "efforts" else names.get((space, k), f"{space}[{k}]")

        text = "\n".join(lines(Program([kernel]), name_of)) + "\n"
    return text.replace(f"{PACKAGE.parent}/", "")


def bill(scene: Scene, track_work: bool = False) -> dict[str, Operations]:
    """Cost of a step of a lane, by effect; "arm", "integrator" and "interval" are the rest.

    Operations are counted in the step that all lanes take together, stages as often as they are evaluated,
    before products are joined with sums. An operation that two owners need counts for the first; operations
    of the arm that only a uniform field or an inertia requires count for the effect that adds it. Bytes are
    those of the fields.
    """
    check_scene(scene)
    counts, blocks = _counts(scene, track_work)
    rest = dataclasses.replace(scene, randomize=None)  # a range may be of an effect that is left out
    for key in dict.fromkeys(a.key for a in scene.attached.of(Field, Inertia)):
        rest = dataclasses.replace(rest, effects=tuple(e for e in rest.effects if e.key != key))
        without, _ = _counts(rest, track_work)
        more = counts["arm"] - without["arm"]  # with an inertia the arm's own elimination is not used
        counts.setdefault(key, Counter()).update(more)
        counts["arm"] -= more
    arm = scene.robot
    owners = dict.fromkeys((*arm.coordinates, *arm.rates, *arm.parameter_values()), "arm")
    for effect in scene.effects:
        own = (*effect.parameters(), *effect.states(arm))
        owners |= dict.fromkeys((f"{effect.key}.{name}" for name in own), effect.key)
    for name, field in blocks.layout.fields.items():
        if field.lifetime is not LOG:
            counts.setdefault(owners.get(name, "interval"), Counter())["bytes"] += BYTES
    return {owner: Operations(**counts[owner]) for owner in sorted(counts)}


def _counts(scene: Scene, track_work: bool) -> tuple[dict[str, Counter[str]], Blocks]:
    """Operations by owner and kind, and the blocks of the program."""
    with located():
        _, blocks = advance_kernel(Dynamics(scene, track_work))
        functions = blocks.functions
        step = next(functions[n] for n in ("interval", "step", "common") if n in functions)
        nodes = reached(step.results)
        counts: dict[str, Counter[str]] = {"arm": Counter()}
        _count(counts, nodes, 1)
        if stages := [n for n in nodes if n.name == "stage"]:
            _count(counts, stages[0].extra.traced()[1], len(stages))
    return counts, blocks


def _count(counts: dict[str, Counter[str]], nodes: list[Operation], times: int) -> None:
    for n in nodes:
        if n.origin is None or n.name == "load":
            continue
        path = Path(n.origin.file)
        folder = path.relative_to(PACKAGE).parts[0] if path.is_relative_to(PACKAGE) else "robots"
        owner = n.origin.owner or PARTS.get(folder, "arm")
        if n.origin.function == "sincos":
            counts.setdefault(owner, Counter())["sine_pairs"] += times * (n.name == "bit" and n.extra == 0)
        elif n.name in COUNTED:
            counts.setdefault(owner, Counter())[COUNTED[n.name]] += times
