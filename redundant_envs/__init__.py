"""Torque-controlled planar redundant arms: closed-form dynamics as fast Gymnasium environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import redundant_envs.compiler.backends.numpy  # noqa: F401 - functions of the dialect then know arrays
from redundant_envs.envs import registration as _registration

if TYPE_CHECKING:
    from redundant_envs import effects
    from redundant_envs.envs.animation import animate
    from redundant_envs.envs.check import check_vec_env
    from redundant_envs.envs.registration import (
        register_arm,
        register_effect,
        register_integrator,
        register_task,
    )
    from redundant_envs.envs.sb3 import make_sb3 as make_sb3  # not in __all__
    from redundant_envs.envs.torch_env import make_torch as make_torch  # not in __all__
    from redundant_envs.model.batch import BatchSimulator, Event, Numerics
    from redundant_envs.model.listing import bill, listing
    from redundant_envs.model.torch_step import torch_step as torch_step  # not in __all__
    from redundant_envs.model.trajectory import simulate
    from redundant_envs.robots import RPRP, Arm, Chain, FourR, TwoR
    from redundant_envs.scenes.scene import Scene, load_scene
    from redundant_envs.scenes.tableaus import Tableau
    from redundant_envs.tasks import GoalReachTask, ReachTask, Task

__version__ = "0.1.0"

_NAMES = {
    "robots": ("Arm", "RPRP", "FourR", "TwoR", "Chain"),
    "scenes.scene": ("Scene", "load_scene"),
    "model.batch": ("BatchSimulator", "Event", "Numerics"),
    "model.trajectory": ("simulate",),
    "model.listing": ("bill", "listing"),
    "model.torch_step": ("torch_step",),
    "envs.animation": ("animate",),
    "envs.sb3": ("make_sb3",),
    "envs.torch_env": ("make_torch",),
    "envs.check": ("check_vec_env",),
    "envs.registration": ("register_arm", "register_effect", "register_integrator", "register_task"),
    "tasks": ("Task", "ReachTask", "GoalReachTask"),
    "scenes.tableaus": ("Tableau",),
}
_HOMES = {name: f"{home}:{name}" for home, names in _NAMES.items() for name in names}
_HOMES["effects"] = "effects"  # a module itself
__all__ = [
    "RPRP", "Arm", "BatchSimulator", "Chain", "Event", "FourR", "GoalReachTask", "Numerics", "ReachTask",
    "Scene", "Tableau", "Task", "TwoR", "animate", "bill", "check_vec_env", "effects", "listing",
    "load_scene", "register_arm", "register_effect", "register_integrator", "register_task", "simulate",
]  # fmt: skip
"""The public names, but for ``make_sb3``, ``make_torch`` and ``torch_step``: these need torch, and
``import *`` must not."""

_registration.register()


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: importing the package stays fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'redundant_envs' has no attribute {name!r}")
    from pkgutil import resolve_name

    return resolve_name(f"redundant_envs.{_HOMES[name]}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
