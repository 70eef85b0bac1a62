"""The classes behind the ids, created when they are requested; their pages are generated from the code."""

from __future__ import annotations

import functools
import importlib
from typing import Any

from redundant_envs.envs.env import ArmEnv, GoalArmEnv
from redundant_envs.envs.registration import IDS, SCENES
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.tasks import REGISTRY as TASKS


class _Page:
    """A docstring written when it is read: building a page costs nothing at import.

    That of an environment has its methods and values, too. So ``help`` of an environment shows this text; of
    a class it adds the members of all bases, Gymnasium's among them.
    """

    def __get__(self, instance: Any, owner: type[Any]) -> str:
        from redundant_envs.envs.pages import members, page

        if issubclass(owner, ArmVectorEnv):
            single = owner.__name__.removesuffix("VectorEnv") + "Env"
            text = f"Native vector form of {single}. Its page: help({owner.__module__}.{single})\n"
        else:
            text = page(owner, SCENES[IDS[owner.env_id].arm])
        return text if instance is None else f"{text}\n{members(owner)}"


def __getattr__(name: str) -> type[Any]:
    """The class of an id: ``RPRPReachEnv``, ``RPRPReachVectorEnv``; "my_arms/ThreeRReachEnv" imports my_arms,
    which registers it."""
    *modules, name = name.split("/")
    for module in modules:
        importlib.import_module(module)
    for env_id, (arm, task) in IDS.items():  # noqa: B007 - the last one is used
        if name in (f"{arm}{task}Env", f"{arm}{task}VectorEnv"):
            break
    else:
        raise AttributeError(
            f"module {__name__!r} has no class {name!r}; if it is of an arm or task of yours, import the "
            "module that registers it first"
        )
    return _made(name, env_id, task, TASKS[task])  # type: ignore[arg-type]  # classes are hashable


@functools.cache
def _made(name: str, env_id: str, task: str, kind: type[Any]) -> type[Any]:
    """The class, created again if the module of the task was reloaded."""
    home: dict[str, Any] = {"__module__": __name__, "__qualname__": name, "env_id": env_id, "task_name": task}
    base: type[Any] = GoalArmEnv if kind.goal_conditioned else ArmEnv
    if name.endswith("VectorEnv"):
        base = ArmVectorEnv
    return type(name, (base,), {**home, "__doc__": _Page()})
