"""Demonstrations: transitions of episodes of an expert, or of a Minari dataset, that hold their goal."""

import hashlib
import time
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from redundant_envs.scenes.files import exists
from redundant_envs.support.extras import needs
from redundant_envs.support.progress import counted
from redundant_envs.support.values import shown

from ..config import Config
from ..config.run import first_environment_seed
from ..rollout import SUCCESS, each, expert_act, recorded
from ..shipping.dataset import LANES, spec_of

with needs("train"):
    import torch
    from stable_baselines3.common.type_aliases import DictReplayBufferSamples

EXPERT = "expert"
Episode = tuple[Any, list[NDArray[Any]], Any]
"""Observations, arrays of the steps (actions, rewards, terminations, ..), and infos, from the reset on."""


class Demonstrations(NamedTuple):
    """Transitions of the episodes that hold their goal, and how they came about."""

    transitions: DictReplayBufferSamples
    sha256: str  # of their bits
    played: int
    held: int
    seconds: float

    def facts(self) -> dict[str, Any]:
        """What training.json tells."""
        counts = {"episodes": self.played, "held": self.held}
        return {**counts, "sha256": self.sha256, "seconds": round(self.seconds, 2)}


def of(config: Config, env_kwargs: dict[str, Any]) -> Demonstrations:
    """The demonstrations of a configuration, whose environment has these arguments. ValueError if there are
    none."""
    settings, begun = config.demonstrations, time.perf_counter()
    assert settings is not None
    spec = spec_of(config.env, env_kwargs)
    if settings.source == EXPERT:
        episodes = _played(spec, settings.episodes, first_environment_seed(config.seed))
    else:
        episodes = _read(Path(settings.source), spec, settings.episodes)
    rows: list[list[Any]] = []
    played = 0
    for observations, (actions, rewards, terminations, *_), infos in episodes:
        played += 1
        if infos.get(SUCCESS[0], [True])[-1]:
            before, after = (each(itemgetter(s), observations) for s in (slice(-1), slice(1, None)))
            rows.append([before, actions, after, terminations[:, None], rewards[:, None]])
    if not rows:
        raise ValueError(
            f"demonstrations.source is {shown(settings.source)}, and none of its {played} episodes holds its "
            "goal; leave demonstrations out, or give a dataset with episodes that do"
        )
    transitions = DictReplayBufferSamples(*(_joined(part) for part in zip(*rows, strict=True)))
    digest = hashlib.sha256()
    for part in transitions[:5]:
        for array in part.values() if isinstance(part, dict) else [part]:
            digest.update(array.numpy().tobytes())
    seconds = time.perf_counter() - begun
    return Demonstrations(transitions, digest.hexdigest(), played, len(rows), seconds)


def _joined(parts: tuple[Any, ...]) -> Any:
    """Arrays of all episodes, or dictionaries of arrays, as float32 tensors one below the other."""
    if isinstance(parts[0], dict):
        return {name: _joined(tuple(part[name] for part in parts)) for name in parts[0]}
    return torch.from_numpy(np.concatenate(parts).astype(np.float32))


def _played(spec: EnvSpec, episodes: int, seed: int) -> Iterator[Episode]:
    """Episodes of the expert, with seeds ``seed + i``."""
    with counted("demonstrations", -(-episodes // LANES)) as done:
        for first in range(seed, seed + episodes, LANES):
            count = min(LANES, seed + episodes - first)
            try:
                yield from recorded(spec, expert_act(), count, first)
            except ValueError as error:  # it knows no such scene or actions
                fix = "give a Minari dataset, or leave demonstrations out"
                raise ValueError(f"demonstrations.source is {EXPERT}, and {error}; {fix}") from error
            done(f"{first - seed + count} of {episodes} demonstrations")


def _read(folder: Path, spec: EnvSpec, episodes: int) -> Iterator[Episode]:
    """The first episodes of a Minari dataset of the same environment."""
    with needs("datasets"):
        import h5py  # noqa: F401 - Minari imports it, and does not require it
        from minari import MinariDataset
        from minari.storage import get_dataset_path
    try:
        dataset = MinariDataset((folder if exists(folder) else get_dataset_path(str(folder))) / "data")
        theirs = dataset.env_spec
    except Exception as error:  # a damaged file may raise any error
        told = " ".join(str(error).split())[:300]
        raise ValueError(
            f"demonstrations.source is {shown(str(folder))}, which is no Minari dataset ({told}); give "
            f"{EXPERT}, the folder of a dataset, or its id in MINARI_DATASETS_PATH"
        ) from error
    found, asked = (
        {} if one is None else {"env": one.id, "max_episode_steps": one.max_episode_steps, **one.kwargs}
        for one in (theirs, spec)
    )
    for name in sorted(found.keys() | asked.keys()):
        has, needed = found.get(name), asked.get(name)
        if has != needed:
            raise ValueError(
                f"demonstrations.source is {shown(str(folder))}, recorded with {name} {shown(has)}, and the "
                f"training has {shown(needed)}; record it with the same environment"
            )
    for episode in dataset.iterate_episodes(range(min(episodes, len(dataset)))):
        steps = [episode.actions, episode.rewards, episode.terminations, episode.truncations]
        yield episode.observations, steps, episode.infos
