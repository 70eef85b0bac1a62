"""Numbers that what is made from them must not hold: hooks and functions are made again, with others.

A number of an effect, an arm or a task is set per environment, and is known to a compiled function only as an
argument. One that Python computed with, in a closure, an ``if`` or a default, would stay what it was when the
scene was made. So everything is made again with other numbers, and must come out the same.
"""

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
from redundant_envs.effects.numbers import fields_with
from redundant_envs.language.algebra import name_of
from redundant_envs.robots.arm import Arm
from redundant_envs.support.values import replaced, with_fields

Described = dict[str, str]
"""What is made from numbers: its name -> a text, equal if it is the same, whose first line is shown."""
STEADY = 8  # how often something is made again before a difference is put down to a number
FEW = 3  # with fewer other values accepted among those of all numbers, a number is changed alone
THRESHOLDS = 8  # most numbers with which one number is compared that are tried


class Place(NamedTuple):
    """A number."""

    owner: int  # which one has it
    name: str  # its name there, "field" or "field[k]"


class Owner(NamedTuple):
    """Something with numbers."""

    name: str  # in messages
    thing: Any  # a frozen dataclass
    fix: Callable[[str], str]  # what to write instead of using the number of a name


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
        others = {place: _others(n, value) for n, (place, value) in enumerate(self.values.items())}
        trials = [dict(zip(others, values, strict=True)) for values in zip(*others.values(), strict=True)]
        for values in (*trials, *_far_apart(self.values)):
            for place in self.tried(values):
                accepted[place] += 1
        watched = {place: _Watched(value) for place, value in self.values.items()}
        self.try_describe(self.changed(watched, checked=False))
        for place, value in self.values.items():
            near = _across([*dict.fromkeys(watched[place].seen)][:THRESHOLDS], value)
            for other in (*near, *others[place]):
                if accepted[place] < FEW or other in near:
                    accepted[place] += len(self.tried({place: other}))
            if accepted[place] == 0:
                # no other value is allowed, or none was guessed: the checks of its class are left out
                self.refuse({place: 1.25 * value + 0.1})

    def tried(self, values: Mapping[Place, Any]) -> list[Place]:
        """The numbers whose owners accept other values; ValueError if these make a difference."""
        changed = self.changed(values)
        description = self.try_describe([c or t for c, t in zip(changed, self.things, strict=True)])
        if description is None:
            return []
        if description != self.nominal:
            self.check_steady(STEADY)
            self.refuse(values)
        return [place for place in values if changed[place.owner] is not None]

    def changed(self, values: Mapping[Place, Any], checked: bool = True) -> list[Any]:
        """All things, with other numbers; None for one whose class checks and does not allow them."""
        changed = list(self.things)
        for o in {place.owner for place in values}:
            numbers = {place.name: value for place, value in values.items() if place.owner == o}
            fields = fields_with(self.things[o], numbers)
            changed[o] = (_accepted if checked else with_fields)(self.things[o], **fields)
        return changed

    def try_describe(self, things: Sequence[Any]) -> Described | None:
        """What is made of things; None if they refuse it, as one may whose numbers do not fit each other."""
        try:
            return self.described(*things)
        except Exception:  # a user's own text, which did not expect these numbers, may fail in any way
            return None

    def check_steady(self, times: int) -> None:
        """ValueError if what is made of the same numbers is not the same."""
        for _ in range(times):
            description = self.described(*self.things)
            if description != self.nominal:
                raise ValueError(f"{self.name}: {self.difference(description)} {dialect.CHANGES}")

    def difference(self, other: Described) -> str:
        return next(name for name in (*self.nominal, *other) if self.nominal.get(name) != other.get(name))

    def refuse(self, values: Mapping[Place, Any]) -> None:
        """ValueError about the number on which something depends, one of those with other values; none if the
        values are not accepted and make no difference."""
        for place, value in values.items():
            things = self.changed({place: value})
            if things[place.owner] is None:
                things = self.changed({place: value}, checked=False)
            description = self.try_describe(things)
            if description is None or description == self.nominal:
                continue
            what = self.difference(description)
            was, shown = (d.get(what, "nothing").partition("\n")[0] for d in (self.nominal, description))
            how = f"is {was} at {self.values[place]:.6g} and {shown} at {value:.6g}"
            if was == shown:
                how = f"{shown} computes with the number itself"
            owner = self.owners[place.owner]
            of = "" if place.owner == 0 else f" of {owner.name}"
            raise ValueError(
                f"{self.name} does not follow its number {place.name}{of} when it is set: {what} {how}; "
                f"{owner.fix(place.name)}"
            )
        if len(values) > 1:
            names = ", ".join(place.name for place in values)
            raise ValueError(
                f"{self.name} does not follow its numbers when several of {names} are set; "
                f"{self.owners[0].fix(next(iter(values)).name)}"
            )


def _accepted(thing: Any, **fields: Any) -> Any:
    """A thing with other numbers; None if its class refuses them, or fails in any way."""
    try:
        return replaced(thing, **fields)
    except Exception:
        return None


class _Watched(float):
    """A float that notes what it is compared with."""

    def __init__(self, _: float) -> None:
        self.seen: list[float] = []

    @staticmethod
    def noting(compare: Callable[[Any, Any], Any]) -> Any:
        def noted(self: "_Watched", other: Any) -> Any:
            if isinstance(other, int | float):
                self.seen.append(float(other))
            return compare(float(self), other)

        return noted

    __lt__, __le__, __gt__ = noting(operator.lt), noting(operator.le), noting(operator.gt)
    __ge__, __eq__, __ne__ = noting(operator.ge), noting(operator.eq), noting(operator.ne)
    __hash__ = float.__hash__

    def __bool__(self) -> bool:
        return bool(self != 0.0)


def _numbers(things: Sequence[Any]) -> Iterator[tuple[Place, Any]]:
    for o, thing in enumerate(things):
        for f in dataclasses.fields(thing):
            if f.name in getattr(thing, "static", ()) or not f.init:
                continue
            value = getattr(thing, f.name)
            row = {f"{f.name}[{k}]": x for k, x in enumerate(value)} if isinstance(value, tuple) else None
            for name, number in ({f.name: value} if row is None else row).items():
                if isinstance(number, int | float) and not isinstance(number, bool):
                    yield Place(o, name), number


FACTORS = 1.1, 0.9, 1.25, 0.8, 1.001, 16.0, 1.0 / 16.0, 1e3, 1e-3, -1.0, -1e3, 0.0


def _others(n: int, value: Any) -> list[Any]:
    """Other numbers instead of the n-th one: nearby and far, of either sign, whole ones for a whole one."""
    base = value or 1.0 if math.isfinite(value) else math.copysign(1.0, value)
    step = 1 + n % 5
    scale = 1.0 + 0.017 * (n % 11) + 0.001 * (n % 7)  # of each number: what depends on a ratio differs, too
    return [base + step, base - step, 2 * base, *(scale * factor * base for factor in FACTORS)]


def _far_apart(numbers: Mapping[Place, Any]) -> Iterator[dict[Place, Any]]:
    """Other numbers of the first owner, any two of which are once much further apart than they were, in
    either order: what compares a ratio or a difference differs."""
    places = [place for place in numbers if place.owner == 0]
    for bit, up in itertools.product(range((len(places) - 1).bit_length()), (0, 1)):
        factors = (1e3 if (n >> bit) & 1 == up else 1e-3 for n in range(len(places)))
        yield {p: f * (numbers[p] or 1.0) for p, f in zip(places, factors, strict=True)}


def _across(seen: Sequence[float], value: float) -> list[float]:
    """Numbers at those with which a number is compared, on either side of each, and between them."""
    candidates = [math.nextafter(c, to) for c in seen for to in (-math.inf, c, math.inf)]
    candidates += [2.0 * c - value for c in seen]
    candidates += [0.5 * (a + b) for a, b in itertools.pairwise(sorted(seen))]
    return [x for x in candidates if math.isfinite(x)]


def check_effect(where: str, effect: Effect, arm: Arm) -> None:
    """ValueError if the hooks of an effect would not follow when its numbers or those of the arm are set."""

    def bind(name: str) -> str:
        field = name.partition("[")[0]
        return (
            f"take it as an argument of the function and bind it, bind={{{field!r}: '.{name}'}}, or name "
            f"{field!r} in 'static' if it is part of the structure and is never set"
        )

    owner = Owner(f"{where} ({type(effect).__name__})", effect, bind)
    check_captured((owner, Owner("the arm", arm, of_the_arm)), hooks_described)


def of_the_arm(name: str) -> str:
    number = f"{name[0]}{int(name.partition('[')[2][:-1]) + 1}"
    return f"take it as the argument {number} of the function, which needs no bind"


def hooks_described(effect: Effect, arm: Arm) -> Described:
    """Everything that a scene takes from an effect, but for its numbers."""
    hooks = effect.hooks(arm)
    properties: dict[str, Any] = {
        "the number of hooks": len(hooks), "key": effect.key, "parameters": [*effect.parameters()],
        "action_units": effect.action_units(arm),
    }  # fmt: skip
    if type(effect).travel is not Effect.travel:  # which has those of its impacts that are finite
        properties["travel"] = sorted(effect.travel(arm).items())
    parts: dict[str, Any] = {}
    for n, hook in enumerate(hooks):
        name = f"hook {n} ({type(hook).__name__})"
        parts |= {name: hook, **{f"{name}, state {s.name!r}": s for s in states_of(hook)}}
    for name, part in parts.items():
        for f in dataclasses.fields(part):
            value = getattr(part, f.name)
            if isinstance(value, Mapping):
                value = sorted(value.items())
            properties[f"{name}, {f.name}"] = [s.name for s in value] if f.name == "states" else value
    described = functools.cache(function_described)
    return {name: described(x) if callable(x) else repr(x) for name, x in properties.items()}


def function_described(function: Any) -> str:
    """Name of a function, and all that it computes."""
    try:
        return f"{name_of(function)}\n{dialect.computed_by(function)}"
    except ValueError as error:
        return f"{name_of(function)}\n{error}"
