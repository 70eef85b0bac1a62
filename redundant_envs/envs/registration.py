"""Ids of the environments, arms x tasks. ``import redundant_envs`` imports it; it imports no numerics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym

if TYPE_CHECKING:
    from redundant_envs.effects import Effect
    from redundant_envs.integrators.tableaus import Tableau
    from redundant_envs.robots import Arm
    from redundant_envs.tasks import Task

NAMESPACE = "redundant_envs"
MAX_EPISODE_STEPS = 100

ARGUMENTS = ("scene", "accuracy", "task", "on_bad_action", "max_episode_steps")
"""What all environments take at their making, beside their number and what draws them."""


class Made(NamedTuple):
    """What an id stands for: kind of arm, name of task."""

    arm: str
    task: str


SCENES: dict[str, Any] = {"RPRP": "rprp_reach", "FourR": "four_r_reach"}
"""Scene of each arm in its environments."""
TASKS = ["Reach", "GoalReach"]
IDS: dict[str, Made] = {}
"""All ids."""


def ids() -> list[str]:
    """All registered ids."""
    return list(IDS)


def id_of(arm: str, task: str) -> str:
    """The id of a task with an arm."""
    return f"{NAMESPACE}/{arm}{task}-v0"


def check_arm(env_id: str | None, kind: str) -> None:
    """Refuse a scene whose arm is not that of an id; without an id every arm fits."""
    if env_id is None or IDS[env_id].arm == kind:
        return
    arm, task = IDS[env_id]
    fitting = id_of(kind, task)
    fix = f"make {fitting} with it" if fitting in IDS else f"give a scene with a robot of type {arm}"
    raise ValueError(f"scene has the arm {kind}; {env_id} is an environment of {arm}: {fix}")


def register() -> None:
    """Register all ids with Gymnasium; registering twice does nothing."""
    for arm, scene in SCENES.items():
        for task in TASKS:
            name = id_of(arm, task)
            IDS[name] = Made(arm, task)
            if name in gym.registry:
                continue
            gym.register(
                id=name,
                entry_point=f"redundant_envs.envs.named:{arm}{task}Env",
                vector_entry_point=f"redundant_envs.envs.named:{arm}{task}VectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                kwargs={"scene": scene},
            )


# ---- what is added from outside ------------------------------------------------------------------------


def _add(what: str, registry: dict[str, Any], name: str, value: Any) -> None:
    """Into a registry, unless another thing of that name is there; the same class may be loaded anew."""
    there = registry.get(name)
    home = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if (
        there is not None
        and there != value
        and home != (there.__module__, getattr(there, "__qualname__", ""))
    ):
        raise ValueError(f"{what} {name!r} is taken by {there!r}; give yours another name")
    registry[name] = value


def _check_name(what: str, name: Any) -> None:
    if not isinstance(name, str) or not name.isidentifier() or not name.isascii():
        raise ValueError(f"{what} is called {name!r}; give a name of letters and digits, as ids have")


def register_arm(arm: type[Arm], scene: Mapping[str, Any] | str | Path | None = None) -> None:
    """Let scenes name an arm, and ``gymnasium.make`` its environments.

    Parameters
    ----------
    arm : subclass of Arm
        Its ``kind``, the name of the class unless it says otherwise, is its name in scenes and ids.
    scene : mapping or path of a YAML file, optional
        Of its environments ``redundant_envs/<kind><task>-v0``, of every task; without it there are none.

    Raises
    ------
    ValueError
        If another arm has the name, or the scene is not one of this arm.
    """
    from redundant_envs import robots
    from redundant_envs.scene import load_scene

    if not (isinstance(arm, type) and issubclass(arm, robots.Arm)):
        raise ValueError(f"arm is {arm!r}; give a class derived from redundant_envs.Arm")
    _check_name("the arm", arm.kind)
    _add("the arm", robots.REGISTRY, arm.kind, arm)
    if scene is not None:
        kind = load_scene(scene).robot.kind
        if kind != arm.kind:
            raise ValueError(f"scene has the arm {kind}; give one with a robot of type {arm.kind}")
        SCENES[arm.kind] = str(scene) if isinstance(scene, Path) else scene
        register()


def register_task(task: type[Task]) -> None:
    """Let ``gymnasium.make`` know a task: ``redundant_envs/<arm><name>-v0`` for every arm with a scene.

    Raises
    ------
    ValueError
        If another task has the name.
    """
    from redundant_envs import tasks

    if not (isinstance(task, type) and issubclass(task, tasks.Task)):
        raise ValueError(f"task is {task!r}; give a class derived from redundant_envs.Task")
    _check_name("the task", getattr(task, "name", None))
    _add("the task", tasks.REGISTRY, task.name, task)
    if task.name not in TASKS:
        TASKS.append(task.name)
    register()


def register_effect(effect: type[Effect]) -> None:
    """Let scene files name an effect by its class.

    Raises
    ------
    ValueError
        If another effect has the name.
    """
    from redundant_envs import effects

    if not (isinstance(effect, type) and issubclass(effect, effects.Effect)):
        raise ValueError(f"effect is {effect!r}; give a class derived from redundant_envs.effects.Effect")
    _add("the effect", effects.REGISTRY, effect.__name__, effect)


def register_integrator(method: Tableau) -> None:
    """Let scenes name an explicit Runge-Kutta method; steps of equal length are made with it.

    Raises
    ------
    ValueError
        If another method has the name, or the tableau is not that of an explicit method.
    """
    from redundant_envs.integrators import tableaus

    if not isinstance(method, tableaus.Tableau):
        raise ValueError(f"method is {method!r}; give a redundant_envs.Tableau")
    method.check()
    _add("the integrator", tableaus.METHODS, method.name, method)
