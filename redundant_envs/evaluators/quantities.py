"""Order dialect functions by the quantities they need: the one resolver behind every evaluator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import arguments_of, gives_of


@dataclass(frozen=True)
class Call:
    """One statement: names = function(arguments)."""

    names: tuple[str, ...]
    function: Callable[..., Any] | None
    """None is the sine and cosine of one angle."""
    arguments: tuple[str, ...]


def calls(
    wanted: Iterable[str],
    known: Iterable[str],
    functions: Sequence[Callable[..., Any]],
    sincos: Mapping[str, tuple[str, str]],
    rename: Mapping[str, str] | None = None,
) -> list[Call]:
    """Statements, in order, that compute the wanted quantities from the known ones.

    ``rename`` maps argument names to other quantities. A quantity nobody gives, or two
    functions give, is a ValueError that names it.
    """
    rename = rename or {}
    givers: dict[str, Callable[..., Any]] = {}
    for f in functions:
        for name in gives_of(f):
            if givers.setdefault(name, f) is not f:
                both = " and ".join(f"{g.__module__}.{g.__qualname__}" for g in (givers[name], f))
                raise ValueError(f"the quantity {name!r} is given by both {both}; rename one of them")
    angles = {name: angle for angle, pair in sincos.items() for name in pair}
    have = set(known)
    order: list[Call] = []

    def need(name: str, asked_by: str) -> None:
        if name in have:
            return
        if name in angles:
            angle = angles[name]
            need(angle, name)
            order.append(Call(tuple(sincos[angle]), None, (angle,)))
            have.update(sincos[angle])
            return
        if name not in givers:
            raise ValueError(
                f"{asked_by} needs the quantity {name!r}, which nothing gives; known: "
                f"{', '.join(sorted(have | set(givers) | set(angles)))}"
            )
        function = givers[name]
        arguments = tuple(rename.get(a, a) for a in arguments_of(function))
        for a in arguments:
            need(a, function.__qualname__)
        order.append(Call(gives_of(function), function, arguments))
        have.update(gives_of(function))

    for name in wanted:
        need(name, "the scene")
    return order
