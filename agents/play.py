"""Watch an environment: a trained policy, or zero, random or expert actions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym

import redundant_envs  # noqa: F401  (registers the ids)
from agents.report import batched, clip, read_config
from agents.rollout import Act, expert_act, policy_act, random_act, zero_act
from redundant_envs.envs.registration import NAMESPACE, ids


def play(target: str, actions: str | None, path: Path | None, episodes: int, seed: int) -> None:
    """Show episodes in a window, or write them to a GIF, and print how each one ended."""
    kwargs: dict[str, Any] = {}
    if Path(target).is_dir():
        from agents.train import load_policy

        if actions is not None:
            raise ValueError(f"--actions is {actions!r}; a run folder plays its policy: give an id")
        config = read_config(Path(target))
        env_id, kwargs = config.env, dict(config.env_kwargs)
        act = policy_act(load_policy(Path(target), config.algo))
    else:
        env_id = target if "/" in target else f"{NAMESPACE}/{target}"
        if env_id not in ids():
            raise ValueError(f"target is {target!r}; give a run folder or one of {', '.join(ids())}")
        act = {"zero": zero_act, "random": lambda: random_act(seed), "expert": expert_act}[
            actions or "expert"
        ]()
    if path is not None:
        clip(path, env_id, act, episodes, seed, **kwargs)
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
