"""Begin a training with the weights of a policy; nothing in its file is unpickled."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs
from redundant_envs.values import shown

from ..config import Config
from ..learners.build import ALGORITHM_CLASSES, policy_kwargs
from ..own_scene import SCENE, own_config
from ..policies import check_weights, read_about, read_weights
from ..start import policy_file

with needs("train"):
    from stable_baselines3.common.save_util import data_to_json

LEARNERS_OF_POLICIES = set(ALGORITHM_CLASSES.values())
SPACES = ("observation_space", "action_space")
ASPECTS = ("_shape", "dtype", "low", "high", "spaces")
"""Texts of a space that are compared; stable-baselines3 keeps them beside its pickled data."""


def start_from(model: Any, config: Config, env: Any) -> None:
    """Give a learner, its averages and its targets the weights of the policy of ``config.start_from``.

    Optimisers, replay buffer and a learned weight of the entropy are initialised. ValueError if algorithm,
    spaces, meaning of the observations of ``env``, or networks are others, or the file is damaged.
    """
    assert config.start_from is not None
    file = policy_file(config.start_from)
    about = read_about(file)
    homes = {kind.policy_aliases["MlpPolicy"].__module__: kind.__name__ for kind in LEARNERS_OF_POLICIES}
    found = _entry(about, "policy_class", "__module__")
    wanted = ALGORITHM_CLASSES[config.algo].__name__
    _check("a policy of", homes.get(found, found) if isinstance(found, str) else found, wanted, file)
    own = json.loads(data_to_json({name: getattr(env, name) for name in SPACES}))
    for name in SPACES:
        for aspect in ASPECTS:
            what = f"another {name.replace('_', ' ')}:"
            _check(what, _entry(about, name, aspect), _entry(own, name, aspect), file)
    _check_meaning(file, env)
    networks = str(policy_kwargs(config)["net_arch"])
    _check("the network widths", str(_entry(about, "policy_kwargs", "net_arch")), networks, file)
    weights, _ = read_weights(file, config.settings.activation)
    check_weights(file, weights, model.policy.state_dict())
    model.policy.load_state_dict(weights)
    model.read_networks()


def _entry(about: Mapping[str, Any], name: str, aspect: str) -> Any:
    part = about.get(name)
    return part.get(aspect) if isinstance(part, dict) else None


def _check(what: str, found: Any, wanted: Any, file: Path) -> None:
    if found != wanted:
        raise ValueError(
            f"start_from does not fit: {file} has {what} {shown(found)}, and this training {shown(wanted)}; "
            "give a policy of the same algorithm, spaces and networks"
        )


def _check_meaning(file: Path, env: Any) -> None:
    """Refuse observations of the same shape with another meaning, if a folder records the meaning."""
    if not all((file.parent / name).is_file() for name in ("config.yaml", SCENE)):
        return
    other = own_config(file.parent)
    there: Any = make_sb3(other.env, 1, **other.env_kwargs)
    theirs, own = (", ".join(e.core.simulator.episode.observed) for e in (there, env))
    _check("the observations", theirs, own, file)
