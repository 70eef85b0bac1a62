"""Does a task say what it must, for the arm of a scene? Looked at before anything is compiled."""

from __future__ import annotations

from collections.abc import Iterable

from redundant_envs import dialect
from redundant_envs.algebra import arguments_of, gives_of
from redundant_envs.quantities import givers_of
from redundant_envs.scene import Scene
from redundant_envs.tasks.base import Task

MOST_DRAWS = 64
BUILT_IN = (
    "numerics", "saturated_actions", "episode_steps", "evaluations", "events", "error_estimate",
    "beyond_limit",
)  # fmt: skip
"""Keys of ``info`` that every task has."""
COLUMNS = (
    "terminated", "truncated", "reward", "numerics", "saturated", "steps", "evaluations_sum", "events_sum",
    "error_most", "beyond_limit", "tip_x", "tip_y",
)  # fmt: skip
"""What a step tells of a lane whatever its task; sums of reward terms are told, too."""


def check_task(task: Task, scene: Scene) -> None:
    """ValueError unless a task fits the arm of a scene.

    Every name that it makes must be its own: one that the arm has too would be taken for that of the arm, and
    rewards and observations would mean something else.
    """
    kind, arm = type(task).__name__, scene.robot
    functions = (*task.functions(scene), *task.begin_functions)
    for f in functions:
        dialect.check(f)
    of_arm = {name for f in arm.functions for name in gives_of(f)} | {*arm.coordinates, *arm.rates}
    of_arm |= {name for pair in arm.sincos.values() for name in pair} | set(arm.parameter_values())
    given = set(givers_of(functions))
    _own(kind, "functions", given, of_arm)
    _own(kind, "parameters", task.parameters(), of_arm | given | {"masses", "lengths"})
    _own(kind, "angles", (name for pair in task.angles.values() for name in pair), of_arm | given)
    begun = {name for f in task.begin_functions for name in gives_of(f)}
    _own(kind, "memory", task.memory, of_arm | (given - begun) | set(task.parameters()))
    for field, entries, allowed in (
        ("moves", task.moves, task.memory),
        ("updates", task.updates, task.memory),
        ("flags", task.flags, task.metrics),
        ("labels", task.labels, task.metrics),
        ("held_outputs", task.held_outputs, task.metrics),
        ("ranges", task.ranges, task.parameters()),
        ("units", task.units, task.parameters()),
    ):
        for name in entries:
            if name not in allowed:
                raise ValueError(f"{kind}.{field} has {name!r}; choose {', '.join(allowed) or 'none'}")
    returns = {f"{t}_sum" for t in task.reward_terms(scene)}
    _own(kind, "metrics", task.metrics, {*COLUMNS, *returns})
    shown = [task.labels.get(name, name) for name in task.metrics]
    for label in shown:
        if label in BUILT_IN or label.startswith("return_") or shown.count(label) > 1:
            field = "labels" if label in task.labels.values() else "metrics"
            raise ValueError(f"{kind}.{field} has {label!r}, which info has already; choose another name")
    if not 0 <= task.draws <= MOST_DRAWS:
        raise ValueError(f"{kind}.draws is {task.draws}; give 0 to {MOST_DRAWS}")
    if not task.observation(scene):
        raise ValueError(f"{kind}.observation is empty; give at least one quantity")
    _check_rewards(task, scene)


def _own(kind: str, field: str, names: Iterable[str], taken: Iterable[str]) -> None:
    clash = sorted(set(names) & set(taken))
    if clash:
        raise ValueError(
            f"{kind}.{field} has {clash[0]!r}, which is the name of something else that its functions know; "
            "rename it"
        )


def _check_rewards(task: Task, scene: Scene) -> None:
    kind, functions = type(task).__name__, task.reward_functions(scene)
    if all("paid" in arguments_of(f) for f in functions):
        raise ValueError(
            f"{kind}.reward_functions gives no term of its own; give one that does not take 'paid'"
        )
    for f in functions:
        if "ended" in arguments_of(f) and "paid" not in arguments_of(f):
            raise ValueError(
                f"{kind}.reward_functions has {f.__qualname__}, which takes 'ended'; take 'paid' too"
            )
    if not task.goal_conditioned:
        return
    missing = [name for name in ("goal_x", "goal_y") if name not in task.memory]
    if missing or not task.goal_functions:
        what = f"memory has no {missing[0]}" if missing else "goal_functions is empty"
        raise ValueError(f"{kind} is goal-conditioned and its {what}; give goal_x, goal_y and goal_functions")
    if [arguments_of(f) for f in functions] != [("goal_reward",)]:
        raise ValueError(
            f"{kind} is goal-conditioned: its one reward term must be goal_reward itself, as hindsight "
            "replay computes it; give a function of goal_reward alone"
        )
