"""Kinks of a right-hand side that are watched, not located, by values that change their signs there.

They are declared by effects, or found by running the functions of effects on numbers that know whether they
move.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from redundant_envs.effects.attaching import roots_of
from redundant_envs.effects.hooks import Actuation, Effect, Force, State
from redundant_envs.moving import Moving, kinks_in, moving
from redundant_envs.quantities import Quantities
from redundant_envs.tracing.graph import Graph, Operation, Value, is_zero, owned
from redundant_envs.tracing.number import Number, value_of

if TYPE_CHECKING:
    from redundant_envs.lane.dynamics import Dynamics

Hook = Force | Actuation
Function = Callable[..., Any]


@dataclass(frozen=True)
class Watch:
    """A function of an effect with kinks.

    Attributes
    ----------
    effect : Effect
    bearer : whose ``bind`` holds for it
    function : callable
    moving : whether each argument moves; empty for a declared kink, whose value changes its sign
    kept : indices of those of its kinks that are watched
    levels : for each of these, whether there is a kink at each whole number
    """

    effect: Effect
    bearer: Hook | State
    function: Function
    moving: tuple[bool, ...] = ()
    kept: tuple[int, ...] = (0,)
    levels: tuple[bool, ...] = (False,)

    @property
    def declared(self) -> bool:
        """Whether the effect declares it."""
        return not self.moving

    def values(self, dynamics: Dynamics, x: Quantities) -> list[Any]:
        """Values that change their signs at the kinks, from quantities."""
        if self.declared:
            return [dynamics.apply(self.effect, self.bearer, self.function, x)]
        kinks = kinks_in(self.run(dynamics, x))
        return [kinks[k].value for k in self.kept]

    def run(self, dynamics: Dynamics, x: Quantities) -> Any:
        """The function on numbers that know whether they move."""
        given = x.each(dynamics.bound(self.effect, self.bearer, self.function))
        with owned(self.effect.key):
            return self.function(*(Moving(*pair) for pair in zip(given, self.moving, strict=True)))


Watches = dict[int, list[Watch]]
"""Functions with kinks, by the identities of their hooks."""


def levels_of(watches: Watches) -> list[bool]:
    """For each of :func:`kink_values`, whether there is a kink at each whole number."""
    return [levels for own in watches.values() for watch in own for levels in watch.levels]


def kink_values(dynamics: Dynamics, x: Quantities) -> list[Any]:
    """Values that change their signs at kinks, from quantities."""
    values: list[Any] = []
    watches = dynamics.kinks
    for _, hook in hooks_in_order(dynamics, x, watches):
        for watch in watches.get(id(hook), ()):
            values += watch.values(dynamics, x)
    return values


def hooks_in_order(
    dynamics: Dynamics, x: Quantities, watched: Watches | None = None
) -> Iterator[tuple[Effect, Hook]]:
    """Forces, then links of motors; while a link is evaluated, its command in ``x`` is the input of the link.

    Motors without a watched link are left out.
    """
    for effect, hook in dynamics.hooks:
        if isinstance(hook, Force):
            yield effect, hook
    for name, chain in zip(dynamics.commands, dynamics.chains, strict=True):
        if watched is not None and not any(id(link) in watched for _, link in chain):
            continue
        command = x[name]
        for effect, link in chain:
            yield effect, link
            x[name] = dynamics.apply(effect, link, link.function, x)
        x[name] = command


# ---- finding kinks --------------------------------------------------------------------------------


class Named(Quantities):
    """Traced numbers by the names of quantities."""

    def __init__(self) -> None:
        super().__init__({}, (), {})
        self.graph = Graph()

    def __missing__(self, name: str) -> Any:
        self[name] = Number(self.graph, self.graph.load("quantity", name))  # type: ignore[arg-type]
        return self[name]


def kinks_of(dynamics: Dynamics) -> Watches:
    """Functions of effects whose kinks are watched, by their hooks; none if no estimate decides on steps.

    A kink that is found in two functions, or found and declared, is watched once.
    """
    if dynamics.scene.tolerance is None or not dynamics.located:
        return {}
    x, moves = Named(), Moves(dynamics)
    found: list[tuple[Hook, Watch, list[Key]]] = []
    seen: set[Key] = set()
    for effect, hook in hooks_in_order(dynamics, x):
        stands_for: set[Key] = set()
        if hook.kink is not None and any(moves.of(effect, hook, hook.kink, hook)):
            watch = Watch(effect, hook, hook.kink)
            found.append((hook, watch, []))
            own, *chosen = _keys_declared(value_of(watch.values(dynamics, x)[0]))
            seen.add(own)
            stands_for.update(chosen)
        for bearer, function in _functions(hook):
            watch = Watch(effect, bearer, function, moves.of(effect, bearer, function, hook))
            result = watch.run(dynamics, x)
            if bearer is hook and isinstance(hook, Actuation):
                moves.leaves[hook.joint] = moving(result).moves
            keys = [_key(value_of(kink.value), kink.levels) for kink in kinks_in(result)]
            if any(watch.moving):
                found.append((hook, watch, [None if key in stands_for else key for key in keys]))
    watches: Watches = {}
    for hook, watch, keys in found:
        kept = [k for k, key in enumerate(keys) if _is_new(key, seen)]
        if kept:
            levels = tuple(isinstance(keys[k], Level) for k in kept)
            watch = dataclasses.replace(watch, kept=tuple(kept), levels=levels)
        if kept or watch.declared:
            watches.setdefault(id(hook), []).append(watch)
    return watches


def _functions(hook: Hook) -> Iterator[tuple[Hook | State, Function]]:
    """Functions that determine the motion within an interval."""
    yield hook, hook.function
    for state in hook.states:
        if state.derivative is not None:
            yield state, state.derivative


class Moves:
    """Which quantities change with the motion within an interval.

    Attributes
    ----------
    leaves : joint -> whether the output of the last examined link of its motor moves
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self.leaves: dict[int, bool] = {}
        self.known = dict.fromkeys((*dynamics.numbers, *dynamics.remembered), False)
        self.known |= dict.fromkeys((s.side for s in dynamics.laws), False)
        self.known |= dict.fromkeys(dynamics.states, True)

    def of(self, effect: Effect, bearer: Hook | State, function: Function, hook: Hook) -> tuple[bool, ...]:
        """For each argument of a function of a hook, whether it moves."""
        return tuple(self._moves(name, hook) for name in self.dynamics.bound(effect, bearer, function))

    def _moves(self, name: str, hook: Hook) -> bool:
        if isinstance(hook, Actuation) and name == self.dynamics.commands[hook.joint]:
            return self.leaves.get(hook.joint, False)
        if name not in self.known:
            arm = self.dynamics.arm
            self.known[name] = not roots_of(name, name, arm).isdisjoint((*arm.coordinates, *arm.rates))
        return self.known[name]


class Level(NamedTuple):
    """A value with a kink at each whole number."""

    key: Any


Key = Any


def _key(value: Value, levels: bool = False) -> Key:
    """A key that is equal for values with the same zeros: x, -x and 0 - x; a - b and b - a. None for a
    constant."""
    if not isinstance(value, Operation):
        return None
    if levels:
        return Level(value)
    if value.name == "neg":
        return _key(value.arguments[0])
    if value.name == "-":
        if is_zero(value.arguments[0], 1.0):
            return _key(value.arguments[1])
        return frozenset(value.arguments)
    return value


def _keys_declared(value: Value) -> Iterator[Key]:
    """A declared kink, and the values that it chooses from, whose kinks it replaces in its force or link."""
    yield _key(value)
    if isinstance(value, Operation) and value.name == "select":
        for chosen in value.arguments[1:]:
            yield from _keys_declared(chosen)


def _is_new(key: Key, seen: set[Key]) -> bool:
    if key is None or key in seen:
        return False
    seen.add(key)
    return True
