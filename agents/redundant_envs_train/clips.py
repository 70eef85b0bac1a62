"""Whole episodes as clips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.clips import check_clip, write_clip

from .rollout import Act

CLIP_EVERY = 2
"""Control steps from frame to frame."""


def clip(paths: list[Path], env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> None:
    """Whole episodes as clips, one for each path: GIF or MP4 by its ending."""
    for path in paths:
        check_clip(path)
    env = gym.make(env_id, render_mode="rgb_array", **kwargs)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    frames: list[NDArray[np.uint8]] = []
    for episode in range(episodes):
        obs, _ = env.reset(seed=seed + episode)
        done, step = False, 0
        while not done:
            obs, _, terminated, truncated, _ = env.step(act(batched(obs), core, step)[0])
            done = terminated or truncated
            step += 1
            if step % CLIP_EVERY == 0:
                frames.append(np.asarray(env.render()))
    env.close()
    for path in paths:
        write_clip(path, frames, round(1.0 / (CLIP_EVERY * core.scene.control_dt)))


def batched(obs: Any) -> Any:
    """One observation as a batch of one."""
    if isinstance(obs, dict):
        return {k: v[None] for k, v in obs.items()}
    return obs[None]
