"""All keys of a configuration: for help and for completion on the command line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from .fields import Model, limits, model_at, short
from .run import ALGORITHMS, Config


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
        parts = [f"default {shown(field.default)}"] if not field.is_required() else []
        parts += [f"{short(low)} to {short(high)}"] if low is not None and high is not None else []
        parts += [str(extra["unit"])] if "unit" in extra else []
        choices = values(field)
        parts += [" or ".join(choices)] if choices else []
        more = f" ({', '.join(parts)})" if parts else ""
        lines.append(f"{name}: {field.description}{more}")
    return "\n\n".join(lines)


def values(field: Any) -> list[str]:
    """The names that a field accepts, if it has a closed choice of them."""
    choices = [a for a in get_args(field.annotation) if isinstance(a, str)]
    return choices if all(isinstance(a, str) for a in get_args(field.annotation)) else []


def shown(default: Any) -> str:
    """A default as it is written on the command line."""
    if default is None:
        return "null"
    if isinstance(default, tuple):
        return "[" + ", ".join(str(v) for v in default) + "]"
    return str(default) if not isinstance(default, Model) else "{}"


def complete(incomplete: str) -> list[str]:
    """Completions of an override."""
    name, equals, _ = incomplete.partition("=")
    if equals:
        fields = dict(keys())
        return [f"{name}={v}" for v in values(fields[name])] if name in fields else []
    return [f"{key}=" for key, _ in keys() if key.startswith(incomplete)]
