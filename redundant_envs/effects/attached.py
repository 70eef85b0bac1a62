"""The hooks of a scene's effects, bound once: every function with the names of the quantities that it takes.

Names are those of a lane: quantities of the arm, and numbers and states of effects under the names of their
fields.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from redundant_envs.algebra import ABSENT, arguments_of, numbered, total
from redundant_envs.effects import REGISTRY, hooks
from redundant_envs.effects.hooks import Actuation, Effect, Field, Force, Hook, Inertia, State, states_of
from redundant_envs.quantities import Quantities
from redundant_envs.robots.added_inertia import LARGEST_RATIO, Added, with_inertias
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import positive_numbers
from redundant_envs.tracing.graph import owned

OWN_KEYS = frozenset(
    hooks.snake_case(name) for name, kind in REGISTRY.items() if kind.__module__.startswith("redundant_envs.")
)
"""First parts of the parameter names of this package's effects; none is like a name of a field."""
Kind = TypeVar("Kind", covariant=True)


def identifier(parameter: str) -> str:
    """A parameter of an effect as an argument of a task: "gravity.down[0]" -> gravity_down_0; effects of
    users get two underscores, "my_spring.k" -> my_spring__k, which no generated name has."""
    dot = "_" if parameter.partition(".")[0] in OWN_KEYS else "__"
    return parameter.replace(".", dot).replace("[", dot).replace("]", "")


@dataclass(frozen=True)
class Bound:
    """A function of the effect ``key``, and the names of the quantities that it takes, in order."""

    function: Callable[..., Any]
    names: tuple[str, ...]
    key: str

    def __call__(self, x: Quantities) -> Any:
        """Evaluate it on quantities."""
        return self.on(x.each(self.names))

    def on(self, arguments: Iterable[Any]) -> Any:
        """Evaluate it on the values of its arguments."""
        with owned(self.key):
            return self.function(*arguments)


Functions = Mapping[str, Bound]
"""The functions that a hook or a state has, by their fields, such as "damping"."""


@dataclass(frozen=True, eq=False)
class Attached(Generic[Kind]):
    """A hook of an effect."""

    effect: Effect
    hook: Kind
    functions: Functions
    states: Mapping[str, Functions]  # field of each of its states -> functions of the state
    law: str  # name of the boundary at which a force changes its law; "" without one

    @property
    def key(self) -> str:
        """Key of its effect."""
        return self.effect.key

    @property
    def side(self) -> str:
        """The field with the law of a force that holds; see :attr:`Boundary.side`."""
        return f"side_{self.law}"

    def parameter(self, own: str) -> str:
        """Name of a parameter of its effect, which the hook names ".lower", and of its field."""
        return f"{self.key}{own}"

    def number(self, own: str) -> float:
        """Nominal value of such a parameter."""
        return self.effect.parameters()[own[1:]]

    def changes(self, what: str, x: Quantities) -> dict[str, Any]:
        """Results of the functions of its states that are the "derivative" or the "update", by field."""
        return {field: own[what](x) for field, own in self.states.items() if what in own}


class EffectStates(dict[str, State]):
    """The states of a scene's effects by their fields, in the order of :meth:`Scene.states`."""

    @cached_property
    def initial(self) -> dict[str, float]:
        """Values at the start of a motion."""
        return {name: state.initial for name, state in self.items()}

    @cached_property
    def integrated(self) -> tuple[str, ...]:
        """Those that steps integrate."""
        return tuple(name for name, state in self.items() if state.derivative is not None)

    @cached_property
    def updated(self) -> tuple[str, ...]:
        """Those that are constant within an interval, and updated at its end."""
        return tuple(name for name, state in self.items() if state.update is not None)


class Attachments(tuple[Attached[Hook], ...]):
    """All hooks of a scene, in the order of its effects."""

    commands: tuple[str, ...]
    """Fields of the commanded efforts."""

    @classmethod
    def to(cls, arm: Arm, effects: Sequence[Effect]) -> Attachments:
        """The hooks of effects on an arm."""
        laws = itertools.count(1)
        made = cls(_attached(effect, hook, laws) for effect in effects for hook in effect.hooks(arm))
        made.commands = tuple(numbered("command{}", len(arm.joints)))
        return made

    def of(self, *kinds: type[Kind]) -> tuple[Attached[Kind], ...]:
        """Hooks of some kinds."""
        every: tuple[Attached[Any], ...] = self
        return tuple(a for a in every if isinstance(a.hook, kinds))

    def keys_of(self, *kinds: type) -> set[str]:
        """Keys of the effects with hooks of some kinds."""
        return {a.key for a in self if isinstance(a.hook, kinds)}

    @cached_property
    def states(self) -> EffectStates:
        """States of the effects."""
        pairs = (zip(a.states, states_of(a.hook), strict=True) for a in self)
        return EffectStates(itertools.chain.from_iterable(pairs))

    @cached_property
    def chains(self) -> dict[str, list[Attached[Actuation]]]:
        """For the command of each motor the links between it and the effort, in order."""
        links = sorted(self.of(Actuation), key=lambda link: link.hook.link)
        return {c: [a for a in links if a.hook.joint == k] for k, c in enumerate(self.commands)}

    @cached_property
    def constant_fields(self) -> tuple[Attached[Field], ...]:
        """Fields that follow from parameters alone: these have a potential."""
        states = self.states.keys()
        return tuple(a for a in self.of(Field) if states.isdisjoint(a.functions["function"].names))

    @cached_property
    def moving_fields(self) -> tuple[Attached[Field], ...]:
        """Fields that change with states of their effects."""
        return tuple(a for a in self.of(Field) if a not in self.constant_fields)

    def along(self, x: Quantities, only: Iterable[Any] | None = None) -> Iterator[Attached[Any]]:
        """Moving fields, forces, then the links of motors; while a link is evaluated, its command in ``x`` is
        the input of the link. With ``only``, motors without one of these links are left out."""
        yield from self.moving_fields
        yield from self.of(Force)
        for command, chain in self.chains.items():
            if only is not None and not any(link in only for link in chain):
                continue
            given = x[command]
            for link in chain:
                yield link
                x[command] = link.functions["function"](x)
            x[command] = given

    # ---- masses and inertias that effects add to those of the arm ----

    @cached_property
    def carried(self) -> dict[str, list[str]]:
        """Masses of the arm to which effects add others: the parameters and states of those."""
        loads: dict[str, list[str]] = {}
        for a in self.of(hooks.PointMass):
            loads.setdefault(f"m{a.hook.point.number + 1}", []).append(a.parameter(a.hook.mass))
        return loads

    @cached_property
    def changing(self) -> dict[str, list[str]]:
        """Masses of the arm that change between intervals: the states that are parts of them."""
        parts = {m: [name for name in loads if name in self.states] for m, loads in self.carried.items()}
        return {mass: states for mass, states in parts.items() if states}

    def moving_masses(self, parameters: Mapping[str, Any], states: Mapping[str, Any]) -> dict[str, Any]:
        """Masses of the arm to which effects add others, from the numbers of the scene and from states."""
        known = {**parameters, **states}
        return {m: total(known[n] for n in (m, *loads)) for m, loads in self.carried.items()}

    def check_inertias(self, arm: Arm, values: Mapping[str, Any]) -> None:
        """ValueError if one of the parameters, numbers or arrays of lanes, is a negative inertia, or one so
        large that rounding hides the arm."""
        for a in self.of(Inertia):
            name, slides = a.parameter(a.hook.inertia), arm.prismatic[a.hook.joints[0]]
            least = np.min([values[f"m{k + 1}"] for k in range(arm.num_masses)], axis=0)
            if not slides and arm.num_lengths:
                least = least * np.min([values[f"l{k + 1}"] for k in range(arm.num_lengths)], axis=0) ** 2
            found, most = np.broadcast_arrays(values[name], LARGEST_RATIO * least)
            wrong = np.flatnonzero(~((found >= 0.0) & (found <= most)))
            if wrong.size:
                inertia, allowed = found.flat[wrong[0]], most.flat[wrong[0]]
                raise ValueError(
                    f"{name} is {inertia:g}; give 0 to {allowed:g} {'kg' if slides else 'kg m^2'}, a million "
                    f"times the lightest mass{'' if slides else ' on the shortest link'}: rounding would "
                    "hide the arm behind more"
                )

    @cached_property
    def inertias(self) -> Added:
        """Inertias that effects add to the arm: the joints of each, and the field with its number."""
        return tuple((a.hook.joints, a.parameter(a.hook.inertia)) for a in self.of(Inertia))

    def loaded(self, arm: Arm, values: Mapping[str, float]) -> Arm:
        """The arm with the masses and inertias that effects add to its own, from all parameters; ValueError
        if a mass is not positive then, or an inertia negative."""
        if self.carried:
            own = {f"m{k + 1}": mass for k, mass in enumerate(arm.masses)}
            known = {**values, **self.states.initial}
            masses = tuple(sum((known[n] for n in self.carried.get(m, ())), mass) for m, mass in own.items())
            checked = positive_numbers("masses with what effects add", masses, arm.num_masses, "kg")
            arm = dataclasses.replace(arm, masses=checked)
        self.check_inertias(arm, values)
        found = {name: values[name] for _, name in self.inertias}
        return with_inertias(arm, self.inertias, found) if found else arm


def field_of(fields: Iterable[Attached[Field]], x: Quantities) -> tuple[Any, Any]:
    """The sum (ax, ay) of some fields; absent without any."""
    found = [field.functions["function"](x) for field in fields]
    return (total(ax for ax, _ in found), total(ay for _, ay in found)) if found else (ABSENT, ABSENT)


def _attached(effect: Effect, hook: Any, laws: Iterator[int]) -> Attached[Any]:
    key, law = effect.key, "" if getattr(hook, "switch", None) is None else f"switch{next(laws)}"

    def name_of(source: str) -> str:
        if source == hooks.SIDE and law:
            return f"side_{law}"
        return f"{key}{source}" if source.startswith(".") else source

    def bound(part: Any) -> Functions:
        values = {f.name: getattr(part, f.name) for f in dataclasses.fields(part)}
        return {
            field: Bound(f, tuple(name_of(part.bind.get(a, a)) for a in arguments_of(f)), key)
            for field, f in values.items()
            if callable(f)
        }

    states = {name_of(f".{s.name}"): bound(s) for s in states_of(hook)}
    return Attached(effect, hook, bound(hook), states, law)
