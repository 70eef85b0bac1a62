"""Episodes as a Minari dataset: from its seed and its actions each one is replayed to the last bit."""

import dataclasses
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from redundant_envs import __version__
from redundant_envs.envs.registration import full_id, ids, listed
from redundant_envs.scenes.files import exists
from redundant_envs.scenes.scene import scene_at
from redundant_envs.support.disk import free_bytes
from redundant_envs.support.extras import needs
from redundant_envs.support.modules import IMPORTED
from redundant_envs.support.progress import counted
from redundant_envs.support.values import shown

from ..config.files import load, presets
from ..play import ACTIONS, act_of
from ..rollout import Act, expert_name, recorded
from ..run_folder import check_out, new_folder, own_config

ACTORS: dict[str, Callable[[str], str]] = {
    "expert": expert_name, "near": lambda env_id: expert_name(env_id, "baseline"),
    "random": lambda env_id: "random actions",
}  # fmt: skip
"""Sources without a policy, and who acts then in an environment, in words."""
ABOUT = (
    "Episodes of {} by {}, with the seeds {} to {}. Reset with the seed of an episode, the environment gives "
    "its observations for its actions, to the last bit. infos begin at the reset, as observations do: effort "
    "is the mean square of the action that led there, 0 to 1; tip is in metres."
)
LANES = 512  # episodes that are played at a time, and then written
EPISODE_BYTES = 50_000  # more than an episode needs; a full disk ends HDF5 without a word


def write_dataset(who: str, env: str | None, episodes: int, seed: int, out: Path, trust: bool = False) -> int:
    """Write episodes of one of ACTORS, or of a folder's policy, as a Minari dataset; episode k has the seed
    ``seed + k``. ``env`` is an id, or for ACTORS the file or preset of a configuration. Returns their control
    steps."""
    if who not in ACTORS and not exists(Path(who)):
        others = ", ".join(ACTORS)
        raise ValueError(f"source is {shown(who)}; give {others}, or the folder of a run or policy")
    config = None if who in ACTORS else own_config(Path(who))
    like = config
    if env and config is None and full_id(env) not in ids() and (env in presets() or exists(Path(env))):
        like = load(env)
        env = like.env
    env_id = full_id(env or (config.env if config else ""))
    if env_id not in ids() or (config and env_id != config.env):
        fix = f"leave it out: {who} has a policy of {config.env}" if config else f"choose {listed()}"
        raise ValueError(f"env is {shown(env)}; {fix}")
    if os.path.lexists(out):
        raise ValueError(f"out is {out}, which exists; delete it or choose another --out")
    check_out(out)
    if (free := free_bytes(out)) < episodes * EPISODE_BYTES:
        left = f"{free / 1e6:.0f} MB left"
        raise ValueError(f"out is on a disk with {left}; choose another, or fewer --episodes")
    with needs("datasets"):
        import h5py  # noqa: F401 - Minari imports it and PIL, and requires neither
        import minari
        import PIL  # noqa: F401
        from minari.data_collector import EpisodeBuffer
        from minari.dataset.minari_storage import MinariStorage
    act = act_of(Path(who), config, trust) if config else None
    make = (lambda seed: act) if act else ACTIONS[who]
    spec = spec_of(env_id, like.env_kwargs if like else {})
    actor = config.label if config else ACTORS[who](env_id)
    name = re.sub(r"[^-\w]", "_", out.absolute().name)
    with new_folder(out) as part:
        single = gym.make(spec)
        storage = MinariStorage.new(part / "data", single.observation_space, single.action_space, spec)
        storage.update_metadata({
            "dataset_id": name if re.fullmatch(r".+-v\d+", name) else f"{name}-v0", "algorithm_name": actor,
            "description": ABOUT.format(env_id, actor, seed, seed + episodes - 1),
            "requirements": [f"redundant-envs=={__version__}"], "minari_version": minari.__version__,
        })  # fmt: skip
        storage.update_episodes(EpisodeBuffer(*one) for one in _played(spec, make, episodes, seed))
        return int(storage.total_steps)


def spec_of(env_id: str, env_kwargs: Mapping[str, Any]) -> EnvSpec:
    """A spec from which another process makes the environment: its scene is plain data, and its entry points
    name the modules of the command, which may have registered what is in the scene."""
    spec = gym.spec(env_id)
    kwargs = {"on_bad_action": "raise", **spec.kwargs, **env_kwargs}
    kwargs["scene"] = scene_at(kwargs["scene"], kwargs.pop("accuracy", None)).to_dict()
    steps = kwargs.pop("max_episode_steps", spec.max_episode_steps)
    plain_spec = dataclasses.replace(spec, max_episode_steps=steps, kwargs=kwargs)
    for name in ("entry_point", "vector_entry_point"):
        home, _, names = str(getattr(spec, name)).partition(":")
        setattr(plain_spec, name, f"{home}:{'/'.join(dict.fromkeys([*IMPORTED, *names.split('/')]))}")
    return plain_spec


def _played(spec: EnvSpec, make: Callable[[int], Act], episodes: int, seed: int) -> Iterator[Any]:
    """The arguments of Minari's EpisodeBuffer for each episode."""
    with counted("episodes", -(-episodes // LANES)) as done:
        for first in range(seed, seed + episodes, LANES):
            count = min(LANES, seed + episodes - first)
            for k, (observations, steps, infos) in enumerate(recorded(spec, make(first), count, first)):
                yield None, first + k, None, observations, *steps, infos
            done(f"{first - seed + count} of {episodes} episodes")
