"""The classes behind the ids, made when they are asked for; their pages are written from the code."""

from __future__ import annotations

from typing import Any

from redundant_envs.envs.env import ArmEnv, GoalArmEnv
from redundant_envs.envs.registration import IDS, SCENES
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.tasks import REGISTRY as TASKS


class _Page:
    """A docstring written when it is read: building a page costs nothing at import."""

    def __get__(self, instance: Any, owner: type[Any]) -> str:
        from redundant_envs.envs.pages import page

        return page(owner, SCENES[IDS[owner.env_id].arm])


def __getattr__(name: str) -> type[Any]:
    """The class of an id: ``RPRPReachEnv``, ``RPRPReachVectorEnv``."""
    for env_id, (arm, task) in IDS.items():  # noqa: B007 - the last one is used
        if name in (f"{arm}{task}Env", f"{arm}{task}VectorEnv"):
            break
    else:
        raise AttributeError(
            f"module {__name__!r} has no class {name!r}; if it is of an arm or task of yours, import the "
            "module that registers it first"
        )
    home: dict[str, Any] = {"__module__": __name__, "__qualname__": name, "env_id": env_id, "task_name": task}
    single: type[Any] = GoalArmEnv if TASKS[task].goal_conditioned else ArmEnv
    if name.endswith("VectorEnv"):
        made = type(name, (ArmVectorEnv,), {**home, "__doc__": f"Native vector form of {arm}{task}."})
    else:
        made = type(name, (single,), {**home, "__doc__": _Page()})
    globals()[name] = made
    return made
