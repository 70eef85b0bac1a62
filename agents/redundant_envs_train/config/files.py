"""Configurations in files and on the command line: YAML, dotted overrides, help and completion."""

import copy
import difflib
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from redundant_envs.scenes import config_folder
from redundant_envs.scenes.files import exists, explained, read_yaml, text_value
from redundant_envs.support.tables import markdown
from redundant_envs.support.values import shown

from .fields import checked, limits, model_at, short
from .run import ALGORITHMS, CLIENTS, VERSION, Config


def presets() -> list[str]:
    """Names of all presets; baselines are named with their folder."""
    folder = config_folder("training")  # package data in a wheel, configs/training in a checkout
    return sorted(p.relative_to(folder).with_suffix("").as_posix() for p in folder.rglob("*.yaml"))


def preset_path(path: str | Path) -> Path:
    """The file of a configuration: the path itself, or a preset's by its name."""
    file, preset = Path(path), config_folder("training") / f"{path}.yaml"
    if exists(file) and not (file.is_dir() and exists(preset)):
        return file
    if not exists(preset):
        every = presets()
        near = difflib.get_close_matches(str(path)[:100], every, 4, 0.0)
        raise ValueError(
            f"config is {shown(str(path))}; there is no such file, and the presets are {', '.join(near)} and "
            f"{len(every) - len(near)} others, which train --help lists; or give env=ID, such as "
            "env=RPRPReach-v0"
        )
    return preset


def is_override(word: str) -> bool:
    """Whether a word of a command is ``key=value`` where a configuration may stand."""
    return "=" in word and not exists(Path(word))


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """A YAML file or a preset, or defaults if an override stands there, with overrides such as ``seed=3``."""
    if is_override(str(path)):
        return merged(None, {"config_version": VERSION}, [str(path), *overrides], config_of)
    file = preset_path(path)
    return merged(file, read(file), overrides, config_of)


def check_telemetry(config: Config, overrides: Sequence[str]) -> None:
    """ValueError if a file, which may be a stranger's, asks for a log that leaves the run folder: only the
    command of a user may, as the run goes where the user's account lets it."""
    clients = [name for name in config.telemetry if name in CLIENTS]
    if clients and not any(override.startswith("telemetry=") for override in overrides):
        fix = f"add telemetry=[{','.join(config.telemetry)}], or telemetry=[tensorboard] to go without"
        reason = f"{clients[0]} sends the run elsewhere, so the command has to ask for it: {fix}"
        raise ValueError(f"telemetry is {', '.join(config.telemetry)} in a file; {reason}")


def merged(
    file: str | Path | None, data: dict[str, Any], overrides: Sequence[str], make: Callable[[Any], Any]
) -> Any:
    """What ``make`` gives for a file with overrides; a ValueError names the line there, or the command."""
    if file is not None:
        with explained(file):
            model = make(data)
        if not overrides:
            return model
    try:
        overridden = copy.deepcopy(data)
        for override in overrides:
            override_one(overridden, override)
        return make(overridden)
    except ValueError as error:
        raise ValueError(f"command line: {error}") from None


config_of: Callable[[Any], Config] = functools.partial(checked, Config)  # a configuration from plain data


def read(path: str | Path) -> dict[str, Any]:
    """The content of a YAML file."""
    if not exists(Path(path)):
        raise ValueError(f"config is {shown(str(path))}; there is no such file")
    data = read_yaml(Path(path), "config")
    if not isinstance(data, dict):
        raise ValueError(f"{path} holds no mapping; give 'key: value' lines")
    return data


def load_model(kind: type[Any], path: str | Path, overrides: Sequence[str] = ()) -> Any:
    """The model of a YAML file of a study, with overrides. Errors are those of :func:`merged`."""
    return merged(path, read(path), overrides, functools.partial(checked, kind))


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
    for group in ("demonstrations", "curriculum", *ALGORITHMS):
        for name, field in model_at(Config, (group,)).model_fields.items():
            yield f"{group}.{name}", field


def page_of_keys() -> str:
    """All keys as a page of Markdown: meaning, default, allowed values and unit of each."""
    from ..pages import page  # imports Jinja2

    rows: dict[str, list[tuple[str, ...]]] = {}
    for name, field in keys():
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        low, high = limits(field)
        choices = get_args(field.annotation)
        allowed = ", ".join(choices) if all(isinstance(choice, str) for choice in choices) else ""
        if field.annotation is bool:
            allowed = "true or false"
        elif low is not None and high is not None:
            allowed = f"{short(low)} to {short(high)}"
        default = "" if field.is_required() else f"`{written(field.default)}`"
        cells = (f"`{name}`", default, f"{allowed} {extra.get('unit', '')}".strip(), field.description)
        rows.setdefault(name.rpartition(".")[0], []).append(cells)
    head = ("key", "default", "allowed", "meaning")
    tables = {algo: markdown(head, cells, formatted=True) for algo, cells in rows.items()}
    return page("keys", tables=tables)


def written(default: Any) -> str:
    """A default as it is written on the command line."""
    if default is None or isinstance(default, bool):
        return {None: "null", True: "true", False: "false"}[default]
    return f"[{', '.join(map(str, default))}]" if isinstance(default, tuple) else str(default)
