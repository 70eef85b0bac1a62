"""Whether this process replaced a part of the package: a function, a class or a number of a module."""

from __future__ import annotations

import functools
import sys
from types import FunctionType, ModuleType
from typing import Any

ROOT = __name__.partition(".")[0]
ROOMS = (
    "language", "compiler.dialect", "compiler.tracing", "robots", "effects", "tasks", "scenes", "simulator",
    "support",
)  # fmt: skip
TRACES = tuple(f"{ROOT}.{room}" for room in ROOMS)
"""Modules that a traced program follows from; back ends compute what is traced, and trace nothing."""
CACHED = type(functools.cache(len))


class Loaded:
    """A module as it is loaded: what it and its classes have by names, and the code of their functions."""

    def __init__(self, module: ModuleType) -> None:
        self.module, names = module, dict(vars(module))  # copies: others may import meanwhile
        classes = [x for x in names.values() if isinstance(x, type) and x.__module__ == module.__name__]
        scopes: list[Any] = [vars(module), *map(vars, classes)]
        self._before = [(scope, dict(scope)) for scope in scopes]
        self._codes = [
            (f, f.__code__, f.__defaults__, f.__kwdefaults__)
            for _, before in self._before for f in before.values() if isinstance(f, FunctionType)
        ]  # fmt: skip

    def is_changed(self) -> bool:
        """Whether a name stands for something else now, or a function has other code."""
        try:
            return not all(before.items() <= scope.items() for scope, before in self._before) or any(
                f.__code__ is not code or f.__defaults__ != some or f.__kwdefaults__ != others
                for f, code, some, others in self._codes
            )
        except Exception:  # objects of others may not compare
            return True

    def forget(self) -> None:
        """Clear the caches of its functions."""
        for _, before in self._before:
            for x in before.values():
                if isinstance(x, CACHED):
                    x.cache_clear()


_loaded: dict[str, Loaded] = {}
_found = [0]


def replacements() -> int:
    """How often something was found replaced in this process; what the package had noted is forgotten then.

    A program is to be traced again when this number has changed. It is found in a millisecond.
    """
    if any(sys.modules.get(name) is not x.module or x.is_changed() for name, x in [*_loaded.items()]):
        _found[0] += 1
        _loaded.clear()
    for name in sys.modules.keys() - _loaded.keys():
        if name.startswith(TRACES):
            _loaded[name] = Loaded(sys.modules[name])
            _loaded[name].forget()
    return _found[0]
