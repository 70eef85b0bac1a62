"""Ids of the environments. Imported by ``import redundant_envs``; imports no numerics itself."""

from __future__ import annotations

import gymnasium as gym

NAMESPACE = "redundant_envs"
MAX_EPISODE_STEPS = 100
SCENES = {"RPRP": "rprp_reach", "FourR": "four_r_reach"}

ARGUMENTS = ("scene", "accuracy", "task", "on_bad_action", "max_episode_steps")
"""What all environments take at their making, beside their number and what draws them."""


def ids() -> list[str]:
    """All registered ids."""
    return [f"{NAMESPACE}/{arm}{kind}-v0" for arm in SCENES for kind in ("Reach", "GoalReach")]


def check_arm(env_id: str | None, kind: str) -> None:
    """Refuse a scene whose arm is not that of an id; without an id every arm fits."""
    if env_id is None:
        return
    name = env_id.removeprefix(f"{NAMESPACE}/")
    arm = next(a for a in SCENES if name.startswith(a))
    if arm == kind:
        return
    fitting = f"{NAMESPACE}/{kind}{name.removeprefix(arm)}"
    fix = f"make {fitting} with it" if fitting in ids() else f"give a scene with a robot of type {arm}"
    raise ValueError(f"scene has the arm {kind}; {env_id} is an environment of {arm}: {fix}")


def register() -> None:
    """Register all ids with Gymnasium; registering twice does nothing."""
    for arm, scene in SCENES.items():
        for kind in ("Reach", "GoalReach"):
            name = f"{NAMESPACE}/{arm}{kind}-v0"
            if name in gym.registry:
                continue
            gym.register(
                id=name,
                entry_point=f"redundant_envs.envs.named:{arm}{kind}Env",
                vector_entry_point=f"redundant_envs.envs.named:{arm}{kind}VectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                kwargs={"scene": scene},
            )
