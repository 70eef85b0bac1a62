"""The classes behind the ids, created when they are requested; their pages are generated from the code."""

import contextlib
import functools
import importlib
import inspect
import math
import re
from pathlib import Path
from typing import Any

import gymnasium as gym

from redundant_envs.envs import arguments
from redundant_envs.envs.env import ArmEnv, GoalArmEnv
from redundant_envs.envs.outputs import ALL, Columns
from redundant_envs.envs.registration import IDS, scene_of
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.language.algebra import gives_of
from redundant_envs.model.programs import environment_simulator
from redundant_envs.scenes.files import read_yaml
from redundant_envs.scenes.scene import Scene, load_scene
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.support.tables import markdown
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs.tasks import Task

ENTRY = re.compile(r"^(\w+(?:, \w+)*) : .*\n((?: +.*\n?|\n)+)", re.MULTILINE)  # under "Parameters"


class _Page:
    """A docstring written when it is read: building a page costs nothing at import."""

    def __get__(self, instance: Any, owner: type[Any]) -> str:
        if issubclass(owner, ArmVectorEnv):
            single = owner.__name__.removesuffix("VectorEnv") + "Env"
            return f"Native vector form of {single}. Its page: help({owner.__module__}.{single})\n"
        return page(owner, scene_of(*IDS[owner.env_id]))


def __getattr__(name: str) -> type[Any]:
    """The class of an id: ``RPRPReachEnv``, ``RPRPReachVectorEnv``; "my_arms/ThreeRReachEnv" imports my_arms,
    which registers it."""
    *modules, name = name.split("/")
    for module in modules:
        importlib.import_module(module)
    classes = {f"{arm}{task}{kind}": i for i, (arm, task) in IDS.items() for kind in ("Env", "VectorEnv")}
    if name not in classes:
        raise AttributeError(
            f"module {__name__!r} has no class {name!r}; if it is of an arm or task of yours, import the "
            "module that registers it first"
        )
    env_id = classes[name]
    task = IDS[env_id].task
    return _made(name, env_id, task, TASKS[task])  # type: ignore[arg-type]  # classes are hashable


@functools.cache
def _made(name: str, env_id: str, task: str, kind: type[Any]) -> type[Any]:
    """The class, created again if the module of the task was reloaded."""
    home: dict[str, Any] = {"__module__": __name__, "__qualname__": name, "env_id": env_id, "task_name": task}
    # Libraries such as skrl look for a class of Gymnasium among the direct bases.
    bases: tuple[type[Any], ...] = (GoalArmEnv if kind.goal_conditioned else ArmEnv, gym.Env)
    if name.endswith("VectorEnv"):
        bases = ArmVectorEnv, gym.vector.VectorEnv
    return type(name, bases, {**home, "__doc__": _Page()})


@functools.cache
def texts() -> dict[str, Any]:
    """Sentences and paragraphs of the pages, with names in braces."""
    return read_yaml(Path(__file__).with_name("pages.yaml"), "text")  # type: ignore[no-any-return]


def action_table(scene: Scene) -> str:
    values = scene.parameters()
    units = zip(scene.robot.joints, scene.action_units(), scene.command_units(), strict=True)
    what = "effort" if {*scene.command_units()} <= {"N", "N m"} else "command"
    rows = [
        (k, f"{what} at {joint} / {values[limit]:g} {unit}", -1, 1, joint, unit)
        for k, (joint, limit, unit) in enumerate(units)
    ]
    return markdown(("Num", "Action", "Control Min", "Control Max", "Joint", f"Unit of the {what}"), rows)


def mode_table(scene: Scene) -> str:
    """The modes of actions with what an action of 1 is in each."""
    rows = []
    for name in arguments.modes():
        with contextlib.suppress(ValueError):  # of a mode that does not fit the arm
            made = arguments.with_mode(scene, name)
            pairs = zip(made.action_units(), made.command_units(), strict=True)
            rows.append(
                (f"`{name}`", ", ".join(f"{made.parameters()[n]:.4g} {u}".rstrip() for n, u in pairs))
            )
    return markdown(("`action`", "An action of 1 is"), rows, formatted=True)


def reward_table(scene: Scene, task: Task) -> str:
    """Reward terms with the formulas that their functions state."""
    rows = []
    for function in task.reward_functions(scene):
        formula = (function.__doc__ or "").partition("\n")[0]
        names = [term.removesuffix("_term") for term in gives_of(function)]
        rows += [(name, f"`{formula}`", f"`return_{name}`") for name in names]
    return markdown(("Term", "Value per step", "Sum over the episode in info"), rows, formatted=True)


def episode_of(scene: Scene, task: Task) -> Episode:
    """What an environment simulates."""
    episode = environment_simulator(scene, task).episode
    assert episode is not None
    return episode


def info_table(scene: Scene, task: Task) -> str:
    """Keys of info: those of the environment's columns, then those of some scenes or environments only."""
    episode = episode_of(scene, task)
    keys = ["return_*" if name.startswith("return_") else name for name in Columns(episode, ALL).names]
    meanings, only_in = texts()["info"], texts()["only_in"]
    rows = [
        (f"`{name}`", meanings.get(name, "A metric of the task."), only_in.get(name, ""))
        for name in dict.fromkeys((*keys, *only_in))
    ]
    return markdown(("Key", "Meaning", "Only in"), rows, formatted=True)


def takes_goal(scene: Scene, task: Task) -> bool:
    """Whether a reset may set the goal."""
    episode = episode_of(scene, task)
    return bool(episode.goal) and not episode.replaces_goal


def argument_table(kind: type[Any]) -> str:
    """Keyword arguments of the constructor with their defaults."""
    defaults = {name: f"`{p.default!r}`" for name, p in inspect.signature(kind).parameters.items()}
    defaults["scene"] = "of the id"
    rows = [(f"`{name}`", default, texts()["arguments"][name]) for name, default in defaults.items()]
    return markdown(("Parameter", "Default", "Description"), rows, formatted=True)


def task_table(task: Task) -> str:
    """Numbers of the task, with the sentences of its docstring."""
    sentences = meanings(type(task))
    rows = []
    for name in task.numbers():
        low, high = task.ranges.get(name, (0.0, math.inf))
        allowed = "positive" if high == math.inf else f"above 0, at most {high:g}"
        allowed = f"{low:g} to {high:g}" if low != 0.0 else allowed
        allowed = "true or false" if isinstance(getattr(task, name), bool) else allowed
        row = f"`{name}`", getattr(task, name), task.units.get(name, ""), allowed, sentences.get(name, "")
        rows.append(row)
    return markdown(("Number", "Default", "Unit", "Allowed", "Meaning"), rows, formatted=True)


def meanings(kind: type[Any]) -> dict[str, str]:
    """What the numbers of a class mean: the "Parameters" of its docstring and of those of its bases."""
    sentences: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        section = text.partition("Parameters\n----------\n")[2].partition("\n---")[0]
        for names, sentence in ENTRY.findall(section):
            sentences |= dict.fromkeys(names.split(", "), " ".join(sentence.split()))
    return sentences


def page(kind: type[Any], scene_name: Any) -> str:
    """The docstring of an environment under Gymnasium's headings."""
    scene, task = load_scene(scene_name), TASKS[kind.task_name]()
    arm, joints = scene.robot, len(scene.robot.joints)
    sliders, fast = any(arm.prismatic), f"4 a velocity beyond {task.speed_bound:g} rad/s or m/s, "
    slider = ", and `#` is a slider, whose\ntravel r extends its link" if sliders else ""
    observed = [(k, text, -1, 1) for k, text in enumerate(task.observation(scene).values())]
    return texts()["page"].format(  # type: ignore[no-any-return]
        arm=arm,
        task=task,
        joints=joints,
        drawn=texts()["drawing"].format(arm=arm, joints=joints, slider=slider) if arm.schematic else "",
        name=scene_name if isinstance(scene_name, str) else "given where the arm is registered",
        masses=", ".join(f"{x:g}" for x in arm.masses),
        lengths=", ".join(f"{x:g}" for x in arm.lengths),
        effects=", ".join(type(effect).__name__ for effect in scene.effects),
        dt=scene.control_dt,
        rate=1 / scene.control_dt,
        accuracy=f"to a tip error of {scene.tolerance:g} m" if scene.tolerance else f"by {scene.integrator}",
        redundant=texts()["redundant"].format(joints=joints) if joints > 2 else "",
        of_goals=texts()["of_goals"] if task.goal_conditioned else "",
        starts=task.pose_note(),
        ends_by=task.end_note(),
        travel="; prismatic\njoints uniform over their travel" if sliders else "",
        ends=fast if task.speed_bound_ends else "",
        flags="" if task.speed_bound_ends else fast,
        observed=len(observed),
        actions=action_table(scene),
        modes=mode_table(scene),
        observations=markdown(("Num", "Observation", "Min", "Max"), observed),
        rewards=reward_table(scene, task),
        reward_note=task.reward_note(),
        success_note=task.success_note(),
        start_note=task.start_note(),
        most_steps=task.steps,
        options="`q`, `qd`, `goal` and `parameters`"
        if takes_goal(scene, task)
        else "`q`, `qd` and `parameters`",
        info=info_table(scene, task),
        arguments=argument_table(kind),
        numbers=task_table(task),
    )
