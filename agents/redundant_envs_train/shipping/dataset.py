"""Episodes as a Minari dataset: from its seed and its actions each one is replayed to the last bit."""

import dataclasses
import operator
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from redundant_envs import __version__
from redundant_envs.envs.registration import full_id, ids
from redundant_envs.scenes.files import exists
from redundant_envs.scenes.scene import scene_at
from redundant_envs.support.disk import free_bytes
from redundant_envs.support.extras import needs
from redundant_envs.support.modules import IMPORTED
from redundant_envs.support.progress import counted
from redundant_envs.support.values import shown

from ..play import ACTIONS
from ..rollout import Act, each, policy_act, stacked
from ..run_folder import check_out, new_folder, own_config, tell_differences

ACTORS = {"expert": "computed torque", "random": "random actions"}
ABOUT = (
    "Episodes of {} by {}, with the seeds {} to {}. Reset with the seed of an episode, the environment gives "
    "its observations for its actions, to the last bit. infos begin at the reset, as observations do: effort "
    "is the mean square of the action that led there, 0 to 1; tip is in metres."
)
LANES = 512  # episodes that are played at a time, and then written
EPISODE_BYTES = 50_000  # more than an episode needs; a full disk ends HDF5 without a word


def write_dataset(
    word: str, env: str | None, episodes: int, seed: int, out: Path, trust: bool = False
) -> int:
    """Write episodes of "expert", "random", or a folder's policy as a Minari dataset; episode k has the seed
    ``seed + k``. Returns their control steps."""
    if word not in ACTORS and not exists(Path(word)):
        raise ValueError(f"source is {shown(word)}; give expert, random, or the folder of a run or policy")
    config = None if word in ACTORS else own_config(Path(word))
    env_id = full_id(env or (config.env if config else ""))
    if env_id not in ids() or (config and env_id != config.env):
        fix = f"leave it out: {word} has a policy of {config.env}" if config else f"choose {', '.join(ids())}"
        raise ValueError(f"env is {shown(env)}; {fix}")
    if os.path.lexists(out):
        raise ValueError(f"out is {out}, which exists; delete it or choose another --out")
    check_out(out)
    if (free := free_bytes(out)) < episodes * EPISODE_BYTES:
        raise ValueError(
            f"out is on a disk with {free / 1e6:.0f} MB left; choose another, or fewer --episodes"
        )
    with needs("datasets"):
        import h5py  # noqa: F401 - Minari imports it and PIL, and requires neither
        import minari
        import PIL  # noqa: F401
        from minari.dataset.minari_storage import MinariStorage
    make = ACTIONS["random" if config else word]
    if config:
        tell_differences([Path(word)])
        from ..policies import load_policy  # imports torch

        act = policy_act(load_policy(Path(word), config, trust))
        make = lambda first: act  # noqa: E731
    spec = spec_of(env_id, dict(config.env_kwargs) if config else {})
    actor, name = config.label if config else ACTORS[word], re.sub(r"[^-\w]", "_", out.absolute().name)
    with new_folder(out) as part:
        single = gym.make(spec)
        storage = MinariStorage.new(part / "data", single.observation_space, single.action_space, spec)
        storage.update_metadata({
            "dataset_id": name if re.fullmatch(r".+-v\d+", name) else f"{name}-v0", "algorithm_name": actor,
            "description": ABOUT.format(env_id, actor, seed, seed + episodes - 1),
            "requirements": [f"redundant-envs=={__version__}"], "minari_version": minari.__version__,
        })  # fmt: skip
        storage.update_episodes(_played(spec, make, episodes, seed))
        return int(storage.total_steps)


def spec_of(env_id: str, kwargs: dict[str, Any]) -> EnvSpec:
    """A spec from which another process makes the environment: its scene is plain data, and its entry points
    name the modules of the command, which may have registered what is in the scene."""
    spec, accuracy = gym.spec(env_id), kwargs.pop("accuracy", None)
    scene = scene_at(kwargs.get("scene", spec.kwargs["scene"]), accuracy).to_dict()
    kwargs = {"on_bad_action": "raise", **spec.kwargs, **kwargs, "scene": scene}
    made = dataclasses.replace(
        spec, max_episode_steps=kwargs.pop("max_episode_steps", spec.max_episode_steps), kwargs=kwargs
    )
    for name in ("entry_point", "vector_entry_point"):
        home, _, names = str(getattr(spec, name)).partition(":")
        setattr(made, name, f"{home}:{'/'.join(dict.fromkeys([*IMPORTED, *names.split('/')]))}")
    return made


def _played(spec: EnvSpec, make: Callable[[int], Act], episodes: int, seed: int) -> Iterator[Any]:
    from minari.data_collector import EpisodeBuffer

    with counted("episodes", -(-episodes // LANES)) as done:
        for first in range(0, episodes, LANES):
            count = min(LANES, episodes - first)
            env: Any = gym.make_vec(spec, num_envs=count)
            core, act = env.unwrapped.core, make(seed + first)
            obs, info = env.reset(seed=seed + first)
            seen, infos = [obs], [_told(env, info, np.zeros((count, 1)))]
            steps: list[dict[int, Any]] = []
            lengths, open_lanes = np.zeros(count, np.int64), np.ones(count, np.bool_)
            while open_lanes.any():
                actions = act(obs, core, len(steps))
                obs, *step, info = env.step(actions)
                seen.append(obs)
                infos.append(_told(env, info, actions))
                steps.append(dict(enumerate((actions, *step))))
                lengths += open_lanes
                open_lanes &= ~(step[1] | step[2])
            env.close()
            columns, observations, told = stacked(steps), stacked(seen), stacked(infos)
            for lane, n in enumerate(lengths.tolist()):
                states = operator.itemgetter((slice(n + 1), lane))
                step_of = [part[:n, lane] for part in columns.values()]
                seen_of, told_of = each(states, observations), each(states, told)
                yield EpisodeBuffer(None, seed + first + lane, None, seen_of, *step_of, told_of)
            done(f"{first + count} of {episodes} episodes")


def _told(env: Any, info: Any, actions: Any) -> dict[str, Any]:
    """The numbers about each step that a dataset has beside those of an episode."""
    effort = np.square(np.clip(actions.astype(np.float64), -1.0, 1.0)).mean(axis=1)
    return {name: info[name] for name in ("is_success",) if name in info} | {"effort": effort, "tip": env.tip}
