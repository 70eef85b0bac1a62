"""Numbers that what is made from them must not hold: hooks and functions are made again, with others.

A number of an effect, an arm or a task is set per environment, and is known to a compiled function only as an
argument. One that Python computed with, in a closure, an ``if`` or a default, would stay what it was when the
scene was made. So everything is made again with other numbers, and must come out the same.
"""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from redundant_envs import dialect
from redundant_envs.algebra import name_of
from redundant_envs.effects.hooks import Effect, State
from redundant_envs.robots.arm import Arm

Described = dict[str, tuple[str, str]]
"""What is made from numbers: its name -> what is shown of it, and a text that is equal if it is the same."""
STEADY = 8
"""How often something is made again before a difference is put down to a number."""
FEW = 3
"""With fewer other values accepted among those of all numbers, a number is changed alone."""
THRESHOLDS = 8
"""Most numbers with which one number is compared that are tried."""


class Place(NamedTuple):
    """A number: which owner has it, its field, and its place in a tuple of numbers."""

    owner: int
    field: str
    entry: int | None

    @property
    def name(self) -> str:
        return self.field if self.entry is None else f"{self.field}[{self.entry}]"


class Owner(NamedTuple):
    """Something with numbers.

    Attributes
    ----------
    name : of it in messages
    thing : a frozen dataclass
    fix : what to write instead of using one of its numbers
    """

    name: str
    thing: Any
    fix: Callable[[Place], str]


class _Watched(float):
    """A float that notes what it is compared with."""

    __slots__ = ("seen",)
    seen: list[float]

    def _noted(self, other: Any) -> float:
        if isinstance(other, int | float):
            self.seen.append(float(other))
        return float(self)

    def __lt__(self, other: Any) -> Any:
        return self._noted(other) < other

    def __le__(self, other: Any) -> Any:
        return self._noted(other) <= other

    def __gt__(self, other: Any) -> Any:
        return self._noted(other) > other

    def __ge__(self, other: Any) -> Any:
        return self._noted(other) >= other

    def __eq__(self, other: Any) -> Any:
        return self._noted(other) == other

    def __ne__(self, other: Any) -> Any:
        return self._noted(other) != other

    __hash__ = float.__hash__

    def __bool__(self) -> bool:
        return self._noted(0.0) != 0.0


def check_captured(owners: Sequence[Owner], described: Callable[..., Described]) -> None:
    """ValueError if what is made from things depends on one of their numbers, or is not the same again.

    Parameters
    ----------
    owners : sequence of Owner
        The first one makes it.
    described : function
        What is made, from the things of the owners.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its class, about numbers that nobody gave
        _check_captured(owners, described)


def _check_captured(owners: Sequence[Owner], described: Callable[..., Described]) -> None:
    things = [owner.thing for owner in owners]
    before = dialect.random_states()
    nominal = described(*things)
    _check_steady(owners[0].name, nominal, described, things, 2)
    if dialect.random_states() != before:
        raise ValueError(f"{owners[0].name} {dialect.CHANGES}")
    places = list(_places(things))
    accepted = dict.fromkeys(places, 0)
    trials = [
        {place: _other(k, n, _value(things, place)) for n, place in enumerate(places)} for k in range(KINDS)
    ]
    for values in (*trials, *_far_apart(things, places)):
        changed = [_with(thing, o, values) for o, thing in enumerate(things)]
        found = _made(described, [c or t for c, t in zip(changed, things, strict=True)])
        if found is None:
            continue
        if found != nominal:
            _check_steady(owners[0].name, nominal, described, things, STEADY)
            _refuse(owners, described, nominal, values)
        accepted = {place: n + (changed[place.owner] is not None) for place, n in accepted.items()}
    for n, (place, seen) in enumerate(_compared(described, things, places).items()):
        alone = [_other(k, n, _value(things, place)) for k in range(KINDS)]
        near = _across(seen, _value(things, place))
        for value in (*near, *alone):
            if accepted[place] >= FEW and value not in near:
                break
            changed = _with(things[place.owner], place.owner, {place: value})
            found = _made(described, _replaced(things, place, changed))
            if found is None:
                continue
            accepted[place] += 1
            if found != nominal:
                _check_steady(owners[0].name, nominal, described, things, STEADY)
                _refuse(owners, described, nominal, {place: value})
        if accepted[place] == 0:
            # no other value is allowed, or none was guessed: the checks of its class are left out
            _refuse(owners, described, nominal, {place: 1.25 * _value(things, place) + 0.1})


def _check_steady(
    name: str, nominal: Described, described: Callable[..., Described], things: Sequence[Any], times: int
) -> None:
    """ValueError if what is made of the same numbers is not the same."""
    for _ in range(times):
        found = described(*things)
        if found != nominal:
            raise ValueError(f"{name}: {_difference(nominal, found)} {dialect.CHANGES}")


def _refuse(
    owners: Sequence[Owner],
    described: Callable[..., Described],
    nominal: Described,
    values: Mapping[Place, Any],
) -> None:
    """ValueError about the number on which something depends, one of those with other values; none if the
    values are not accepted and make no difference."""
    things = [owner.thing for owner in owners]
    for place, value in values.items():
        changed = _with(things[place.owner], place.owner, {place: value})
        forced = changed is None
        if forced:
            changed = _set(things[place.owner], place.owner, {place: value})
        found = _made(described, _replaced(things, place, changed))
        if found is None or found == nominal:
            continue
        owner, what = owners[place.owner], _difference(nominal, found)
        was, (shown, _) = nominal.get(what, ("nothing", "")), found.get(what, ("nothing", ""))
        present = _value(things, place)
        how = f"is {was[0]} at {present:.6g} and {shown} at {value:.6g}"
        if was[0] == shown:
            how = f"{shown} computes with the number itself"
        of = "" if place.owner == 0 else f" of {owner.name}"
        raise ValueError(
            f"{owners[0].name} does not follow its number {place.name}{of} when it is set: {what} {how}; "
            f"{owner.fix(place)}"
        )
    if len(values) > 1:
        names = ", ".join(place.name for place in values)
        raise ValueError(
            f"{owners[0].name} does not follow its numbers when several of {names} are set; "
            f"{owners[0].fix(next(iter(values)))}"
        )


def _difference(one: Described, other: Described) -> str:
    return next(name for name in (*one, *other) if one.get(name) != other.get(name))


def _made(described: Callable[..., Described], things: Sequence[Any]) -> Described | None:
    """What is made of things; None if they refuse it, as one may whose numbers do not fit each other."""
    if any(thing is None for thing in things):
        return None
    try:
        return described(*things)
    except Exception:  # of a user's own text, with numbers that it did not expect
        return None


def _places(things: Sequence[Any]) -> Iterator[Place]:
    for o, thing in enumerate(things):
        for f in dataclasses.fields(thing):
            if f.name in getattr(thing, "static", ()) or not f.init:
                continue
            value = getattr(thing, f.name)
            entries: Any = enumerate(value) if isinstance(value, tuple) else ((None, value),)
            for entry, number in entries:
                if isinstance(number, int | float) and not isinstance(number, bool):
                    yield Place(o, f.name, entry)


def _value(things: Sequence[Any], place: Place) -> Any:
    value = getattr(things[place.owner], place.field)
    return value if place.entry is None else value[place.entry]


KINDS = 12
"""Ways to another number, of :func:`_other`."""


def _other(kind: int, n: int, value: Any) -> Any:
    """Another number instead of the n-th one: nearby and far, of either sign, whole for a whole one."""
    own = 1.0 + 0.017 * (n % 11) + 0.001 * (n % 7)  # of each number: what depends on a ratio differs, too
    if kind < 2:
        return (
            value + (1 + n % 5) * (1, -1)[kind] if value == _whole(value) else (1.1, 0.9)[kind] * own * value
        )
    if kind == 2:
        return 2 * value + (n % 5 if value == _whole(value) else 0)
    if not math.isfinite(value):
        return math.copysign(own * 10.0 ** (kind - 6), value)
    factor, instead = (
        (1.25 * own, 0.05), (0.8 / own, -0.05), (1.0 + 1e-3 * own, 1e-3), (16.0 * own, 16.0),
        (1.0 / (16.0 * own), -16.0), (1e3 * own, 1e3), (1e-3 / own, 1e-6), (-own, -1.0), (0.0, 1.0),
    )[kind - 3]  # fmt: skip
    return factor * value if value else instead * own


def _far_apart(things: Sequence[Any], places: Sequence[Place]) -> Iterator[dict[Place, Any]]:
    """Other numbers of the first owner, any two of which are once much further apart than they were, in
    either order: what compares a ratio or a difference differs."""
    own = [place for place in places if place.owner == 0]
    for bit in range((len(own) - 1).bit_length()):
        for up in (0, 1):
            factors = (1e3 if (n >> bit) & 1 == up else 1e-3 for n in range(len(own)))
            yield {p: f * (_value(things, p) or 1.0) for p, f in zip(own, factors, strict=True)}


def _across(seen: Sequence[float], value: float) -> list[float]:
    """Numbers at those with which a number is compared, on either side of each, and between them."""
    found = [math.nextafter(c, to) for c in seen for to in (-math.inf, c, math.inf)]
    found += [2.0 * c - value for c in seen]
    ordered = sorted(seen)
    found += [0.5 * (a + b) for a, b in itertools.pairwise(ordered)]
    return [x for x in found if math.isfinite(x)]


def _whole(value: Any) -> int | None:
    """The whole number that a value is; None if it is none."""
    return int(value) if math.isfinite(value) and value == int(value) else None


def _fields(thing: Any, owner: int, values: Mapping[Place, Any]) -> dict[str, Any]:
    """Fields of a thing with other numbers in them."""
    fields: dict[str, Any] = {}
    for place, value in values.items():
        if place.owner != owner:
            continue
        if place.entry is None:
            fields[place.field] = value
        else:
            entries = fields.setdefault(place.field, list(getattr(thing, place.field)))
            entries[place.entry] = value
    return {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}


def _with(thing: Any, owner: int, values: Mapping[Place, Any]) -> Any:
    """A thing with other numbers; None if it does not allow them."""
    try:
        return dataclasses.replace(thing, **_fields(thing, owner, values))
    except Exception:  # as above
        return None


def _set(thing: Any, owner: int, values: Mapping[Place, Any]) -> Any:
    """The same without the checks of its class."""
    made = copy.copy(thing)
    for name, value in _fields(thing, owner, values).items():
        object.__setattr__(made, name, value)
    return made


def _replaced(things: Sequence[Any], place: Place, changed: Any) -> list[Any]:
    return [changed if o == place.owner else thing for o, thing in enumerate(things)]


def _compared(
    described: Callable[..., Described], things: Sequence[Any], places: Sequence[Place]
) -> dict[Place, list[float]]:
    """For each number, the first of those that it is compared with."""
    watched: dict[Place, _Watched] = {}
    for place in places:
        watched[place] = _Watched(_value(things, place))
        watched[place].seen = []
    _made(described, [_set(thing, o, watched) for o, thing in enumerate(things)])
    return {place: list(dict.fromkeys(w.seen))[:THRESHOLDS] for place, w in watched.items()}


# ---- what effects make ----------------------------------------------------------------------------------


def check_effect(where: str, effect: Effect, arm: Arm) -> None:
    """ValueError if the hooks of an effect would not follow when its numbers or those of the arm are set."""
    name = f"{where} ({type(effect).__name__})"
    check_captured((Owner(name, effect, _bind), Owner("the arm", arm, of_the_arm)), hooks_described)


def _bind(place: Place) -> str:
    return (
        f"take it as an argument of the function and bind it, bind={{{place.field!r}: '.{place.name}'}}, "
        f"or name {place.field!r} in 'static' if it is part of the structure and is never set"
    )


def of_the_arm(place: Place) -> str:
    number = place.field[0] if place.entry is None else f"{place.field[0]}{place.entry + 1}"
    return f"take it as the argument {number} of the function, which needs no bind"


def hooks_described(effect: Effect, arm: Arm) -> Described:
    """Everything that a scene takes from an effect, but for its numbers."""
    hooks = effect.hooks(arm)
    names = ", ".join(effect.parameters())
    found: Described = {
        "the number of hooks": (str(len(hooks)), ""),
        "key": (effect.key, ""),
        "parameters": (names, ""),
        "action_units": (repr(effect.action_units(arm)), ""),
    }
    if type(effect).travel is not Effect.travel:  # which has those of its impacts that are finite
        found["travel"] = (repr(sorted(effect.travel(arm).items())), "")
    known: dict[int, tuple[str, str]] = {}
    for n, hook in enumerate(hooks):
        part = f"hook {n} ({type(hook).__name__})"
        found |= _described(part, hook, known)
        for state in getattr(hook, "states", ()):
            found |= _described(f"{part}, state {getattr(state, 'name', state)!r}", state, known)
    return found


def _described(part: str, hook: Any, known: dict[int, tuple[str, str]]) -> Described:
    found: Described = {}
    for f in dataclasses.fields(hook):
        value = getattr(hook, f.name)
        if f.name == "states":
            shown = str([state.name for state in value if isinstance(state, State)]), ""
        elif callable(value):
            if id(value) not in known:
                known[id(value)] = function_described(value)
            shown = known[id(value)]
        else:
            shown = repr(sorted(value.items()) if isinstance(value, Mapping) else value), ""
        found[f"{part}, {f.name}"] = shown
    return found


def function_described(function: Any) -> tuple[str, str]:
    """Name of a function, and all that it computes."""
    try:
        return name_of(function), dialect.computed_by(function)
    except ValueError as error:
        return name_of(function), str(error)
