"""Modules of users, named on the command line: the command knows the classes that they register."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from redundant_envs.values import shown

OPTION = "--import"
IMPORTED: list[str] = []
"""Modules that the command named: its other processes import them, too."""


def module_named(name: str) -> Any:
    """A module that is in the current folder or installed."""
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return importlib.import_module(name)


def import_named(module: str) -> None:
    """Import a module for what it registers, here and in other processes of the command."""
    try:
        module_named(module)
    except ModuleNotFoundError as error:
        raise ValueError(
            f"{OPTION} is {shown(module)}: {error}; give the name of a module, without .py, that lies in "
            "this folder or is installed"
        ) from None
    IMPORTED.append(module)


def take_imports(words: list[str]) -> list[str]:
    """Import what ``--import MODULE`` at the beginning of a command names; returns the other words."""
    while words and words[0].partition("=")[0] == OPTION:
        first, *words = words
        module = first.partition("=")[2] or (words.pop(0) if words else "")
        if not module:
            raise ValueError(f"{OPTION} names no module; give {OPTION} MODULE before the command")
        import_named(module)
    return words
