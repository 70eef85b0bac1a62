"""Dialect functions and statements as text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from redundant_envs.dialect import renamed
from redundant_envs.evaluators.quantities import Call


class FunctionNames:
    """Names of dialect functions in one assembled text: one for each function, whatever it is called.

    A name is readable, ``file__function``. Of functions with the same one, such as two that a notebook
    calls ``force``, all but the first get a number.

    Parameters
    ----------
    taken : names that stand for something else in the text
    first : functions that are named before all others, in this order
    """

    def __init__(self, taken: Iterable[str], first: Iterable[Callable[..., Any]]) -> None:
        self._names: dict[Callable[..., Any], str] = {}
        self._taken = set(taken)
        for function in first:
            self.of(function)

    def of(self, function: Callable[..., Any]) -> str:
        """Name of a dialect function in the text."""
        if function not in self._names:
            module = re.sub(r"\W", "_", function.__module__.rsplit(".", 1)[-1])
            plain = name = f"{module}__{function.__name__}"
            number = 1
            while name in self._taken:
                number += 1
                name = f"{plain}__{number}"
            self._names[function] = name
            self._taken.add(name)
        return self._names[function]

    def text(self, function: Callable[..., Any]) -> str:
        """Source of a dialect function under its name here, its body unchanged."""
        return renamed(function, self.of(function), self.of)

    def emit(self, call: Call, lines: list[str], used: list[Callable[..., Any]]) -> None:
        """Append one statement."""
        if call.function is None:
            lines.append(f"{', '.join(call.names)} = sincos({call.arguments[0]})")
        else:
            used.append(call.function)
            arguments = ", ".join(call.arguments)
            lines.append(f"{', '.join(call.names)} = {self.of(call.function)}({arguments})")


def copied_text(name: str) -> str:
    """A file of this folder without what it imports from the others, which stand above it."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return re.sub(r"^from redundant_envs[^(\n]*(\([^)]*\))?\n", "", text, flags=re.MULTILINE)


def words(lines: Iterable[str]) -> set[str]:
    """All identifiers in some lines."""
    return set(re.findall(r"[^\W\d]\w*", "\n".join(lines)))


def block(lines: Iterable[str], levels: int = 1) -> list[str]:
    """Lines one or more levels deeper."""
    return ["    " * levels + line for line in lines]


def indent(lines: Iterable[str], levels: int) -> str:
    """Lines as indented text."""
    return "\n".join(block(lines, levels))
