"""Configurations in files: YAML with dotted overrides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from redundant_envs.files import exists, explained, read_yaml, text_value
from redundant_envs.values import shown

from ..presets import preset_path
from .fields import checked
from .run import CHANGES, VERSION, Config


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """A configuration: a YAML file or a preset's name, and overrides such as ``seed=3 ppo.gamma=0.98``."""
    file = preset_path(path)
    data = read(file, overrides, "configs/training")
    with explained(file, not overrides):
        return config_of(data)


def config_of(data: dict[str, Any]) -> Config:
    """A configuration from plain data of this version."""
    check_version(data)
    config: Config = checked(Config, data)
    return config


def check_version(data: dict[str, Any]) -> None:
    """Refuse a configuration of another version, and name the changes since."""
    found = data.get("config_version", 1)
    if found == VERSION and not isinstance(found, bool):
        return
    known = isinstance(found, int) and not isinstance(found, bool) and 1 <= found < VERSION
    if not known:
        raise ValueError(f"config_version is {shown(found)}; this program reads {VERSION}")
    changed = " ".join(f"Version {v}: {CHANGES[v]}." for v in range(found + 1, VERSION + 1))
    said = "is missing" if "config_version" not in data else f"is {found}"
    raise ValueError(
        f"config_version {said}; this program reads {VERSION}. {changed} Look whether the run is still "
        f"the one you mean, then write config_version: {VERSION}"
    )


def read(path: str | Path, overrides: Sequence[str], folder: str) -> dict[str, Any]:
    """The content of a YAML file, with overrides; if it is missing, the error lists the folder's files."""
    file = Path(path)
    if not exists(file):
        available = sorted(str(p) for p in Path(folder).glob("*.yaml"))
        raise ValueError(
            f"config is {shown(str(path))}; there is no such file. Found: {', '.join(available)}"
        )
    data = read_yaml(file, "config")
    if not isinstance(data, dict):
        raise ValueError(f"{file} holds no mapping; give 'key: value' lines")
    for override in overrides:
        override_one(data, override)
    return data


def override_one(data: dict[str, Any], override: str) -> None:
    """Set the value of one ``key.inner=value``."""
    key, separator, text = override.partition("=")
    if not separator:
        raise ValueError(f"override is {shown(override)}; write key=value, such as seed=3")
    place = data
    *parents, last = key.split(".")
    for parent in parents:
        if place.get(parent) is None:
            place[parent] = {}
        place = place[parent]
        if not isinstance(place, dict):
            raise ValueError(f"override {shown(key)}: {shown(parent)} has no keys inside")
    place[last] = text_value(text, f"the value {shown(text)}")
