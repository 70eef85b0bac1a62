"""Kinks of a right-hand side that are watched, not located: effects declare them, or they are found."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.graph import Operation, Value, bits_of
from redundant_envs.compiler.tracing.number import Loads, value_of
from redundant_envs.effects.bound_hooks import Attached, Attachments, Bound
from redundant_envs.effects.hooks import Actuation
from redundant_envs.effects.validate_hooks import roots_of
from redundant_envs.language.moving import Moving, kinks_in, moving
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm


class WatchedKink(NamedTuple):
    """A function of an effect with kinks."""

    function: Bound
    moving: tuple[bool, ...] = ()  # whether each argument moves; empty for a kink that the effect declares
    watched: tuple[int, ...] = (0,)  # indices of those of its kinks that are watched
    levels: tuple[bool, ...] = (False,)  # for each of these, whether there is a kink at each whole number

    def values(self, x: Quantities) -> list[Any]:
        if not self.moving:  # its own value does
            value = self.function(x)
            return [*value] if isinstance(value, tuple) else [value]
        kinks = kinks_in(self.run(x))
        return [kinks[k].value for k in self.watched]

    def run(self, x: Quantities) -> Any:
        """The function on numbers that know whether they move."""
        values = x.each(self.function.names)
        return self.function.on(Moving(*pair) for pair in zip(values, self.moving, strict=True))


Watches = dict[Attached[Any], list[WatchedKink]]
"""Functions with kinks, by their hooks."""


def levels_of(watches: Watches) -> list[bool]:
    """For each of :func:`kink_values`, whether there is a kink at each whole number."""
    return [levels for of_hook in watches.values() for watch in of_hook for levels in watch.levels]


def kink_values(attached: Attachments, watches: Watches, x: Quantities) -> list[Any]:
    """Values that change their signs at kinks, from quantities."""
    chosen = (watch for a in attached.along(x, watches) for watch in watches.get(a, ()))
    return [value for watch in chosen for value in watch.values(x)]


def kinks_of(attached: Attachments, arm: Arm, constant: Iterable[str], states: Iterable[str]) -> Watches:
    """Functions of effects whose kinks are watched, each once, by their hooks: quantities are ``constant``
    within an interval, or follow from ``states``."""
    x = Quantities({}, (), {}, Loads())
    known = dict.fromkeys(constant, False) | dict.fromkeys(states, True)
    leaves: dict[str, bool] = {}  # whether the last examined link of a command's motor moves

    def moves(function: Bound, command: str) -> tuple[bool, ...]:
        """For each argument of a function, whether it changes with the motion within an interval."""
        for name in function.names:
            if name != command and name not in known:
                known[name] = not roots_of(name, arm).isdisjoint((*arm.coordinates, *arm.rates))
        return tuple(leaves.get(n, False) if n == command else known[n] for n in function.names)

    candidates: list[tuple[Attached[Any], WatchedKink, list[Key]]] = []
    seen: set[Key] = {None}
    for a in attached.along(x):
        command = f"command{a.hook.joint + 1}" if isinstance(a.hook, Actuation) else ""
        stands_for: set[Key] = set()
        if "kink" in a.functions and any(moves(a.functions["kink"], command)):
            watch = WatchedKink(a.functions["kink"])
            values = watch.values(x)
            candidates.append((a, watch._replace(levels=(False,) * len(values)), []))
            for value in values:
                declared, *chosen = _keys_declared(value_of(value))
                seen.add(declared)
                stands_for.update(chosen)
        # Functions that determine the motion within an interval.
        rates = [f["derivative"] for f in a.states.values() if "derivative" in f]
        for function in (a.functions["function"], *rates):
            watch = WatchedKink(function, moves(function, command))
            result = watch.run(x)
            if function is a.functions["function"]:
                leaves[command] = moving(result).moves
            keys = [_key(value_of(kink.value), kink.levels) for kink in kinks_in(result)]
            if any(watch.moving):
                candidates.append((a, watch, [None if key in stands_for else key for key in keys]))
    watches: Watches = {}
    for a, watch, keys in candidates:
        indices = [k for k, key in enumerate(keys) if key not in seen and key not in keys[:k]]
        seen.update(keys)
        if indices:
            watch = watch._replace(
                watched=tuple(indices), levels=tuple(isinstance(keys[k], tuple) for k in indices)
            )
        if indices or not watch.moving:
            watches.setdefault(a, []).append(watch)
    return watches


Key = Any


def _key(value: Value, levels: bool = False) -> Key:
    """A key that is equal for values with the same zeros: x, -x and 0 - x; a - b and b - a. None for a
    constant, a tuple for a value with a kink at each whole number."""
    if not isinstance(value, Operation):
        return None
    if levels:
        return ("levels", value)
    if value.name == "neg":
        return _key(value.arguments[0])
    if value.name == "-":
        first, second = value.arguments
        if isinstance(first, float) and bits_of(first) == bits_of(0.0):
            return _key(second)
        return frozenset(value.arguments)
    return value


def _keys_declared(value: Value) -> Iterator[Key]:
    """A declared kink, and the values that it chooses from, whose kinks it replaces in its force or link."""
    yield _key(value)
    if isinstance(value, Operation) and value.name == "select":
        for chosen in value.arguments[1:]:
            yield from _keys_declared(chosen)
