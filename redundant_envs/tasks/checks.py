"""Checks that a task is complete, for the arm of a scene, before anything is compiled."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from redundant_envs.compiler import dialect
from redundant_envs.effects import baked_numbers
from redundant_envs.effects.baked_numbers import Described, Owner
from redundant_envs.effects.bound_hooks import identifier
from redundant_envs.effects.obstacles import clearance_functions, distance_names
from redundant_envs.language.algebra import arguments_of, gives_of, numbered
from redundant_envs.language.quantities import check_names, givers_of
from redundant_envs.scenes.numbers import entries_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import check_declared, with_fields
from redundant_envs.tasks.base import Task

MAX_DRAWS = 64
BUILT_IN = (
    "numerics", "saturated_actions", "episode_steps", "evaluations", "events", "error_estimate",
    "beyond_limit", "parameters",
)  # fmt: skip
"""Keys of ``info`` that every task has."""


def check_task(task: Task, scene: Scene) -> None:
    """ValueError unless a task fits the arm of a scene.

    Every name that it defines must be new: a name that the arm has, too, would mean the quantity of the arm,
    and rewards and observations would mean something else.
    """
    kind, arm = type(task).__name__, scene.robot
    check_declared(f"the task {kind}", task, Task)
    functions = (*task.functions(scene), *task.begin_functions(scene))
    for f in functions:
        dialect.check(f)
    equations = (*arm.functions, *(f for f in (arm.held_dynamics, arm.slider_mobility) if f is not None))
    known = {name for f in equations for name in (*gives_of(f), *arguments_of(f))}
    known |= {*arm.coordinates, *arm.rates, *arm.parameter_values()}
    of_engine = {
        **dict.fromkeys(numbered("action{}", len(arm.joints)), "the action"),
        **dict.fromkeys(numbered("draw{}", task.draws), "a draw of the episode"),
        **dict.fromkeys(task.aliases(scene), "an end of the travel of a slider"),
        "interval": "the control interval", "steps": "control steps of the episode before this one",
        **dict.fromkeys(distance_names(scene.attached, arm), "a distance from an obstacle"),
        "ended": "whether a fault ends the episode",
        "paid": "what the other terms of the reward have paid in the episode",
    }  # fmt: skip
    reserved = {name: f"of the engine: {doc}" for name, doc in of_engine.items()}
    for effect in scene.effects:
        of_effect = (f"{effect.key}.{name}" for name in (*effect.parameters(), *effect.states(arm)))
        reserved |= dict.fromkeys(map(identifier, of_effect), f"of the effect {type(effect).__name__}")
    check_names(f"{arm.kind}.functions", (name for f in equations for name in gives_of(f)), reserved)
    taken = dict.fromkeys(known, f"of the arm {arm.kind}") | reserved
    of_angles = [name for pair in task.angles.values() for name in pair]
    begun = {name for f in task.begin_functions(scene) for name in gives_of(f)}
    shared = dict.fromkeys(("masses", "lengths"), f"of the arm {arm.kind}: options of a reset set them")
    for field, names, more in (
        ("functions", givers_of(functions), {}),
        ("parameters", task.parameters(), shared),
        ("memory", task.memory, {}),  # which begin_functions may give
        ("angles", of_angles, dict.fromkeys(begun, f"of {kind}.begin_functions")),
    ):
        check_names(f"{kind}.{field}", names, taken | more)
        taken |= {name: f"of {kind}.{field}" for name in names if name not in begun or field == "memory"}
    fields, of_all = ([f.name for f in dataclasses.fields(x)] for x in (task, Task))
    choices: dict[str, Sequence[str]] = {
        **dict.fromkeys(("moves", "updates"), task.memory),
        **dict.fromkeys(("flags", "labels", "held_outputs"), task.metrics),
        "summed": task.held_outputs,
        "ends": [*task.memory, *(name for f in task.functions(scene) for name in gives_of(f))],
        **dict.fromkeys(("ranges", "units", "unused"), fields),
        "static": [f for f in fields if f not in of_all],
    }
    for field, allowed in choices.items():
        for name in getattr(task, field):
            if name not in allowed:
                raise ValueError(f"{kind}.{field} has {name!r}; choose {', '.join(allowed) or 'none'}")
    shown = [task.labels.get(name, name) for name in task.metrics]
    for label in shown:
        if label in BUILT_IN or label.startswith("return_") or shown.count(label) > 1:
            field = "labels" if label in task.labels.values() else "metrics"
            raise ValueError(f"{kind}.{field} has {label!r}, which info has already; choose another name")
    flags = [task.labels.get(name, name) for name in task.flags]
    for label in task.failures:
        if label not in flags:
            raise ValueError(
                f"{kind}.failures has {label!r}; info has the flags {', '.join(flags) or 'none'}"
            )
    if not 0 <= task.draws <= MAX_DRAWS:
        raise ValueError(f"{kind}.draws is {task.draws}; give 0 to {MAX_DRAWS}")
    _check_placements(task, scene, begun)
    if not task.observation(scene):
        raise ValueError(f"{kind}.observation is empty; give at least one quantity")
    _check_rewards(task, scene)
    if not dialect.is_own(type(task)):  # tests of the package hold this of its own tasks
        _check_captured(task, scene)


def _check_placements(task: Task, scene: Scene, begun: Iterable[str]) -> None:
    """ValueError unless a task sets numbers of effects, which no range draws, to quantities of a start."""
    kind, of_effects = type(task).__name__, [name for name in scene.parameters() if "." in name]
    drawn = {
        name for names in entries_of(scene, scene.randomize, task.parameters()).values() for name in names
    }
    for number, quantity in task.placements(scene).items():
        if number not in of_effects:
            known = ", ".join(of_effects) or "none"
            raise ValueError(f"{kind}.placements has {number!r}; the scene's effects have {known}")
        if number in drawn:
            raise ValueError(f"{kind}.placements has {number!r}, which the scene draws; leave out its range")
        if quantity not in begun:
            choices = ", ".join(sorted(begun)) or "nothing"
            raise ValueError(f"{kind}.placements gives {quantity!r}; begin_functions give {choices}")
        taken = taken_by(quantity, task, scene)
        if placed := [n for n in task.placements(scene) if not taken.isdisjoint((n, identifier(n)))]:
            raise ValueError(
                f"{kind}.placements gives {quantity!r}, which takes {placed[0]}: that of the episode before; "
                "compute it from draws and from numbers that the task does not set"
            )


def taken_by(quantity: str, task: Task, scene: Scene) -> set[str]:
    """Names of all that a quantity follows from."""
    arm = scene.robot
    own = (*task.functions(scene), *task.begin_functions(scene))
    givers = givers_of((*own, *clearance_functions(scene.attached, arm), *arm.functions))
    pairs = {**arm.sincos, **task.angles}.items()
    angles = {name: (angle,) for angle, pair in pairs for name in pair}
    names, new = set[str](), {quantity}
    while new:
        names |= new
        arguments = (angles.get(n) or (arguments_of(givers[n]) if n in givers else ()) for n in new)
        new = {name for some in arguments for name in some} - names
    return names


def _check_captured(task: Task, scene: Scene) -> None:
    """ValueError if what a task says depends on numbers that are set per environment."""

    def described(task: Task, robot: Any, *effects: Any) -> Described:
        other = with_fields(scene, robot=robot, effects=effects)
        for cached in ("_parameters", "loaded_robot"):
            vars(other).pop(cached, None)
        return task_described(task, other)

    def of_task(name: str) -> str:
        other = f"or name {name!r} in 'static' if it is part of the structure and is never set"
        return f"take it as the argument {name} of the function, {other}"

    def of_effect(key: str) -> Callable[[str], str]:
        return lambda name: f"take it as the argument {identifier(f'{key}.{name}')} of the function"

    owners = [
        Owner(type(task).__name__, task, of_task),
        Owner("the arm", scene.robot, baked_numbers.of_the_arm),
    ]
    owners += [Owner(f"the effect {e.key}", e, of_effect(e.key)) for e in scene.effects]
    baked_numbers.check_captured(owners, described)


def task_described(task: Task, scene: Scene) -> Described:
    """Everything that an environment takes from a task, but for its numbers."""
    functions = (*task.functions(scene), *task.begin_functions(scene))
    description: Described = {"the number of functions": str(len(functions))}
    for f in functions:
        description[f"the function of {', '.join(gives_of(f))}"] = baked_numbers.function_described(f)
    names = (
        "draws",
        "memory",
        "moves",
        "updates",
        "metrics",
        "flags",
        "labels",
        "held_outputs",
        "angles",
        "ends",
    )
    attributes = {name: getattr(task, name) for name in (*names, "goal_conditioned", "speed_bound_ends")}
    attributes |= {
        "reward_terms": task.reward_terms(scene), "observation": tuple(task.observation(scene)),
        "aliases": task.aliases(scene), "placements": task.placements(scene),
        "start_range": [task.start_range(scene, joint) for joint in range(len(scene.robot.joints))],
    }  # fmt: skip
    return description | {name: repr(value) for name, value in attributes.items()}


def _check_rewards(task: Task, scene: Scene) -> None:
    kind, functions = type(task).__name__, task.reward_functions(scene)
    if all("paid" in arguments_of(f) for f in functions):
        raise ValueError(f"{kind}.reward_functions gives no term of its own; give one without 'paid'")
    for f in functions:
        if "ended" in arguments_of(f) and "paid" not in arguments_of(f):
            raise ValueError(f"{kind}: {f.__qualname__} takes 'ended'; take 'paid' too")
    if not task.goal_conditioned:
        return
    missing = [name for name in ("goal_x", "goal_y") if name not in task.memory]
    if missing or not task.goal_functions:
        what = f"memory has no {missing[0]}" if missing else "goal_functions is empty"
        raise ValueError(f"{kind} is goal-conditioned and its {what}; give goal_x, goal_y and goal_functions")
    if [arguments_of(f) for f in functions] != [("goal_reward",)]:
        raise ValueError(f"{kind} is goal-conditioned: give one reward term, a function of goal_reward alone")
