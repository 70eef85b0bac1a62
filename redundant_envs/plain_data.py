"""Arms and effects from plain JSON data, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from redundant_envs.values import shown


def plain(kind: str, thing: Any) -> dict[str, Any]:
    """An arm or an effect as plain data, by its name in scene files."""
    data: dict[str, Any] = {"type": kind}
    for f in dataclasses.fields(thing):
        value = getattr(thing, f.name)
        data[f.name] = list(value) if isinstance(value, tuple) else value
    return data


def check_registered(where: str, kind: str, thing: Any, registry: Mapping[str, type[Any]]) -> None:
    """ValueError if the class of an object has the name of another class, which plain data would create."""
    own = getattr(thing, "maker", type(thing))
    there = registry.get(kind, own)
    if there is not own:
        mine, other = (f"{c.__module__}.{c.__qualname__}" for c in (own, there))
        raise ValueError(
            f"{where} is a {mine}, and {kind!r} in plain data is {other}; give the class a name of its own "
            "and register it"
        )


def check_keys(where: str, data: Mapping[str, Any], valid: list[str]) -> None:
    """Refuse keys that are not valid, naming the valid ones."""
    for key in data:
        if key not in valid:
            raise ValueError(f"{where} has the unknown key {shown(key)}; valid: {', '.join(valid)}")


def typed(where: str, data: Any, registry: Mapping[str, type[Any]]) -> Any:
    """Build the class that ``data["type"]`` names in a registry."""
    if not isinstance(data, Mapping) or "type" not in data:
        raise ValueError(f"{where} is {shown(data)}; give a mapping with a 'type'")
    kind = data["type"]
    if not isinstance(kind, str) or kind not in registry:
        raise ValueError(
            f"{where}.type is {shown(kind)}; valid: {', '.join(sorted(registry))}, and what a module of "
            "yours registers: import it first (command lines: --import MODULE before the command)"
        )
    target = registry[kind]
    arguments = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items() if k != "type"}
    check_keys(where, arguments, [f.name for f in dataclasses.fields(target)])
    for name in required(target):
        if name not in arguments:
            raise ValueError(f"{where} ({kind}) lacks {name!r}")
    return target(**arguments)


def required(kind: type[Any]) -> list[str]:
    """The fields of a dataclass without a default."""
    missing = dataclasses.MISSING
    return [f.name for f in dataclasses.fields(kind) if f.default is f.default_factory is missing and f.init]
