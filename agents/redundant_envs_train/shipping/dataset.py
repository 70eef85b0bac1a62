"""Episodes as a Minari dataset: from its seed and its actions each one is replayed to the last bit."""

import dataclasses
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from redundant_envs import __version__
from redundant_envs.envs.registration import full_id, ids
from redundant_envs.extras import needs
from redundant_envs.files import exists
from redundant_envs.modules import IMPORTED
from redundant_envs.progress import counted
from redundant_envs.scene import scene_at
from redundant_envs.tables import table
from redundant_envs.values import shown

from ..config import Config
from ..rollout import Act, expert_act, policy_act, random_act
from ..run_folder import check_out, own_config, tell_differences

ACTORS = {"expert": "computed torque", "random": "random actions"}
"""Sources of actions without a policy, and their names in the metadata."""
MOST_EPISODES = 1_000_000
MOST_SEED = 2**32 - 1
MOST_STEPS = 51_200
"""Control steps that are played before they are written: memory is bounded, and batches are large enough."""
EPISODE_BYTES = 50_000
"""More than what HDF5 needs for an episode beside its numbers, 25 kB."""
SUCCESS = "is_success"
CODE = f"redundant-envs {__version__}, redundant-envs-train dataset"
"""What Minari calls a permalink of the code; there is no address of it."""


class Source(NamedTuple):
    """Where actions come from, and the environment."""

    actor: str  # "expert" or "random", or what tables call the learner
    env_id: str
    kwargs: dict[str, Any]  # arguments of the environment, with its scene as plain data
    folder: Path | None = None  # of a policy
    config: Config | None = None


class Episodes(NamedTuple):
    """Episodes of a batch of environments, which all began at the same time.

    The first axis of all arrays but ``lengths`` is time, and the second counts environments. After its end
    an environment has rows that mean nothing.
    """

    lengths: NDArray[np.int64]  # control steps of each
    observations: Any  # an array or a dictionary of arrays, with a row before the first step
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    infos: dict[str, NDArray[Any]]  # with a row before the first step


# ---- checks, before anything is imported that takes long, or is written


def source_of(word: str, env: str | None) -> Source:
    """The source that a user names: "expert", "random", or the folder of a run or an exported policy."""
    if word in ACTORS:
        if env is None:
            raise ValueError(f"env is missing; with {word} give --env ID, one of {', '.join(ids())}")
        return Source(word, (env_id := _id_of(env)), _plain({}, env_id))
    folder = Path(word)
    if not exists(folder):
        raise ValueError(
            f"source is {shown(word)}; give {', '.join(ACTORS)}, or the folder of a run or an exported policy"
        )
    config = own_config(folder)
    if env is not None and _id_of(env) != config.env:
        raise ValueError(
            f"env is {shown(env)}, and {folder} has a policy of {config.env}; leave --env out, or give the "
            "folder of another policy"
        )
    return Source(config.label, config.env, _plain(dict(config.env_kwargs), config.env), folder, config)


def _id_of(text: str) -> str:
    """A registered id, given with or without its namespace."""
    full = full_id(text)
    if full not in ids():
        raise ValueError(f"env is {shown(text)}; choose one of {', '.join(ids())}")
    return full


def _plain(kwargs: dict[str, Any], env_id: str) -> dict[str, Any]:
    """Arguments of an environment, with its scene as plain data: a file may change, or be gone."""
    accuracy = kwargs.pop("accuracy", None)
    given = {**gym.spec(env_id).kwargs, **kwargs}
    return {**given, "scene": scene_at(given["scene"], accuracy).to_dict()}


def check_absent(out: Path) -> None:
    """Refuse a folder for a dataset that exists, or cannot be made."""
    if os.path.lexists(out):
        raise ValueError(f"out is {out}, which exists; delete it or choose another --out")
    check_out(out)


def check_minari() -> None:
    """Raise an error if the packages that write a dataset are missing."""
    with needs("datasets"):
        import h5py  # noqa: F401
        import minari  # noqa: F401
        import PIL  # noqa: F401 - Minari imports it, and does not require it


# ---- playing


def actor_of(source: Source, trust: bool) -> Any:
    """A function that makes the actions of a batch whose first episode has a seed."""
    if source.config is None:
        return random_act if source.actor == "random" else lambda seed: expert_act()
    assert source.folder is not None
    tell_differences([source.folder])
    from ..policies import load_policy  # imports torch

    act = policy_act(load_policy(source.folder, source.config, trust))
    return lambda seed: act


def played(source: Source, act: Act, count: int, seed: int) -> Episodes:
    """Play episodes with the seeds ``seed + i``, each in an environment of its own."""
    # As a single environment does without an argument; with one, both do what it says.
    env: Any = gym.make_vec(source.env_id, num_envs=count, **{"on_bad_action": "raise", **source.kwargs})
    core = env.core
    if source.actor == "expert" and not core.goal_fields:
        raise ValueError(f"expert moves the tip to a goal, and {source.env_id} has none; choose random")
    lengths, open_lanes = np.zeros(count, dtype=np.int64), np.ones(count, dtype=np.bool_)
    obs, info = env.reset(seed=seed)
    observations, infos = [obs], [_told(env, info, np.zeros((count, 1)))]
    steps: list[tuple[NDArray[Any], ...]] = []
    while open_lanes.any():
        actions = act(obs, core, len(steps))
        obs, reward, terminated, truncated, info = env.step(actions)
        observations.append(obs)
        infos.append(_told(env, info, actions))
        steps.append((actions, reward, terminated, truncated))
        lengths += open_lanes
        open_lanes &= ~(terminated | truncated)
    env.close()
    acted, rewards, ends, cuts = (np.stack(rows) for rows in zip(*steps, strict=True))
    return Episodes(lengths, _stacked(observations), acted, rewards, ends, cuts, _stacked(infos))


def _told(env: Any, info: Any, actions: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """The numbers about each step that a dataset has beside those of an episode."""
    applied = np.clip(actions.astype(np.float64), -1.0, 1.0)
    found = {"effort": np.square(applied).mean(axis=1), "tip": env.tip}
    return {SUCCESS: info[SUCCESS], **found} if SUCCESS in info else found


def _stacked(rows: list[Any]) -> Any:
    """Arrays, or dictionaries of arrays, one above the other."""
    if isinstance(rows[0], dict):
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return np.stack(rows)


# ---- writing


def write_dataset(source: Source, episodes: int, seed: int, out: Path, trust: bool = False) -> str:
    """Play episodes and write them as a Minari dataset.

    It is written in a hidden folder and renamed at the end: ``out`` is complete or does not exist.

    Parameters
    ----------
    source : Source
    episodes : int
    seed : int
        Of the first episode; episode k has the seed ``seed + k``.
    out : Path
        Folder of the dataset; its name, with ``-v0`` if it ends in no version, is the id of the dataset.
    trust : bool
        As in :func:`load_policy`.

    Returns
    -------
    str
        A table: episodes, control steps, share of successes, mean return, size.
    """
    actor = actor_of(source, trust)
    whole = out.resolve()
    there = next(place for place in whole.parents if place.exists())
    part = Path(tempfile.mkdtemp(prefix=f".{whole.name[:100]}.", dir=there))
    try:
        (part / "whole").mkdir()
        row = _write(source, actor, episodes, seed, part / "whole" / "data", dataset_id(whole.name))
        size = sum(file.stat().st_size for file in part.rglob("*") if file.is_file())
        whole.parent.mkdir(parents=True, exist_ok=True)
        check_absent(out)  # another command may have made it in the meantime
        (part / "whole").rename(whole)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return table(("episodes", "steps", "success", "mean return", "size"), [(*row, f"{size / 1e6:.1f} MB")])


def dataset_id(name: str) -> str:
    """The id of a dataset in a folder with a name: Minari's ids end in a version."""
    plain = re.sub(r"[^-\w]", "_", name)
    return plain if re.fullmatch(r".+-v\d+", plain) else f"{plain}-v0"


def _write(
    source: Source, actor: Any, episodes: int, seed: int, data: Path, name: str
) -> tuple[int, int, str, str]:
    """Write a dataset batch by batch; returns episodes, steps, share of successes and mean return."""
    from minari.dataset.minari_storage import MinariStorage

    spec = env_spec(source)
    env = gym.make(spec)
    storage = MinariStorage.new(data, env.observation_space, env.action_space, spec)
    storage.update_metadata(_about(source, episodes, seed, name))
    assert spec.max_episode_steps is not None  # configurations and ids have a limit
    lanes = min(episodes, max(1, MOST_STEPS // spec.max_episode_steps))
    steps, held, returns = 0, [], []
    with counted("episodes", -(-episodes // lanes)) as done:
        for first in range(0, episodes, lanes):
            count = min(lanes, episodes - first)
            batch = played(source, actor(seed + first), count, seed + first)
            _check_room(batch, data)
            storage.update_episodes(_buffers(batch, seed + first))
            steps += int(batch.lengths.sum())
            open_lanes = np.arange(len(batch.rewards))[:, None] < batch.lengths
            returns += np.where(open_lanes, batch.rewards, 0.0).sum(axis=0).tolist()
            if SUCCESS in batch.infos:
                held += batch.infos[SUCCESS][batch.lengths, np.arange(count)].tolist()
            done(f"{first + count} of {episodes} episodes")
    success = f"{100 * np.mean(held):.1f} %" if held else "unknown"
    return episodes, steps, success, f"{np.mean(returns) + 0.0:.2f}"


def _check_room(batch: Episodes, data: Path) -> None:
    """Raise an error if a disk is too full for a batch: HDF5 would end the process without a word."""
    obs = batch.observations
    arrays = [*(obs.values() if isinstance(obs, dict) else [obs]), *batch[2:6], *batch.infos.values()]
    needed = sum(array.nbytes for array in arrays) + EPISODE_BYTES * len(batch.lengths)
    free = shutil.disk_usage(data).free
    if free < needed:
        raise ValueError(
            f"out is on a disk with {free / 1e6:.0f} MB left, and {len(batch.lengths)} episodes need up to "
            f"{needed / 1e6:.0f} MB; choose another --out or fewer --episodes"
        )


def env_spec(source: Source) -> EnvSpec:
    """The spec of the single environment, from which another process makes it.

    Its entry points name the modules that the command imported, too: what they register may be in the scene.
    """
    spec = gym.spec(source.env_id)
    kwargs = dict(source.kwargs)
    steps = kwargs.pop("max_episode_steps", spec.max_episode_steps)
    return dataclasses.replace(
        spec, kwargs=kwargs, max_episode_steps=steps, entry_point=_importing(spec.entry_point),
        vector_entry_point=_importing(spec.vector_entry_point),
    )  # fmt: skip


def _importing(entry: Any) -> str:
    home, _, names = str(entry).partition(":")
    return f"{home}:{'/'.join(dict.fromkeys([*IMPORTED, *names.split('/')]))}"


def _about(source: Source, episodes: int, seed: int, name: str) -> dict[str, Any]:
    """Minari's metadata of a dataset."""
    import minari

    algorithm = ACTORS.get(source.actor, source.actor)
    return {
        "dataset_id": name, "algorithm_name": algorithm, "code_permalink": CODE,
        "description": f"Episodes of {source.env_id} by {algorithm}, with the seeds {seed} to "
        f"{seed + episodes - 1}. Reset with the seed of an episode, the environment gives its observations "
        "for its actions, to the last bit. infos begin at the reset, as observations do: effort is the mean "
        "square of the action that led there, 0 to 1; tip is in metres.",
        "requirements": [f"redundant-envs=={__version__}"], "minari_version": minari.__version__,
    }  # fmt: skip


def _buffers(batch: Episodes, seed: int) -> Iterator[Any]:
    """The episodes of a batch, one by one, in the form that Minari writes."""
    from minari.data_collector import EpisodeBuffer

    for lane, n in enumerate(batch.lengths.tolist()):
        obs = batch.observations
        seen = {k: v[: n + 1, lane] for k, v in obs.items()} if isinstance(obs, dict) else obs[: n + 1, lane]
        steps = (rows[:n, lane] for rows in batch[2:6])
        infos = {name: rows[: n + 1, lane] for name, rows in batch.infos.items()}
        yield EpisodeBuffer(None, seed + lane, None, seen, *steps, infos)
