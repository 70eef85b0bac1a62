"""Everything of this package that a program follows from: the files and the loaded code of its modules."""

from __future__ import annotations

import hashlib
import marshal
import os
import platform
import re
import sys
from collections.abc import Mapping
from functools import lru_cache, partial
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from redundant_envs.backends import IMPORTED

ROOT = __name__.partition(".")[0]
PLAIN = (bool, int, float, str, bytes, tuple, type(None))
BACKENDS = f"{ROOT}.backends"
TABLES = (dict, list, set, frozenset)
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
KNOWN = frozenset((ROOT, "numpy", *sys.stdlib_module_names))
"""Packages whose functions are known by their names."""


class _Replaced(Exception):
    """A function or an object of others is in the place of one of this package."""


def scene_key(text: str, maker: str) -> str:
    """Name of what this package, as it is loaded, traces from a ``text``, under this Python and NumPy.

    Told are ``maker``, the module that traces, and all those of which it uses functions, classes or objects,
    directly or by others. Files alone would not tell: Python may have loaded old bytecode of them, and a
    process may have replaced a function or a number. The code alone would not tell what decorators note. The
    name is "" with a file that cannot be read or was changed since the import, and with a function of others
    in place of one of the package: what it does may follow from anything.
    """
    about = "\0".join((text, sys.version, platform.machine(), np.__version__))
    digest, told = hashlib.sha256(about.encode()), list[Any]()
    waiting, seen = [maker], {ROOT, BACKENDS}
    try:
        for name in waiting:
            if name in seen:
                continue
            seen.add(name)
            names = vars(sys.modules[name])
            with open(names["__file__"], "rb") as file:
                times, content = os.fstat(file.fileno()), file.read()
            if max(times.st_mtime, times.st_ctime) > IMPORTED:
                return ""
            digest.update(b"\0%b\0%b" % (name.encode(), content))
            waiting.append(name.rpartition(".")[0])  # the package that the module is in
            _tell(told, waiting, name, names)
    except (OSError, _Replaced):
        return ""
    digest.update(marshal.dumps(told, 2))  # version 2 does not depend on counts of references
    return digest.hexdigest()[:40]


def _tell(told: list[Any], used: list[str], module: str, names: Mapping[str, Any], inside: str = "") -> None:
    """Tell the functions, classes and numbers of a module, or of a class of it, and add to ``used`` those
    modules of this package of which it uses something."""
    for name, value in tuple(names.items()):
        kind = type(value)
        if kind is ModuleType:
            if not value.__name__.startswith(f"{module}."):  # what was imported by others, too
                used += _of_package(value.__name__)
            continue
        if name.startswith("__") and kind is not FunctionType:
            continue
        if isinstance(value, PLAIN):
            told += name, kind.__qualname__, _plain(value)
        elif kind in TABLES:
            if inside or name.isupper():  # others are caches
                told += name, sorted(map(_plain, value.items() if kind is dict else value))
        elif isinstance(value, type):
            home = value.__module__
            told += name, home, value.__qualname__
            if home == module and value.__qualname__ == inside + name:
                told.append(_plain(value.__mro__))
                _tell(told, used, module, vars(value), f"{inside}{name}.")
            else:
                used += _of_package(home)
        elif type(function := value if kind is FunctionType else _function(value)) is FunctionType:
            home = function.__module__
            told += name, home, function.__qualname__, _plain(value) if kind is partial else None
            if cells := function.__closure__:
                told += [_plain(cell.cell_contents) for cell in cells]
            if home != module:
                used += (own := _of_package(home))
            if home == module or not own:  # otherwise its own module tells it
                told += function.__code__, _plain(function.__defaults__), _plain(function.__kwdefaults__)
        else:
            used += _of_package(kind.__module__)
            told += name, kind.__qualname__, getattr(value, "__module__", None)
            told.append(getattr(value, "__qualname__", None))


@lru_cache
def _of_package(home: str) -> tuple[str, ...]:
    """The module of a function or a class if it is one of this package that traces; :class:`_Replaced` if it
    is one of others.

    Back ends are left out: they compute what is traced, and trace nothing.
    """
    top = home.partition(".")[0]
    if top not in KNOWN and not top.startswith("namedtuple_"):
        raise _Replaced(home)
    return (home,) if top == ROOT and not home.startswith(BACKENDS) else ()


def _function(value: Any) -> Any:
    """The function behind a method, a property or a cached function."""
    for attribute in ("fget", "func", "__func__", "__wrapped__"):
        value = getattr(value, attribute, value)
    return value


def _plain(value: Any) -> Any:
    if value is None:
        return None
    text = repr(value)
    return ADDRESS.sub("", text) if " at 0x" in text else text
