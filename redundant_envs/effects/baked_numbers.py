"""Numbers that what is made from them must not hold: hooks and functions are made again, with others.

A number of an effect, an arm or a task is set per environment, and is known to a compiled function only as an
argument. One that Python computed with, in a closure, an ``if`` or a default, would stay what it was when the
scene was made. So everything is made again with other numbers, and must come out the same.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import operator
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from redundant_envs.compiler import dialect
from redundant_envs.effects.hooks import Effect, states_of
from redundant_envs.language.algebra import name_of
from redundant_envs.robots.arm import Arm
from redundant_envs.support.values import replaced, with_fields

Described = dict[str, tuple[str, str]]
"""What is made from numbers: its name -> what is shown of it, and a text that is equal if it is the same."""
STEADY = 8
"""How often something is made again before a difference is put down to a number."""
FEW = 3
"""With fewer other values accepted among those of all numbers, a number is changed alone."""
THRESHOLDS = 8
"""Most numbers with which one number is compared that are tried."""


class Place(NamedTuple):
    """A number."""

    owner: int  # which one has it
    field: str
    entry: int | None  # in a tuple of numbers

    @property
    def name(self) -> str:
        return self.field if self.entry is None else f"{self.field}[{self.entry}]"


class Owner(NamedTuple):
    """Something with numbers."""

    name: str  # in messages
    thing: Any  # a frozen dataclass
    fix: Callable[[Place], str]  # what to write instead of using one of its numbers


def check_captured(owners: Sequence[Owner], described: Callable[..., Described]) -> None:
    """ValueError if what the first owner makes, which ``described`` says of the things of the owners, depends
    on one of their numbers, or is not the same again."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its class, about numbers that nobody gave
        _Maker(owners, described).check()


class _Maker:
    """Makes the same again with other numbers, and compares."""

    def __init__(self, owners: Sequence[Owner], described: Callable[..., Described]) -> None:
        self.owners, self.described, self.name = owners, described, owners[0].name
        self.things = [owner.thing for owner in owners]
        self.values = dict(_numbers(self.things))
        before = dialect.random_states()
        self.nominal = described(*self.things)
        self.check_steady(2)
        if dialect.random_states() != before:
            raise ValueError(f"{self.name} {dialect.CHANGES}")

    def check(self) -> None:
        """Try other values of all numbers at once, then of those alone that were hardly ever accepted."""
        accepted = dict.fromkeys(self.values, 0)
        trials = [
            {place: _other(k, n, value) for n, (place, value) in enumerate(self.values.items())}
            for k in range(KINDS)
        ]
        for values in (*trials, *_far_apart(self.values)):
            for place in self.tried(values):
                accepted[place] += 1
        watched = {place: _Watched(value) for place, value in self.values.items()}
        for number in watched.values():
            number.seen = []
        self.made(self.changed(watched, checked=False))
        for n, place in enumerate(self.values):
            near = _across([*dict.fromkeys(watched[place].seen)][:THRESHOLDS], self.values[place])
            for value in (*near, *(_other(k, n, self.values[place]) for k in range(KINDS))):
                if accepted[place] >= FEW and value not in near:
                    break
                accepted[place] += len(self.tried({place: value}))
            if accepted[place] == 0:
                # no other value is allowed, or none was guessed: the checks of its class are left out
                self.refuse({place: 1.25 * self.values[place] + 0.1})

    def tried(self, values: Mapping[Place, Any]) -> list[Place]:
        """The numbers whose owners accept other values; ValueError if these make a difference."""
        changed = self.changed(values)
        found = self.made([c or t for c, t in zip(changed, self.things, strict=True)])
        if found is None:
            return []
        if found != self.nominal:
            self.check_steady(STEADY)
            self.refuse(values)
        return [place for place in values if changed[place.owner] is not None]

    def changed(self, values: Mapping[Place, Any], checked: bool = True) -> list[Any]:
        """All things, with other numbers; None for one that does not allow them, if its class checks them."""
        made: list[Any] = []
        for o, thing in enumerate(self.things):
            fields: dict[str, Any] = {}
            for _, field, entry in (place for place in values if place.owner == o):
                value = values[Place(o, field, entry)]
                if entry is not None:
                    others = fields.get(field, getattr(thing, field))
                    value = (*others[:entry], value, *others[entry + 1 :])
                fields[field] = value
            made.append(_replaced(thing, fields) if checked else _set(thing, fields))
        return made

    def made(self, things: Sequence[Any]) -> Described | None:
        """What is made of things; None if they refuse it, as one may whose numbers do not fit each other."""
        try:
            return self.described(*things)
        except Exception:  # of a user's own text, with numbers that it did not expect
            return None

    def check_steady(self, times: int) -> None:
        """ValueError if what is made of the same numbers is not the same."""
        for _ in range(times):
            found = self.described(*self.things)
            if found != self.nominal:
                raise ValueError(f"{self.name}: {self.difference(found)} {dialect.CHANGES}")

    def difference(self, found: Described) -> str:
        return next(name for name in (*self.nominal, *found) if self.nominal.get(name) != found.get(name))

    def refuse(self, values: Mapping[Place, Any]) -> None:
        """ValueError about the number on which something depends, one of those with other values; none if the
        values are not accepted and make no difference."""
        for place, value in values.items():
            things = self.changed({place: value})
            if things[place.owner] is None:
                things = self.changed({place: value}, checked=False)
            found = self.made(things)
            if found is None or found == self.nominal:
                continue
            what = self.difference(found)
            (was, _), (shown, _) = (d.get(what, ("nothing", "")) for d in (self.nominal, found))
            how = f"is {was} at {self.values[place]:.6g} and {shown} at {value:.6g}"
            if was == shown:
                how = f"{shown} computes with the number itself"
            owner = self.owners[place.owner]
            of = "" if place.owner == 0 else f" of {owner.name}"
            raise ValueError(
                f"{self.name} does not follow its number {place.name}{of} when it is set: {what} {how}; "
                f"{owner.fix(place)}"
            )
        if len(values) > 1:
            names = ", ".join(place.name for place in values)
            raise ValueError(
                f"{self.name} does not follow its numbers when several of {names} are set; "
                f"{self.owners[0].fix(next(iter(values)))}"
            )


def _noting(compare: Callable[[Any, Any], Any]) -> Any:
    """A comparison of a watched number that notes what it is compared with."""

    def noted(self: _Watched, other: Any) -> Any:
        if isinstance(other, int | float):
            self.seen.append(float(other))
        return compare(float(self), other)

    return noted


class _Watched(float):
    """A float that notes what it is compared with."""

    __slots__ = ("seen",)
    seen: list[float]
    __lt__, __le__, __gt__ = _noting(operator.lt), _noting(operator.le), _noting(operator.gt)
    __ge__, __eq__, __ne__ = _noting(operator.ge), _noting(operator.eq), _noting(operator.ne)
    __hash__ = float.__hash__

    def __bool__(self) -> bool:
        return bool(self != 0.0)


def _numbers(things: Sequence[Any]) -> Iterator[tuple[Place, Any]]:
    for o, thing in enumerate(things):
        for f in dataclasses.fields(thing):
            if f.name in getattr(thing, "static", ()) or not f.init:
                continue
            value = getattr(thing, f.name)
            entries: Any = enumerate(value) if isinstance(value, tuple) else ((None, value),)
            for entry, number in entries:
                if isinstance(number, int | float) and not isinstance(number, bool):
                    yield Place(o, f.name, entry), number


def _replaced(thing: Any, fields: dict[str, Any]) -> Any:
    """A thing with other fields; None if it does not allow them."""
    try:
        return replaced(thing, **fields) if fields else thing
    except Exception:  # of a user's own text, with numbers that it did not expect
        return None


def _set(thing: Any, fields: dict[str, Any]) -> Any:
    """The same without the checks of its class."""
    return with_fields(thing, **fields)


KINDS = 12
"""Ways to another number, of :func:`_other`."""


def _other(kind: int, n: int, value: Any) -> Any:
    """Another number instead of the n-th one: nearby and far, of either sign, whole for a whole one."""
    own = 1.0 + 0.017 * (n % 11) + 0.001 * (n % 7)  # of each number: what depends on a ratio differs, too
    whole = float(value).is_integer()
    if kind < 2:
        return value + (1 + n % 5) * (1, -1)[kind] if whole else (1.1, 0.9)[kind] * own * value
    if kind == 2:
        return 2 * value + (n % 5 if whole else 0)
    if not math.isfinite(value):
        return math.copysign(own * 10.0 ** (kind - 6), value)
    factor, instead = (
        (1.25 * own, 0.05), (0.8 / own, -0.05), (1.0 + 1e-3 * own, 1e-3), (16.0 * own, 16.0),
        (1.0 / (16.0 * own), -16.0), (1e3 * own, 1e3), (1e-3 / own, 1e-6), (-own, -1.0), (0.0, 1.0),
    )[kind - 3]  # fmt: skip
    return factor * value if value else instead * own


def _far_apart(numbers: Mapping[Place, Any]) -> Iterator[dict[Place, Any]]:
    """Other numbers of the first owner, any two of which are once much further apart than they were, in
    either order: what compares a ratio or a difference differs."""
    own = [place for place in numbers if place.owner == 0]
    for bit, up in itertools.product(range((len(own) - 1).bit_length()), (0, 1)):
        factors = (1e3 if (n >> bit) & 1 == up else 1e-3 for n in range(len(own)))
        yield {p: f * (numbers[p] or 1.0) for p, f in zip(own, factors, strict=True)}


def _across(seen: Sequence[float], value: float) -> list[float]:
    """Numbers at those with which a number is compared, on either side of each, and between them."""
    found = [math.nextafter(c, to) for c in seen for to in (-math.inf, c, math.inf)]
    found += [2.0 * c - value for c in seen]
    found += [0.5 * (a + b) for a, b in itertools.pairwise(sorted(seen))]
    return [x for x in found if math.isfinite(x)]


# ---- what effects make ----------------------------------------------------------------------------------


def check_effect(where: str, effect: Effect, arm: Arm) -> None:
    """ValueError if the hooks of an effect would not follow when its numbers or those of the arm are set."""

    def bind(place: Place) -> str:
        return (
            f"take it as an argument of the function and bind it, bind={{{place.field!r}: '.{place.name}'}}, "
            f"or name {place.field!r} in 'static' if it is part of the structure and is never set"
        )

    own = Owner(f"{where} ({type(effect).__name__})", effect, bind)
    check_captured((own, Owner("the arm", arm, of_the_arm)), hooks_described)


def of_the_arm(place: Place) -> str:
    number = place.field[0] if place.entry is None else f"{place.field[0]}{place.entry + 1}"
    return f"take it as the argument {number} of the function, which needs no bind"


def hooks_described(effect: Effect, arm: Arm) -> Described:
    """Everything that a scene takes from an effect, but for its numbers."""
    hooks = effect.hooks(arm)
    found: Described = {
        "the number of hooks": (str(len(hooks)), ""),
        "key": (effect.key, ""),
        "parameters": (", ".join(effect.parameters()), ""),
        "action_units": (repr(effect.action_units(arm)), ""),
    }
    if type(effect).travel is not Effect.travel:  # which has those of its impacts that are finite
        found["travel"] = (repr(sorted(effect.travel(arm).items())), "")
    parts: dict[str, Any] = {}
    for n, hook in enumerate(hooks):
        name = f"hook {n} ({type(hook).__name__})"
        parts |= {name: hook, **{f"{name}, state {s.name!r}": s for s in states_of(hook)}}
    described = functools.cache(function_described)
    for name, part in parts.items():
        for f in dataclasses.fields(part):
            value = getattr(part, f.name)
            if f.name == "states":
                shown = str([state.name for state in value]), ""
            elif callable(value):
                shown = described(value)
            else:
                shown = repr(sorted(value.items()) if isinstance(value, Mapping) else value), ""
            found[f"{name}, {f.name}"] = shown
    return found


def function_described(function: Any) -> tuple[str, str]:
    """Name of a function, and all that it computes."""
    try:
        return name_of(function), dialect.computed_by(function)
    except ValueError as error:
        return name_of(function), str(error)
