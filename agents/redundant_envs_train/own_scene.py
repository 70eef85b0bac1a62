"""A run is simulated in its own scene.yaml, even if the file that its configuration names has changed."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from redundant_envs.files import exists
from redundant_envs.scene import Scene, load_scene, scene_at, scene_path
from redundant_envs.values import shown

from . import train_again
from .config import Config
from .run_folder import flat, read_config

SCENE = "scene.yaml"
MOST_SHOWN = 3
"""Most differences in a message."""


def read_scene(folder: Path) -> Scene:
    """The scene that a run was trained in.

    Raises
    ------
    ValueError
        scene.yaml is missing or damaged.
    """
    path = folder / SCENE
    if not path.is_file():
        raise ValueError(
            f"{folder} has no {SCENE}, which says what its policy was trained in; put it back, or make a new "
            f"run: {train_again(folder)}"
        )
    return load_scene(path)


def with_scene(config: Config, scene: Scene) -> Config:
    """A configuration in this scene, with the stepping of the scene."""
    rest = {name: value for name, value in config.env_kwargs.items() if name != "accuracy"}
    return config.model_copy(update={"env_kwargs": {**rest, "scene": scene.to_dict()}})


def own_config(folder: Path) -> Config:
    """The configuration of a run folder, in the scene that it was trained in."""
    config = read_config(folder)
    return with_scene(config, read_scene(folder))


def named_scene(config: Config) -> Any:
    """The scene that a configuration names or holds: that of its environment, if it has none."""
    return config.env_kwargs.get("scene", gym.spec(config.env).kwargs["scene"])


def difference(folder: Path) -> str:
    """How a run's scene differs from the one that its configuration names, in a sentence; else nothing.

    A file that no longer exists, or cannot be found from the current folder, counts as equal.
    """
    config = read_config(folder)
    named = named_scene(config)
    if isinstance(named, str | Path) and not exists(scene_path(named)):
        return ""
    what = f"the scene {shown(named)} that config.yaml names" if isinstance(named, str) else "config.yaml"
    try:
        today = scene_at(named, config.env_kwargs.get("accuracy"))
    except ValueError as error:
        return f"{what} cannot be read any more: {error}"
    own, other = _flat(read_scene(folder).to_dict()), _flat(today.to_dict())
    names = [name for name in {**own, **other} if own.get(name) != other.get(name)]
    if not names:
        return ""
    words = [f"{n} {_words(own.get(n))}, not {_words(other.get(n))}" for n in names[:MOST_SHOWN]]
    more = f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else ""
    return f"{folder / SCENE} differs from {what} ({'; '.join(words)}{more})"


def tell_differences(folders: Sequence[Path]) -> None:
    """One line on stderr if run folders are of other scenes than their configurations name today."""
    found = [text for folder in folders if folder.is_dir() and (text := difference(folder))]
    more = f" (and so for {len(found) - 1} more of {len(folders)} runs)" if len(found) > 1 else ""
    if found:
        print(f"note: {found[0]}; the run's own is used{more}", file=sys.stderr)


def _flat(data: Mapping[str, Any]) -> dict[str, Any]:
    """A scene's data by dotted names; an effect's numbers by its type."""
    effects = {effect["type"]: effect for effect in data["effects"]}
    return flat({name: value for name, value in data.items() if name != "effects"} | effects)


def _words(value: Any) -> str:
    return "absent" if value is None else shown(value)
