"""Ids of the environments, arms x tasks. ``import redundant_envs`` imports it; it imports no numerics."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym

from redundant_envs.scenes import config_folder

if TYPE_CHECKING:
    from redundant_envs.effects import Effect
    from redundant_envs.robots import Arm
    from redundant_envs.scenes.scene import Scene
    from redundant_envs.scenes.tableaus import Tableau
    from redundant_envs.tasks import Task

    Given = Mapping[str, Any] | str | Path

NAMESPACE = "redundant_envs"
MAX_EPISODE_STEPS = 100  # of a task that does not say its steps
ARGUMENTS = (
    "scene", "accuracy", "task", "terminate_on_touch", "on_bad_action", "max_episode_steps", "randomize",
    "observe_parameters", "info_keys", "action", "decide_every",
)  # fmt: skip
"""Arguments of all environments, beside their number and those of pictures."""
OF_PICTURES = ("render_mode", "render_width", "render_height")


class Made(NamedTuple):
    """Meaning of an id: kind of arm, name of task."""

    arm: str
    task: str


def _scenes_of_arms() -> dict[str, Any]:
    """Scenes by their arms: those of the files ``*_reach.yaml``, the shortest name first."""
    files = sorted(config_folder("scenes").glob("*_reach.yaml"), key=lambda file: (len(file.stem), file.stem))
    arm, scenes = re.compile(r"^robot:\n +type: (\w+)$", re.MULTILINE), dict[str, Any]()
    for file in files:
        scenes.setdefault(arm.search(file.read_text(encoding="utf-8"))[1], file.stem)  # type: ignore[index]
    return scenes


def _steps_of_tasks() -> dict[str, int]:
    """Control steps of the episodes of the package's tasks, by the tasks' names, the shortest first; from the
    text of the bodies of their classes, which takes a millisecond: to import these takes a tenth of a second.
    """
    name = re.compile(r'^    name\b.* = "(\w+)"', re.MULTILINE)
    steps = re.compile(r"^    steps\b.* = (\d+)\b", re.MULTILINE)
    found: dict[str, int] = {}
    for file in (Path(__file__).parents[1] / "tasks").glob("*.py"):
        for body in file.read_text(encoding="utf-8").split("\nclass ")[1:]:
            if task := name.search(body):
                length = steps.search(body)
                found[task[1]] = int(length[1]) if length else MAX_EPISODE_STEPS
    return dict(sorted(found.items(), key=lambda pair: (len(pair[0]), pair[0])))


def _scenes_of_tasks() -> dict[tuple[str, str], dict[str, Any]]:
    """Files with scenes of an arm in one task, ``four_r_reach_around.yaml``, or in all tasks whose names end
    alike, ``four_r_around.yaml``; the arm begins as in the file of its reach scene."""
    names = {file.stem for file in config_folder("scenes").glob("*.yaml")}
    scenes: dict[tuple[str, str], dict[str, Any]] = {}
    for (arm, reach), task in itertools.product(SCENES.items(), TASKS):
        words = [word.lower() for word in re.findall("[A-Z][^A-Z]*", task)]
        files = ("_".join([reach.removesuffix("_reach"), *words[k:]]) for k in range(len(words)))
        if (file := next((file for file in files if file in names), reach)) != reach:
            scenes.setdefault(("the task", task), {})[arm] = file
    return scenes


SCENES = _scenes_of_arms()
"""Of arms in their environments, unless an arm has another one in a task."""
TASKS = _steps_of_tasks()
"""Control steps after which episodes of tasks are truncated."""
PAIR_SCENES = _scenes_of_tasks()
"""Scenes of pairs, by what names them: ("the task", its name) -> arms, ("the arm", its name) -> tasks."""
MOST_LISTED = 30
"""Ids that a message lists: those of this package."""
IDS: dict[str, Made] = {}  # all ids
HOMES: dict[tuple[str, str], str] = {}
"""("the arm" or "the task", its name) -> the module of its class and "/", for those registered from outside:
another process must import it for an environment, and entry points begin with it."""


def scene_of(arm: str, task: str) -> Any:
    """The scene of an arm in the environments of a task."""
    own = PAIR_SCENES.get(("the task", task), {}).get(arm) or PAIR_SCENES.get(("the arm", arm), {}).get(task)
    return own or SCENES[arm]


def ids() -> list[str]:
    """All registered ids."""
    return list(IDS)


def listed(ids: Iterable[str] | None = None) -> str:
    """Ids, or all that are registered, as a message lists them: without what all begin with."""
    names = [name.partition("/")[2] for name in (IDS if ids is None else ids)]
    more = [f"and {len(names) - MOST_LISTED} more"] if len(names) > MOST_LISTED else []
    return ", ".join([*names[:MOST_LISTED], *more])


def id_of(arm: str, task: str) -> str:
    """The id of a task with an arm."""
    return f"{NAMESPACE}/{arm}{task}-v0"


def full_id(name: str) -> str:
    """An id from a name with or without the namespace, and without the module that Gymnasium may import."""
    name = name.removeprefix(f"{NAMESPACE}:")
    return name if "/" in name else f"{NAMESPACE}/{name}"


def check_arm(env_id: str | None, kind: str) -> None:
    """Refuse a scene whose arm is not that of an id; without an id every arm fits."""
    if env_id is None or IDS[env_id].arm == kind:
        return
    arm, task = IDS[env_id]
    fitting = id_of(kind, task)
    fix = f"make {fitting} with it" if fitting in IDS else f"give a scene with a robot of type {arm}"
    raise ValueError(f"scene has the arm {kind}; {env_id} is an environment of {arm}: {fix}")


def check_motors(scene: Scene) -> None:
    """Refuse a scene without the limits in whose units actions are, or with limits in another unit."""
    if not scene.action_units() or scene.actuation != "joint":
        raise ValueError(
            "scene has no EffortLimits at joints, in whose units actions are; add them to its effects, with "
            "actuation 'joint'"
        )
    units = scene.units()
    for name, taken in zip(scene.action_units(), scene.command_units(), strict=True):
        known = units.get(name, units.get(name.partition("[")[0], taken))
        if known != taken:
            raise ValueError(
                f"actions are shares of {name}, which is in {known!r}, and the command of this motor is in "
                f"{taken!r}; let the effect that takes {taken!r} give its own numbers, by action_units"
            )


def _check_ids(arms: Iterable[str], tasks: Iterable[str]) -> None:
    """ValueError if an arm with a task would have the id of another arm with another task."""
    there = dict(IDS)
    for pair in itertools.starmap(Made, itertools.product(arms, tasks)):
        other = there.setdefault(id_of(*pair), pair)
        if other != pair:
            raise ValueError(
                f"{id_of(*pair)} is the id of the arm {other.arm} with the task {other.task} already; rename "
                "the arm or the task"
            )


def register() -> None:
    """Register all ids with Gymnasium; registering twice does nothing."""
    for arm in SCENES:
        for task, steps in TASKS.items():
            name, scene = id_of(arm, task), scene_of(arm, task)
            IDS[name], there = Made(arm, task), gym.registry.get(name)
            if there and (there.kwargs.get("scene"), there.max_episode_steps) == (scene, steps):
                continue
            gym.registry.pop(name, None)
            homes = dict.fromkeys(HOMES.get(key, "") for key in (("the arm", arm), ("the task", task)))
            entry = f"redundant_envs.envs.named:{''.join(homes)}{arm}{task}"
            gym.register(
                id=name,
                entry_point=f"{entry}Env",
                vector_entry_point=f"{entry}VectorEnv",
                max_episode_steps=steps,
                # Both wrappers take time at every step; the environments check their arguments themselves.
                order_enforce=False,
                disable_env_checker=True,
                kwargs={"scene": scene},
            )


def _add(what: str, registry: dict[str, Any], name: str, value: Any) -> None:
    """Add to a registry, unless the name belongs to something else; the same class may be reloaded."""
    there = registry.get(name, value)
    homes = {(x.__module__, getattr(x, "__qualname__", None)) for x in (value, there)}
    if there != value and (len(homes) > 1 or not isinstance(value, type)):
        raise ValueError(f"{what} {name!r} is taken by {there!r}; give yours another name")
    registry[name] = value
    outside = value.__module__.partition(".")[0] not in (NAMESPACE, "__main__", "builtins")
    HOMES[what, name] = f"{value.__module__}/" if outside else ""


def _check_name(what: str, name: Any) -> None:
    word = isinstance(name, str) and name.isidentifier() and name.isascii()
    if not word or name.endswith(("Vector", "Env")):
        raise ValueError(
            f"{what} is called {name!r}; give a name of letters and digits, as ids have, that does not end "
            "with Vector or Env"
        )


def register_arm(
    arm: type[Arm], scene: Given | None = None, scenes: Mapping[str, Given] | None = None
) -> None:
    """Let scenes name an arm, and ``gymnasium.make`` its environments; ValueError if another arm has the name
    or one of the ids, or a scene is not one of this arm.

    Parameters
    ----------
    arm : subclass of Arm
        Its ``kind``, by default the name of the class, is its name in scenes and ids.
    scene : mapping or path of a YAML file, optional
        For its environments ``redundant_envs/<kind><task>-v0``, one per task; without a scene it has none.
    scenes : mapping of str to mapping or path, optional
        Names of tasks -> the scenes of its environments with these tasks, if they are others, such as one
        with obstacles: ``{"ReachAround": "my_arm_among_discs.yaml"}``.
    """
    from redundant_envs import robots
    from redundant_envs.scenes.scene import load_scene
    from redundant_envs.support.values import plain_data

    if not (isinstance(arm, type) and issubclass(arm, robots.Arm)):
        raise ValueError(f"arm is {arm!r}; give a class derived from redundant_envs.Arm")
    if issubclass(arm, robots.Chain):
        types = getattr(arm, "joint_types", "RPR")
        raise ValueError(
            f"arm is Chain, which scenes know; for environments give the arm a class and a name of its own: "
            f"class {types}(rde.Arm): joint_types = {types!r}"
        )
    _check_name("the arm", getattr(arm, "kind", None))
    before = dict(robots.REGISTRY)
    if scene is None and scenes:
        raise ValueError("scenes is given without scene; give the arm's scene in all other tasks, too")
    if scene is not None:
        _check_ids([arm.kind], TASKS)
    _check_names("scenes", scenes, TASKS, "a task")
    _add("the arm", robots.REGISTRY, arm.kind, arm)
    if scene is None:
        return
    try:
        _check_scene("scene", load_scene(scene), arm.kind)
        for task, other in (scenes or {}).items():
            _check_scene(f"scenes[{task!r}]", load_scene(other), arm.kind)
    except Exception:
        robots.REGISTRY.clear()
        robots.REGISTRY.update(before)
        raise
    SCENES[arm.kind] = plain_data(scene)
    PAIR_SCENES["the arm", arm.kind] = plain_data(dict(scenes or {}))
    register()


def _check_names(field: str, scenes: Any, known: Iterable[str], what: str) -> None:
    """ValueError unless scenes, if there are any, are a mapping from known names."""
    from redundant_envs.support.values import shown

    if scenes is not None and not isinstance(scenes, Mapping):
        raise ValueError(f"{field} is {shown(scenes)}; give a mapping from the names of {what} to scenes")
    for name in scenes or ():
        if name not in known:
            raise ValueError(f"{field} has {what} {name!r}; choose from {', '.join(known)}")


def _check_scene(field: str, scene: Scene, kind: str) -> None:
    """ValueError unless a scene can be an environment of an arm."""
    from redundant_envs.simulator.lane.dynamics import Dynamics

    if scene.robot.kind != kind:
        raise ValueError(f"{field} has the arm {scene.robot.kind}; give one with a robot of type {kind}")
    check_motors(scene)
    loose = ", ".join(scene.robot.joints[k] for k in scene.robot.sliders() if k not in scene.travel())
    if loose:
        raise ValueError(f"scene leaves {loose} without limits; add a PrismaticStop with both ends")
    Dynamics(scene).parameters.prepared  # noqa: B018 - it says what error control lacks


def register_task(task: type[Task], scenes: Mapping[str, Given] | None = None) -> None:
    """Let ``gymnasium.make`` know a task: ``redundant_envs/<arm><name>-v0`` for every arm with a scene;
    ValueError if another task has the name, one of its ids is taken, or a scene is not one of its arm.

    Parameters
    ----------
    task : subclass of Task
        Its ``name`` is its name in ids; an episode has its ``steps``.
    scenes : mapping of str to mapping or path, optional
        Names of arms -> their scenes in the environments of this task, such as those with obstacles:
        ``{"FourR": "four_r_among_discs.yaml"}``. The other arms have the scenes of their reach tasks. Whether
        the task can do with a scene is known when an environment is made.
    """
    from redundant_envs import tasks
    from redundant_envs.scenes.scene import load_scene
    from redundant_envs.support.values import plain_data

    if not (isinstance(task, type) and issubclass(task, tasks.Task)):
        raise ValueError(f"task is {task!r}; give a class derived from redundant_envs.Task")
    _check_name("the task", getattr(task, "name", None))
    _check_steps(task)
    _check_ids(SCENES, [task.name])
    _check_names("scenes", scenes, SCENES, "an arm")
    for arm, scene in (scenes or {}).items():
        _check_scene(f"scenes[{arm!r}]", load_scene(scene), arm)
    _add("the task", tasks.REGISTRY, task.name, task)
    TASKS[task.name] = task.steps
    if scenes is not None or task.name not in tasks.OWN:
        PAIR_SCENES["the task", task.name] = plain_data(dict(scenes or {}))
    register()


def _check_steps(task: type[Task]) -> None:
    """ValueError unless a task says how long its episodes are."""
    from redundant_envs.support.values import shown

    whole = isinstance(task.steps, int) and not isinstance(task.steps, bool)
    if not whole or task.steps < 1:
        raise ValueError(f"{task.__name__}.steps is {shown(task.steps)}; give a whole number of at least 1")


def register_effect(effect: type[Effect]) -> None:
    """Let scene files name an effect by its class; ValueError if another effect has the name."""
    from redundant_envs import effects

    if not (isinstance(effect, type) and issubclass(effect, effects.Effect)):
        raise ValueError(f"effect is {effect!r}; give a class derived from redundant_envs.effects.Effect")
    if effect is effects.Effect:
        raise ValueError("effect is the base of all effects; give a class derived from it")
    _add("the effect", effects.REGISTRY, effect.__name__, effect)


def register_integrator(method: Tableau) -> None:
    """Let scenes name an explicit Runge-Kutta method, which takes equal steps; ValueError if another method
    has the name, or the tableau is not that of an explicit method."""
    from redundant_envs.scenes import tableaus

    if not isinstance(method, tableaus.Tableau):
        raise ValueError(f"method is {method!r}; give a redundant_envs.Tableau")
    method.check()
    _add("the integrator", tableaus.METHODS, method.name, method)
