"""Dialect functions and statements as text."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from redundant_envs.algebra import is_physics
from redundant_envs.evaluators.quantities import Call


def prefixed(function: Callable[..., Any]) -> str:
    """Name of a dialect function in assembled text."""
    return f"{function.__module__.rsplit('.', 1)[-1]}__{function.__name__}"


def function_text(function: Callable[..., Any]) -> str:
    """Source of a dialect function under its prefixed name, its body unchanged."""
    source: Any = function
    text = inspect.getsource(function)
    text = text[text.index("def ") :]
    text = text.replace(f"def {function.__name__}(", f"def {prefixed(function)}(", 1)
    for name in source.__code__.co_names:
        called = source.__globals__.get(name)
        if is_physics(called):
            text = re.sub(rf"\b{name}\(", f"{prefixed(called)}(", text)
    return text


def copied_text(name: str) -> str:
    """A file of this folder without what it imports from the others, which stand above it."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return re.sub(r"^from redundant_envs[^(\n]*(\([^)]*\))?\n", "", text, flags=re.MULTILINE)


def words(lines: Iterable[str]) -> set[str]:
    """All identifiers in some lines."""
    return set(re.findall(r"[A-Za-z_]\w*", "\n".join(lines)))


def emit(call: Call, lines: list[str], used: list[Callable[..., Any]]) -> None:
    """Append one statement."""
    if call.function is None:
        lines.append(f"{', '.join(call.names)} = sincos({call.arguments[0]})")
    else:
        used.append(call.function)
        arguments = ", ".join(call.arguments)
        lines.append(f"{', '.join(call.names)} = {prefixed(call.function)}({arguments})")


def block(lines: Iterable[str], levels: int = 1) -> list[str]:
    """Lines one or more levels deeper."""
    return ["    " * levels + line for line in lines]


def indent(lines: Iterable[str], levels: int) -> str:
    """Lines as indented text."""
    return "\n".join(block(lines, levels))
