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

from redundant_envs.algebra import arguments_of, numbered
from redundant_envs.draws import DRAW, MOST_DRAWS, START_OF_EPISODES, Draw, stream_of
from redundant_envs.effects import REGISTRY, hooks
from redundant_envs.effects.hooks import Actuation, Effect, Force, Hook, Inertia, State, states_of
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
        """Values at the start of a motion; 0 for those that are computed then."""
        return {name: 0.0 if callable(s.initial) else s.initial for name, s in self.items()}

    @cached_property
    def computed(self) -> tuple[str, ...]:
        """Those whose values at the start of a motion are computed."""
        return tuple(name for name, state in self.items() if callable(state.initial))

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
    def draws(self) -> dict[str, Draw]:
        """Draws by the names of quantities; ValueError if states take too many, or two streams are one."""
        taken = [
            (name, a.key, *_root_and_index(state.name), *_kind_and_number(name))
            for a in self
            for state, functions in zip(states_of(a.hook), a.states.values(), strict=True)
            for name in dict.fromkeys(n for own in ("update", "initial") if own in functions
                                      for n in functions[own].names if DRAWN in n)
        ]  # fmt: skip
        most: dict[tuple[str, str, bool], int] = {}
        """Draws of a kind that each state of a name may take: those of the next one follow."""
        for _, key, root, _, normal, number in taken:
            most[key, root, normal] = max(most.get((key, root, normal), 0), number)
        _check_streams((key, root) for key, root, _ in most)
        made = {}
        for name, key, root, index, normal, number in taken:
            place = index * most[key, root, normal] + number - 1
            if place >= MOST_DRAWS:
                raise ValueError(
                    f"the states {root!r} of {key!r} take more than {MOST_DRAWS} draws of a kind; take "
                    "fewer, or give some of the states another name"
                )
            made[name] = Draw(stream_of(key, root), normal, place)
        return made

    @cached_property
    def take_interval(self) -> bool:
        """Whether functions take the control interval."""
        own = (f for a in self for functions in (a.functions, *a.states.values()) for f in functions.values())
        return any(hooks.INTERVAL in f.names for f in own)

    @cached_property
    def chains(self) -> dict[str, list[Attached[Actuation]]]:
        """For the command of each motor the links between it and the effort, in order."""
        links = sorted(self.of(Actuation), key=lambda link: link.hook.link)
        return {c: [a for a in links if a.hook.joint == k] for k, c in enumerate(self.commands)}

    def along(self, x: Quantities, only: Iterable[Any] | None = None) -> Iterator[Attached[Any]]:
        """Forces, then the links of motors; while a link is evaluated, its command in ``x`` is the input of
        the link. With ``only``, motors without one of these links are left out."""
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
        """Masses of the arm to which effects add others: the parameters of those."""
        loads: dict[str, list[str]] = {}
        for a in self.of(hooks.PointMass):
            loads.setdefault(f"m{a.hook.point.number + 1}", []).append(a.parameter(a.hook.mass))
        return loads

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
            masses = tuple(sum((values[n] for n in self.carried.get(m, ())), mass) for m, mass in own.items())
            checked = positive_numbers("masses with what effects add", masses, arm.num_masses, "kg")
            arm = dataclasses.replace(arm, masses=checked)
        self.check_inertias(arm, values)
        found = {name: values[name] for _, name in self.inertias}
        return with_inertias(arm, self.inertias, found) if found else arm


DRAWN = " draws "
"""Between the field of a state and its draw in the name of a quantity, as in no other name."""


def _root_and_index(state: str) -> tuple[str, int]:
    """noise[3] -> noise, 3; a state without an index is the first of its name."""
    root, _, index = state.partition("[")
    return root, int(index[:-1] or 0) if index else 0


def _kind_and_number(name: str) -> tuple[bool, int]:
    """Whether a draw is normal, and its number, from the name of its quantity."""
    found = DRAW.fullmatch(name.partition(DRAWN)[2])
    assert found
    return found[1] == "normal", int(found[2])


def _check_streams(states: Iterable[tuple[str, str]]) -> None:
    """ValueError if draws of two effects' states, or of one and an episode's start, would be the same."""
    streams = {START_OF_EPISODES: "the start of an episode"}
    for key, root in states:
        name = f"{key}.{root}"
        other = streams.setdefault(stream_of(key, root), name)
        if other != name:
            raise ValueError(
                f"effects have the states {name!r}, whose draws would be those of {other!r}: their names "
                "have the same hash; rename one of these states, or give its effect another 'key'"
            )


def _attached(effect: Effect, hook: Any, laws: Iterator[int]) -> Attached[Any]:
    key, law = effect.key, "" if getattr(hook, "switch", None) is None else f"switch{next(laws)}"

    def name_of(source: str) -> str:
        if source == hooks.SIDE and law:
            return f"side_{law}"
        return f"{key}{source}" if source.startswith(".") else source

    def bound(part: Any) -> Functions:
        values = {f.name: getattr(part, f.name) for f in dataclasses.fields(part)}

        def quantity(argument: str) -> str:
            source = part.bind.get(argument, argument)
            if isinstance(part, State) and DRAW.fullmatch(source):  # every state has its own
                return f"{key}.{part.name}{DRAWN}{source}"
            return name_of(source)

        return {
            field: Bound(f, tuple(map(quantity, arguments_of(f))), key)
            for field, f in values.items()
            if callable(f)
        }

    states = {name_of(f".{s.name}"): bound(s) for s in states_of(hook)}
    return Attached(effect, hook, bound(hook), states, law)
