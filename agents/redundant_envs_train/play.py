"""Watch an environment: a trained policy, or zero, random, expert or near actions."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.experts import baseline_of
from redundant_envs.envs.registration import full_id, ids, listed
from redundant_envs.scenes.files import exists
from redundant_envs.support.extras import needs
from redundant_envs.support.figures import check_clip, write_clip
from redundant_envs.support.values import check_between, say, shown

from .config import MAX_EPISODES, Config
from .rollout import Act, expert_act, policy_act, random_act, stacked
from .run_folder import own_config, tell_differences

ACTIONS: dict[str, Callable[[int], Act]] = {
    "zero": lambda seed: lambda obs, core, step: np.zeros((core.num_envs, len(core.actions)), np.float32),
    "random": random_act, "expert": lambda seed: expert_act(), "near": lambda seed: expert_act(baseline_of),
}  # fmt: skip
"""Sources of actions without a policy, from a seed."""
CLIP_EVERY = 2  # control steps from frame to frame, unless a decision takes more
LARGEST_CLIP = 1 << 29
"""Bytes of the frames of a clip, which all are in memory until it is written: half a minute by default."""


def play(
    target: str, actions: str | None, path: Path | None, episodes: int, seed: int, trust: bool = False
) -> None:
    """Show episodes, with seeds ``seed + i``, in a window and print how each one ended, or write them to a
    clip, a GIF or MP4. ``target`` is the folder of a policy, or an environment's id, with ``actions``."""
    check_between("episodes", episodes, 1, MAX_EPISODES)
    check_between("seed", seed, 0, 2**63)
    if path is not None:
        check_clip(path)
    else:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        with needs("human"):
            import pygame  # noqa: F401
        from redundant_envs.envs.rendering import display

        display()  # a missing one is told before a policy is read
    kwargs: dict[str, Any] = {}
    if exists(Path(target)):
        if actions is not None:
            raise ValueError(f"--actions is {shown(actions)}; a run folder plays its policy: give an id")
        config = own_config(Path(target))
        act = act_of(Path(target), config, trust)
        env_id, kwargs = config.env, dict(config.env_kwargs)
    else:
        env_id, who = full_id(target), "expert" if actions is None else actions
        if env_id not in ids():
            raise ValueError(f"target is {shown(target)}; give a run folder or one of {listed()}")
        if who not in ACTIONS:
            raise ValueError(f"--actions is {shown(who)}; choose {', '.join(ACTIONS)}")
        act = ACTIONS[who](seed)
    if path is not None:
        clip(path, env_id, act, episodes, seed, **kwargs)
        say(f"clip: {path}")
        return
    env = gym.make(env_id, render_mode="human", **kwargs)
    for episode in range(episodes):
        say(f"seed {seed + episode}: {_episode(env, act, seed + episode, lambda step: None)}")
    env.close()


def act_of(folder: Path, config: Config, trust: bool) -> Act:
    """The policy of a folder; a line on stderr tells of another scene than its configuration names today."""
    tell_differences([folder])
    from .policies import load_policy  # imports torch

    return policy_act(load_policy(folder, config, trust))


def _episode(env: Any, act: Act, seed: int, after_step: Callable[[int], Any]) -> str:
    """Run an episode and say how it ended; ``after_step`` gets its steps so far, first 0, and ends it by
    True."""
    obs, info = env.reset(seed=seed)
    core, done, step, returned = env.unwrapped.core, bool(after_step(0)), 0, 0.0
    while not done:
        obs, reward, terminated, truncated, info = env.step(act(stacked([obs]), core, step)[0])
        returned += float(reward)
        step += 1
        done = bool(after_step(step)) or terminated or truncated
    parts = []
    if "is_success" in info:
        parts.append("held" if info["is_success"] else "touched" if info.get("touch_success") else "missed")
    if "distance" in info:
        parts.append(f"{1000 * info['distance']:.1f} mm from the goal")
    return f"{', '.join(parts) or f'return {returned:.1f}'} after {step} steps"


def clip(path: Path, env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> None:
    """Whole episodes as a clip, GIF or MP4 by its ending."""
    env: Any = gym.make(env_id, render_mode="rgb_array", **kwargs)
    frames: list[NDArray[np.uint8]] = []
    every, is_full = max(CLIP_EVERY // env.unwrapped.core.decide_every, 1), False

    def keep(step: int) -> bool:
        nonlocal is_full
        if step % every == 0:
            frame = np.asarray(env.render())
            is_full = (len(frames) + 1) * frame.nbytes > LARGEST_CLIP
            if not is_full:
                frames.append(frame)
        return is_full

    for episode in range(episodes):
        if not is_full:
            _episode(env, act, seed + episode, keep)
    env.close()
    if is_full:
        there = f"{path.name} shows {len(frames)} frames alone, {LARGEST_CLIP >> 20} MiB of memory"
        say(f"{there}; a smaller render_width has room for more", file=sys.stderr)
    write_clip(path, frames, max(round(env.unwrapped.core.frames_per_second / every), 1))
