"""Configurations in files and on the command line: YAML, dotted overrides, help and completion."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from redundant_envs.files import exists, explained, read_yaml, text_value
from redundant_envs.values import shown

from ..presets import preset_path
from .fields import checked, limits, model_at, short
from .run import ALGORITHMS, CHANGES, VERSION, Config


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """A configuration: a YAML file or a preset's name, and overrides such as ``seed=3 ppo.gamma=0.98``."""
    file = preset_path(path)
    data = read(file, overrides, "configs/training")
    with explained(file, not overrides):
        return config_of(data)


def config_of(data: dict[str, Any]) -> Config:
    """A configuration from plain data of this version; for another one the error names the changes since."""
    found = data.get("config_version", 1)
    whole = isinstance(found, int) and not isinstance(found, bool)
    if whole and found == VERSION:
        config: Config = checked(Config, data)
        return config
    if not (whole and 1 <= found < VERSION):
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


def keys() -> Iterator[tuple[str, Any]]:
    """Dotted names of all keys, with their fields."""
    for name, field in Config.model_fields.items():
        if name not in ALGORITHMS:
            yield name, field
    for algo in ALGORITHMS:
        for name, field in model_at(Config, (algo,)).model_fields.items():
            yield f"{algo}.{name}", field


def help_of_keys() -> str:
    """A line for every key: its default, allowed values, unit and meaning."""
    lines = ["Keys of key=value:"]
    for name, field in keys():
        if name == "config_version":
            continue
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        low, high = limits(field)
        parts = [f"default {written(field.default)}"] if not field.is_required() else []
        parts += [f"{short(low)} to {short(high)}"] if low is not None and high is not None else []
        parts += [str(extra["unit"])] if "unit" in extra else []
        choices = values(field)
        parts += [" or ".join(choices)] if choices else []
        more = f" ({', '.join(parts)})" if parts else ""
        lines.append(f"{name}: {field.description}{more}")
    return "\n\n".join(lines)


def values(field: Any) -> list[str]:
    """The names that a field accepts, if it has a closed choice of them."""
    choices = get_args(field.annotation)
    return list(choices) if all(isinstance(choice, str) for choice in choices) else []


def written(default: Any) -> str:
    """A default as it is written on the command line."""
    if default is None:
        return "null"
    return f"[{', '.join(map(str, default))}]" if isinstance(default, tuple) else str(default)


def complete(incomplete: str) -> list[str]:
    """Completions of an override."""
    name, equals, _ = incomplete.partition("=")
    if equals:
        fields = dict(keys())
        return [f"{name}={v}" for v in values(fields[name])] if name in fields else []
    return [f"{key}=" for key, _ in keys() if key.startswith(incomplete)]
