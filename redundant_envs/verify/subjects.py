"""Subjects named on the command line: arms, scenes, effects, tasks and environments, each as a scene."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import cycle, islice
from typing import Any

from redundant_envs.effects import REGISTRY as EFFECTS
from redundant_envs.effects import Effect, Field, Gravity
from redundant_envs.envs import registration
from redundant_envs.robots import REGISTRY as ARMS
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene, load_scene, scene_names
from redundant_envs.support.modules import module_named
from redundant_envs.support.values import required, shown
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs.tasks import Task

TOLERANCE = 1e-6  # tip error [m] of scenes made here: the standard accuracy of the environments
MASSES, LENGTHS = (2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)  # kg, m: equal ones would hide mistakes


@dataclass(frozen=True)
class Subject:
    """A verified object."""

    name: str  # the word that names it
    scene: Scene  # with the arm or effect in question, or that of the environment
    env_id: str | None = None  # of an environment, or of the environment of a task
    task: Mapping[str, Any] | None = None  # numbers of the task other than its defaults


def subjects_of(words: Iterable[str]) -> list[Subject]:
    """The subjects that some words name; all named scenes if there is no word."""
    return [subject_of(word) for word in [*words] or scene_names()]


def subject_of(word: str) -> Subject:
    """The subject of a word: a scene by name or file, an id with or without its namespace, a registered arm,
    effect or task, or ``module:object`` that is one of these."""
    if word.endswith((".yaml", ".yml")) or word in scene_names():
        return Subject(word, load_scene(word))
    if ":" in word:
        return subject_from(word, _imported(word))
    env_id = word if "/" in word else f"{registration.NAMESPACE}/{word}"
    if env_id in registration.IDS:
        return _environment(word, env_id)
    if word in (registered := {**TASKS, **EFFECTS, **ARMS}):
        return subject_from(word, registered[word])
    raise ValueError(
        f"{shown(word)} is nothing that verify knows; give a scene ({', '.join(scene_names())}), a file of "
        f"one (.yaml), an id ({', '.join(registration.ids())}), an arm ({', '.join(ARMS)}), an effect "
        f"({', '.join(EFFECTS)}), a task ({', '.join(TASKS)}) or module:object"
    )


def kind_of(thing: Any) -> type[Any]:
    return thing if isinstance(thing, type) else type(thing)


def subject_from(name: str, thing: Any) -> Subject:
    """The subject of an arm, scene, effect or task, or of a class of these, called ``name``."""
    kind = kind_of(thing)
    if thing is kind and issubclass(kind, Arm | Effect | Task) and kind not in (Arm, Effect, Task):
        thing = _made(name, kind)
    if isinstance(thing, Subject):
        return thing
    if isinstance(thing, Scene):
        return Subject(name, thing)
    if isinstance(thing, Arm):
        return Subject(name, Scene(thing, (Gravity(),), tolerance=TOLERANCE))
    if isinstance(thing, Effect):
        return Subject(name, effect_scene(name, thing))
    if isinstance(thing, Task):
        if TASKS.get(kind.name) is not kind:
            registration.register_task(kind)
        own = registration.PAIR_SCENES.get(("the task", kind.name), {})
        arm = next(iter((*own, *registration.SCENES)))  # the first with a scene for the task, or at all
        return _environment(name, registration.id_of(arm, kind.name), thing.parameters())
    raise ValueError(
        f"{name} is {shown(thing)}; verify takes an arm, a scene, an effect or a task, or a class of these"
    )


def effect_scene(name: str, effect: Effect) -> Scene:
    """A scene with an effect on the first arm that it fits, in a vertical plane."""
    refused = []
    for kind in (k for k in ARMS.values() if hasattr(k, "coordinates")):  # Chain's follow from its numbers
        try:
            arm = _made(name, kind)
            fitted = effect.fitted(arm).at_interval(Scene.control_dt)
            fields = any(isinstance(h, Field) for h in fitted.hooks(arm))
            return Scene(arm, (effect,) if fields else (Gravity(), effect), tolerance=TOLERANCE)
        except ValueError as error:
            refused.append(f"{kind.kind}: {error}")
    raise ValueError(f"{name} fits no arm; {'; '.join(refused)}")


def _imported(word: str) -> Any:
    module, _, path = word.partition(":")
    try:
        thing: Any = module_named(module)
    except ModuleNotFoundError as error:
        raise ValueError(f"{word}: {error}; give modules that lie in this folder, or install them") from None
    for part in path.split("."):
        if not hasattr(thing, part):
            keys = [n for n, v in vars(thing).items() if issubclass(kind_of(v), Arm | Scene | Effect | Task)]
            raise ValueError(f"{word}: {module} has no {part!r}; verify takes {', '.join(keys) or 'nothing'}")
        thing = getattr(thing, part)
    return thing


def _made(name: str, kind: type[Any]) -> Any:
    """An arm with :data:`MASSES` and :data:`LENGTHS`, or an effect or a task with its defaults."""
    numbers: dict[str, Any] = {}
    if issubclass(kind, Arm) and hasattr(kind, "num_masses"):  # a Chain has its counts with its numbers
        numbers["masses"] = tuple(islice(cycle(MASSES), kind.num_masses))
        numbers["lengths"] = tuple(islice(cycle(LENGTHS), kind.num_lengths))
    missing = [field for field in required(kind) if field not in numbers]
    if missing:
        raise ValueError(
            f"{name}: {kind.__name__} has no default of {', '.join(missing)}; name one that has its numbers, "
            "module:object, or a scene with it"
        )
    return kind(**numbers)


def _environment(name: str, env_id: str, task: Mapping[str, Any] | None = None) -> Subject:
    return Subject(name, load_scene(registration.scene_of(*registration.IDS[env_id])), env_id, task)
