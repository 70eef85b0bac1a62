"""Watch an environment: a trained policy, or zero, random or expert actions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym

import redundant_envs  # noqa: F401  (registers the ids)
from redundant_envs.envs.registration import NAMESPACE, ids
from redundant_envs.extras import needs
from redundant_envs.studies.clips import check_clip

from .report import batched, clip
from .rollout import Act, expert_act, policy_act, random_act, zero_act
from .run_folder import read_config


def play(
    target: str, actions: str | None, path: Path | None, episodes: int, seed: int, trust: bool = False
) -> None:
    """Show episodes in a window and print how each one ended, or write them to a clip.

    Parameters
    ----------
    target : str
        Run folder, or id of an environment.
    actions : {"zero", "random", "expert"}, optional
        For an id.
    path : Path, optional
        GIF or MP4 by its ending; without it a window opens.
    episodes, seed : int
        How many, at least 1; episode i has the seed ``seed + i``.
    trust : bool
        That of :func:`load_policy`.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}; give at least 1")
    if path is not None:
        check_clip(path)
    else:
        with needs("human"):
            import pygame  # noqa: F401
    kwargs: dict[str, Any] = {}
    if Path(target).exists():
        from .policies import load_policy

        if actions is not None:
            raise ValueError(f"--actions is {actions!r}; a run folder plays its policy: give an id")
        config = read_config(Path(target))
        env_id, kwargs = config.env, dict(config.env_kwargs)
        act = policy_act(load_policy(Path(target), config, trust))
    else:
        env_id = target if "/" in target else f"{NAMESPACE}/{target}"
        if env_id not in ids():
            raise ValueError(f"target is {target!r}; give a run folder or one of {', '.join(ids())}")
        act = {"zero": zero_act, "random": lambda: random_act(seed), "expert": expert_act}[
            actions or "expert"
        ]()
    if path is not None:
        clip([path], env_id, act, episodes, seed, **kwargs)
        print(f"clip: {path}")
        return
    env = gym.make(env_id, render_mode="human", **kwargs)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    for episode in range(episodes):
        print(f"seed {seed + episode}: {_episode(env, core, act, seed + episode)}")
    env.close()


def _episode(env: Any, core: Any, act: Act, seed: int) -> str:
    obs, info = env.reset(seed=seed)
    done, step = False, 0
    while not done:
        obs, _, terminated, truncated, info = env.step(act(batched(obs), core, step)[0])
        done = terminated or truncated
        step += 1
    end = "held" if info["is_success"] else "touched" if info["touch_success"] else "missed"
    return f"{end}, {1000 * info['distance']:.1f} mm from the goal after {step} steps"
