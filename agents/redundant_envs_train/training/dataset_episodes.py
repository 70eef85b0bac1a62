"""Episodes of a Minari dataset as demonstrations: sound ones of the training's own environment."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from redundant_envs.envs.arguments import with_mode
from redundant_envs.scenes.files import exists
from redundant_envs.scenes.scene import scene_at
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown

from ..config.run import KEPT_FOR_GOALS
from ..rollout import SUCCESS
from ..run_folder import first_difference

Episode = tuple[Any, list[NDArray[Any]], Mapping[str, Any]]
"""Observations, arrays of the steps (actions, rewards, terminations, ..), and infos, from the reset on."""


def read_episodes(source: str, spec: EnvSpec, count: int, env: Any, tells_success: bool) -> Iterator[Episode]:
    """The first episodes of a dataset, by its folder or its id. ValueError if it is damaged, of another
    environment than that of ``spec``, as ``env`` is one, or has goals that evaluations use."""
    name = f"demonstrations.source is {shown(source)}"
    with needs("datasets"):
        import h5py  # noqa: F401 - Minari imports it, and does not require it
        from minari import MinariDataset
        from minari.storage import get_dataset_path
    try:
        folder = Path(source) if exists(Path(source)) else get_dataset_path(source)
        dataset = MinariDataset(folder / "data")
        theirs, taken = dataset.env_spec, dataset.episode_indices[:count]
        seeds = [one.get("seed") for one in dataset.storage.get_episode_metadata(taken)]
        episodes = [
            (e.observations, [e.actions, e.rewards, e.terminations, e.truncations], e.infos or {})
            for e in dataset.iterate_episodes(taken)
        ]
    except Exception as error:  # a damaged file may raise any error
        told = " ".join(str(error).split())[:300]
        raise ValueError(
            f"{name}, which is no sound Minari dataset ({told}); give expert, the folder of a dataset, or "
            "its id in MINARI_DATASETS_PATH"
        ) from error
    if theirs is None or theirs.additional_wrappers:
        had = "no environment" if theirs is None else "an environment with wrappers"
        raise ValueError(f"{name}, a dataset of {had}; record one of {spec.id} without any")
    if difference := first_difference(simulated(theirs), simulated(spec)):
        raise ValueError(
            "{}, recorded with {} {}, and the training has {}; record it with the same environment".format(
                name, *difference
            )
        )
    for seed in seeds:
        if seed is not None and KEPT_FOR_GOALS[0] <= seed < KEPT_FOR_GOALS[1]:
            raise ValueError(
                f"{name}, with the seed {seed}, whose goals evaluate policies; record it with others"
            )
    for k, (observations, steps, infos) in enumerate(episodes):
        if problem := _problem(env, observations, steps, infos, tells_success):
            raise ValueError(f"{name}, whose episode {k} {problem}; record it again")
        yield observations, steps, infos


def simulated(spec: EnvSpec) -> dict[str, Any]:
    """What the environment of a spec is, whichever way its arguments say it."""
    kwargs = {name: value for name, value in spec.kwargs.items() if name != "on_bad_action"}
    scene = with_mode(scene_at(kwargs.pop("scene"), kwargs.pop("accuracy", None)), kwargs.pop("action", None))
    return {"env": spec.id, "max_episode_steps": spec.max_episode_steps, **kwargs, "scene": scene.to_dict()}


def _problem(
    env: Any, observations: Any, steps: list[NDArray[Any]], infos: Mapping[str, Any], tells_success: bool
) -> str:
    """What is wrong with an episode, in words; empty if nothing is."""
    actions, rewards, *_ = steps
    shapes = env.observation_space
    parts = observations if isinstance(observations, dict) else {"": observations}
    spaces = dict(shapes.spaces) if isinstance(observations, dict) else {"": shapes}
    if any(len(part) != len(actions) for part in steps):
        return f"has {len(actions)} actions and other numbers of rewards or ends"
    if parts.keys() != spaces.keys() or any(
        parts[name].shape != (len(actions) + 1, *spaces[name].shape) for name in parts
    ):
        return "has observations of another number or shape"
    if actions.shape[1:] != env.action_space.shape or not (np.abs(actions) <= 1.0).all():
        return "has actions of another shape, or outside -1 to 1"
    if not all(np.isfinite(part).all() for part in (*parts.values(), rewards)):
        return "has numbers that are not finite"
    if tells_success and len(infos.get(SUCCESS[0], ())) != len(actions) + 1:
        return f"lacks {SUCCESS[0]} in its infos"
    return ""
