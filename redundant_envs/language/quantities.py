"""Quantities by their names: computed by the functions that return them, when they are needed."""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from redundant_envs.language.algebra import arguments_of, gives_of, sincos

Function = Callable[..., Any]


@functools.lru_cache(maxsize=256)
def givers_of(functions: tuple[Function, ...]) -> dict[str, Function]:
    """The function that returns each quantity; ValueError if two return the same."""
    givers: dict[str, Function] = {}
    for f in functions:
        if len(set(gives_of(f))) < len(gives_of(f)):
            twice = sorted({name for name in gives_of(f) if gives_of(f).count(name) > 1})
            raise ValueError(f"{f.__qualname__} gives {', '.join(twice)} twice; rename one of them")
        for name in gives_of(f):
            if givers.setdefault(name, f) is not f:
                both = " and ".join(f"{g.__module__}.{g.__qualname__}" for g in (givers[name], f))
                raise ValueError(f"the quantity {name!r} is given by both {both}; rename one of them")
    return givers


def check_names(field: str, names: Iterable[str], owners: Mapping[str, str]) -> None:
    """ValueError if a name of a field such as "Reach.memory" has one of the owners, "of the arm FourR"."""
    for name in sorted(set(names) & owners.keys()):
        raise ValueError(f"{field} has {name!r}, a name {owners[name]}; rename it")


class Quantities(dict[str, Any]):
    """Values by name; a missing value is computed from the others once, and then kept."""

    def __init__(
        self,
        known: Mapping[str, Any],  # values to begin with
        functions: Sequence[Function],  # they compute further values from those that their arguments name
        sincos: Mapping[str, tuple[str, str]],  # angle -> names of its sine and cosine
        source: Any = (),  # a mapping of values that are looked up before anything is computed
        aliases: Mapping[str, str] | None = None,  # further names -> the values that they refer to
    ) -> None:
        super().__init__(known)
        self._givers = givers_of(tuple(functions))
        self._angles = {name: angle for angle, pair in sincos.items() for name in pair}
        self._sincos = sincos
        self._source = source
        self._aliases = aliases or {}
        self._asked = ["the scene"]

    def __missing__(self, name: str) -> Any:
        if name in self._aliases:
            self[name] = self[self._aliases[name]]
        elif name in self._source:
            self[name] = self._source[name]
        elif name in self._angles:
            angle = self._angles[name]
            self.update(zip(self._sincos[angle], sincos(self[angle]), strict=True))
        elif name in self._givers:
            function = self._givers[name]
            self._asked.append(function.__qualname__)
            arguments = self.each(arguments_of(function))
            self._asked.pop()
            results = function(*arguments)
            names = gives_of(function)
            self.update(zip(names, results if isinstance(results, tuple) else (results,), strict=True))
        else:
            known = ", ".join(sorted({*self, *self._givers, *self._angles, *self._aliases}))
            raise ValueError(
                f"{self._asked[-1]} needs the quantity {name!r}, which nothing gives; known: {known}"
            )
        return self[name]

    def each(self, names: Iterable[str]) -> list[Any]:
        """Several values, in order."""
        return [self[name] for name in names]
