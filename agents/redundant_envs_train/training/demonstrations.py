"""Demonstrations: transitions of episodes of an expert, or of a Minari dataset, that hold their goal."""

import hashlib
import time
from collections.abc import Iterator
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from gymnasium.envs.registration import EnvSpec

from redundant_envs.support.extras import needs
from redundant_envs.support.progress import counted
from redundant_envs.support.values import shown

from ..config import Config
from ..config.learners import EXPERT
from ..config.run import first_environment_seed
from ..rollout import SUCCESS, each, expert_act, info_names, recorded
from ..shipping.dataset import LANES, spec_of
from .dataset_episodes import Episode, read_episodes

with needs("train"):
    import torch
    from stable_baselines3.common.type_aliases import DictReplayBufferSamples


class Demonstrations(NamedTuple):
    """Transitions of the episodes that hold their goal, and how they came about."""

    transitions: DictReplayBufferSamples
    sha256: str  # of their bits
    played: int
    held: int | None  # unknown where the task tells no success
    seconds: float

    def facts(self) -> dict[str, Any]:
        """What training.json tells."""
        counts = {"episodes": self.played, "held": self.held}
        return {**counts, "sha256": self.sha256, "seconds": round(self.seconds, 2)}


def of(config: Config, env_kwargs: dict[str, Any], env: Any) -> Demonstrations:
    """The demonstrations of a configuration, whose environments are ``env`` and have these arguments. Where
    the task tells no success, all episodes count. ValueError if there are none."""
    settings, begun = config.demonstrations, time.perf_counter()
    assert settings is not None
    spec = spec_of(config.env, env_kwargs)
    tells_success = SUCCESS[0] in info_names(env.core)
    if settings.source == EXPERT:
        episodes = _played(spec, settings.episodes, first_environment_seed(config.seed))
    else:
        episodes = read_episodes(settings.source, spec, settings.episodes, env, tells_success)
    rows: list[list[Any]] = []
    played = 0
    for observations, (actions, rewards, terminations, *_), infos in episodes:
        played += 1
        if not tells_success or infos[SUCCESS[0]][-1]:
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
        for array in [part[k] for k in sorted(part)] if isinstance(part, dict) else [part]:
            digest.update(array.numpy().tobytes())
    seconds = time.perf_counter() - begun
    held = len(rows) if tells_success else None
    return Demonstrations(transitions, digest.hexdigest(), played, held, seconds)


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
