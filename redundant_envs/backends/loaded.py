"""Everything of this package that a program follows from: its files, and its code as it is loaded."""

from __future__ import annotations

import hashlib
import marshal
import os
import platform
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from redundant_envs.backends import IMPORTED

PACKAGE = Path(__file__).parents[1]
ROOT = PACKAGE.name
TRACED = re.compile(
    rf"{ROOT}\.(algebra|dialect|dual|moving|quantities|ranges|scene|scene_numbers|values|tracing\.\w+"
    r"|(robots|effects|tasks|numerics|events|lane|batch)\b.*)"
)
"""Modules whose functions and numbers make programs."""
PLAIN = (bool, int, float, str, bytes, tuple, type(None))
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


def scene_key(text: str) -> str:
    """Name of what this package, as it is loaded, traces from a ``text``, under this Python and NumPy.

    Files alone would not tell: Python may have loaded old bytecode of them, and a process may have replaced a
    function or a number. The code alone would not tell the tables of modules. The name is "" without files or
    with one that cannot be read or was changed since the import.
    """
    files = sorted(os.path.join(at, name) for at, _, names in os.walk(PACKAGE) for name in names)
    sources = [path for path in files if path.endswith(".py")]
    about = "\0".join((text, sys.version, platform.machine(), np.__version__))
    digest, told = hashlib.sha256(about.encode()), list[Any]()
    for path in sources:
        try:
            with open(path, "rb") as file:
                times, content = os.fstat(file.fileno()), file.read()
        except OSError:  # such as the link by which an editor locks a file
            return ""
        if max(times.st_mtime, times.st_ctime) > IMPORTED:
            return ""
        digest.update(b"\0%b\0%b" % (path[len(str(PACKAGE)) :].encode(), content))
    for name, module in sorted(sys.modules.items()):
        if TRACED.fullmatch(name):
            _tell(told, name, vars(module))
    digest.update(marshal.dumps(told, 2))  # version 2 does not depend on counts of references
    return digest.hexdigest()[:40] if sources else ""


def _tell(told: list[Any], module: str, names: Mapping[str, Any], inside: str = "") -> None:
    """Tell the functions, classes and numbers of a module, or of a class of it."""
    for name, value in tuple(names.items()):
        kind = type(value)
        if kind is ModuleType or (name.startswith("__") and kind is not FunctionType):
            continue  # a module has its submodules as attributes once they are imported
        if isinstance(value, PLAIN):
            told += name, kind.__qualname__, _plain(value)
        elif isinstance(value, type) and value.__module__ == module and value.__qualname__ == inside + name:
            told += name, _plain(value.__mro__)
            _tell(told, module, vars(value), f"{inside}{name}.")
        elif type(function := value if kind is FunctionType else _function(value)) is FunctionType:
            home = str(function.__module__)
            told += name, home, function.__qualname__
            if home == module or home.partition(".")[0] != ROOT:  # otherwise its own module tells it
                told += function.__code__, _plain(function.__defaults__), _plain(function.__kwdefaults__)
        else:
            told += (
                name,
                kind.__qualname__,
                *(getattr(value, n, None) for n in ("__module__", "__qualname__")),
            )


def _function(value: Any) -> Any:
    """The function behind a method, a property or a cached function."""
    for attribute in ("fget", "func", "__func__", "__wrapped__"):
        value = getattr(value, attribute, value)
    return value


def _plain(value: Any) -> Any:
    return value if value is None else ADDRESS.sub("", repr(value))
