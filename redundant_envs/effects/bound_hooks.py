"""The hooks of a scene's effects, bound once: every function with the names of the quantities that it takes,
which are those of a lane: quantities of the arm, and numbers and states of effects by their fields."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from redundant_envs import effects
from redundant_envs.compiler import dialect
from redundant_envs.compiler.tracing.graph import owned
from redundant_envs.effects import hooks
from redundant_envs.effects.hooks import Actuation, Effect, Field, Hook, State, functions_of, states_of
from redundant_envs.effects.validate_hooks import roots_of
from redundant_envs.language.algebra import ABSENT, arguments_of, numbered, total, where
from redundant_envs.language.draws import DRAW, MAX_DRAWS, START_OF_EPISODES, Draw, stream_of
from redundant_envs.language.limits import side_beyond
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.added_inertia import LARGEST_RATIO, Added, with_inertias
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import positive_numbers

Kind = TypeVar("Kind", covariant=True)


@functools.cache
def _own_keys() -> set[str]:
    """First parts of the parameter names of this package's effects; none is like a name of a field."""
    return {*map(hooks.snake_case, effects.OWN)}


def identifier(parameter: str) -> str:
    """A parameter of an effect as an argument of a task: "gravity.down[0]" -> gravity_down_0; effects of
    users get two underscores, "my_spring.k" -> my_spring__k, which no generated name has."""
    dot = "_" if parameter.partition(".")[0] in _own_keys() else "__"
    return parameter.replace(".", dot).replace("[", dot).replace("]", "")


TIME = "time in the step"
"""Name of the time that a state's closed form takes: it is no identifier, so no other quantity has it."""


@dataclass(frozen=True)
class Bound:
    """A function of the effect ``key``, and the names of the quantities that it takes, in order."""

    function: Callable[..., Any]
    names: tuple[str, ...]
    key: str

    def __call__(self, x: Quantities) -> Any:
        return self.on(x.each(self.names))

    def on(self, arguments: Iterable[Any]) -> Any:
        with owned(self.key):
            return self.function(*arguments)


Functions = Mapping[str, Bound]
"""The functions that a hook or a state has, by their fields, such as "damping"."""
INSTANT_UPDATE = "renewal"
"""Key of the update of a state at an instant, among the functions of the state."""


@dataclass(frozen=True, eq=False)
class Attached(Generic[Kind]):
    """A hook of an effect."""

    effect: Effect
    hook: Kind
    functions: Functions
    states: Mapping[str, Functions]  # field of each of its states -> functions of the state
    law: str  # name of the boundary at which a force with a switch changes its law; "" without one
    guards: tuple[str, ...]  # names of the boundaries at which the values of its guard change their signs

    @property
    def key(self) -> str:
        return self.effect.key

    @property
    def side(self) -> str:
        """The field with the law of a force that holds; see :attr:`Boundary.side`."""
        return f"side_{self.law}"

    @property
    def has_laws(self) -> bool:
        return bool(self.law or self.guards)

    def takes_foreign(self, command: str) -> bool:
        """Whether a function takes a command that is not the input of its own link."""
        own = isinstance(self.hook, Actuation) and command == f"command{self.hook.joint + 1}"
        every = (bound for laws in (self.functions, *self.states.values()) for bound in laws.values())
        return not own and any(command in bound.names for bound in every)

    def guard_values(self, x: Quantities) -> tuple[Any, ...]:
        values = self.functions["guard"](x) if self.guards else ()
        return values if isinstance(values, tuple) else (values,)

    def settle_law(self, x: Quantities) -> None:
        """Let the quantities themselves decide which of its laws holds."""
        if self.law:
            hook: Any = self.hook
            x[self.side] = side_beyond(*x.each((hook.motion[0], *map(self.parameter, hook.switch))))
        for name, value in zip(self.guards, self.guard_values(x), strict=True):
            x[f"side_{name}"] = where(value >= 0.0, 1.0, -1.0)

    @property
    def instant(self) -> str:
        """The field with the time of the instant of its effect."""
        return f"instant_{self.key}"

    @property
    def passed(self) -> str:
        """The field that says whether the instant of its effect has passed."""
        return f"passed_{self.key}"

    def parameter(self, name: str) -> str:
        """Name of a parameter of its effect, which the hook names ".lower", and of its field."""
        return f"{self.key}{name}"

    def number(self, name: str) -> float:
        """Nominal value of such a parameter."""
        return self.effect.parameters()[name[1:]]

    def changes(self, what: str, x: Quantities) -> dict[str, Any]:
        """Results of the functions of its states that are the "derivative", the "update" at the end of an
        interval, or :data:`INSTANT_UPDATE`, by field."""
        return {field: functions[what](x) for field, functions in self.states.items() if what in functions}


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

    integrated = cached_property(lambda self: self._with("derivative"))
    """Those that steps integrate."""
    closed = cached_property(lambda self: self._with("closed"))
    """Those of the integrated ones that have a closed form, too."""
    updated = cached_property(lambda self: self._with("update"))
    """Those that are constant within a piece of an interval, and updated at its end or at an instant."""

    def _with(self, field: str) -> tuple[str, ...]:
        return tuple(name for name, state in self.items() if getattr(state, field) is not None)


class Attachments(tuple[Attached[Hook], ...]):
    """All hooks of a scene, in the order of its effects."""

    commands: tuple[str, ...]
    """Fields of the commands: one for each motor, unless the links of an effect share others."""
    sharing: tuple[str, tuple[str, ...]] | None
    """The key of that effect, and the units of its commands."""

    @classmethod
    def to(cls, arm: Arm, effects: Sequence[Effect], controlled: bool) -> "Attachments":
        """The hooks of effects on an arm; ``controlled``: changes of laws are located."""
        every, sharing = [(effect, hook) for effect in effects for hook in effect.hooks(arm)], None
        if shares := [effect for effect in effects if effect.shared_commands(arm)]:
            sharing = _sharing(arm, shares)
            every = _without_idle(every, *sharing)
        names = {effect.key: {*effect.parameters()} for effect in effects}
        for effect, hook in every:
            names[effect.key] |= {state.name for state in states_of(hook)}
        attached = functools.partial(_attached, names, itertools.count(1), itertools.count(1))
        commands = tuple(numbered("command{}", len(sharing[1] if sharing else arm.joints)))
        instance = cls(attached(*pair) for pair in every)
        instance.commands, instance.sharing = commands, sharing
        for name in numbered("command{}", len(arm.joints))[len(commands) :]:
            if takers := [a.key for a in instance if a.takes_foreign(name)]:
                raise ValueError(
                    f"effects: {takers[0]!r} takes {name}, and there are {len(commands)} commands"
                )
        if controlled and (located := instance._locating(arm)):
            instance = cls(attached(a.effect, a.hook, by_side=True) if a in located else a for a in instance)
            instance.commands, instance.sharing = commands, sharing
        return instance

    def _locating(self, arm: Arm) -> set[Attached[Any]]:
        """Links with another law for each side of a guard whose commands change within an interval."""
        links: set[Attached[Any]] = set()
        for command, chain in self.links():
            moves = False
            for link in chain:
                if moves and link.hook.by_side is not None:
                    links.add(link)
                names = link.functions["function"].names
                moves = any(moves if n == command else self._moves(n, arm) for n in names)
        return links

    def _moves(self, name: str, arm: Arm) -> bool:
        """Whether a quantity that a link takes changes within an interval: no number, instant or state that
        is updated at the end of an interval does."""
        if name in self.states:
            return name in self.states.integrated
        if "." in name or name == hooks.CONTROL_DT or name.startswith(("passed_", "side_")):
            return False
        return not roots_of(name, arm).isdisjoint((*arm.coordinates, *arm.rates))

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
        taken: dict[str, tuple[tuple[str, str, bool], int, int]] = {}
        most: dict[tuple[str, str, bool], int] = {}
        """Draws of a kind that each state of a name may take: those of the next one follow."""
        for a in self:
            for state, functions in zip(states_of(a.hook), a.states.values(), strict=True):
                root, _, index = state.name.partition("[")
                for name in (name for bound in functions.values() for name in bound.names if DRAWN in name):
                    kind, number = DRAW.findall(name.partition(DRAWN)[2])[0]
                    of_kind = a.key, root, kind == "normal"
                    most[of_kind] = max(most.get(of_kind, 0), int(number))
                    taken[name] = of_kind, int(index[:-1] or 0), int(number)
        streams = {START_OF_EPISODES: "the start of an episode"}
        for key, root, _ in most:
            name, other = f"{key}.{root}", streams.setdefault(stream_of(key, root), f"{key}.{root}")
            if other != name:
                raise ValueError(f"the draws of {name!r} would be those of {other!r}: rename one of them")
        draws = {}
        for name, ((key, root, normal), k, draw) in taken.items():
            place = k * most[key, root, normal] + draw - 1
            if place >= MAX_DRAWS:
                raise ValueError(f"states {root!r} of {key!r} take more than {MAX_DRAWS} draws; take fewer")
            draws[name] = Draw(stream_of(key, root), normal, place)
        return draws

    @cached_property
    def chains(self) -> dict[str, list[Attached[Actuation]]]:
        """For the command of each motor the links between it and the effort, in order; where links share
        commands, those from the shared one on."""
        return self.stages[-1]

    @cached_property
    def stages(self) -> list[dict[str, list[Attached[Actuation]]]]:
        """The chains of the motors; where links share commands, first the links in front of these, by the
        shared commands, on all of which they act before any of these."""
        links = sorted(self.of(Actuation), key=lambda link: link.hook.link)
        if self.sharing is None:
            return [{c: [a for a in links if a.hook.joint == k] for k, c in enumerate(self.commands)}]
        joints = sorted(a.hook.joint for a in links if a.key == self.sharing[0])
        chains = {f"command{k + 1}": [a for a in links if a.hook.joint == k] for k in joints}
        begin = {c: [a.key for a in chain].index(self.sharing[0]) for c, chain in chains.items()}
        front = {c: chains[c][: begin[c]] for c in self.commands}
        return [front, {c: chain[begin[c] :] for c, chain in chains.items()}]

    def efforts_behind(self, key: str, x: Quantities) -> list[Any]:
        """What leaves the links of an effect at all joints, one at each."""
        efforts, given = [], x.each(self.commands)
        for chains in self.stages:
            for command, chain in chains.items():
                for link in chain:
                    reached = link.functions["function"](x)
                    if link.key == key:
                        efforts.append(reached)
                        break
                    x[command] = reached
        x.update(zip(self.commands, given, strict=True))
        return efforts

    def links(self) -> Iterator[tuple[str, list[Attached[Actuation]]]]:
        """Chains of links, each with the name of its command, in the order in which they act."""
        return itertools.chain.from_iterable(chains.items() for chains in self.stages)

    def units_along(self, joint: int, arm: Arm) -> list[tuple[Effect | None, str]]:
        """Units in the chain of a joint's motor: of what reaches each link, with its effect, and of what
        leaves the last one, with None; ValueError if they do not meet."""
        effort, chain = hooks.effort_unit(arm, joint), self.chains[f"command{joint + 1}"]
        unit, giver = next((a.hook.takes for a in chain if a.hook.takes), effort), ""
        units: list[tuple[Effect | None, str]] = []
        if self.sharing is not None:
            units.append((chain[0].effect, ", ".join(dict.fromkeys(self.sharing[1]))))
            unit, giver, chain = chain[0].hook.gives or effort, chain[0].key, chain[1:]
        for link in chain:
            units.append((link.effect, unit))
            takes = link.hook.takes
            if not takes:  # it hands on what it gets
                continue
            if takes != unit:
                raise ValueError(
                    f"effects: at {arm.joints[joint]} {giver!r} gives {unit!r}, and {link.key!r} behind it "
                    f"takes {takes!r}; leave one of them out, or change the 'link' of one"
                )
            unit, giver = link.hook.gives or effort, link.key
        if unit != effort:
            raise ValueError(f"at {arm.joints[joint]} {giver!r} gives {unit!r}, not {effort!r}; add a motor")
        return [*units, (None, unit)]

    @property
    def instants(self) -> tuple[Attached[hooks.Instant], ...]:
        return self.of(hooks.Instant)

    def take(self, name: str) -> bool:
        """Whether one of the functions takes a quantity."""
        every = (bound for a in self for laws in (a.functions, *a.states.values()) for bound in laws.values())
        return any(name in bound.names for bound in every)

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
        yield from self.of(hooks.Force)
        whole = only is None or self.sharing is not None  # links of all motors depend on shared commands
        given = x.each(self.commands)
        for chains in self.stages:
            reached: dict[str, Any] = {}
            for command, chain in chains.items():
                if not whole and not any(link in only for link in chain):  # type: ignore[operator]
                    continue
                original = x[command] if command in self.commands else x.get(command)
                for link in chain:
                    yield link
                    x[command] = link.functions["function"](x)
                reached[command], x[command] = x[command], original
            x.update(reached if chains is not self.stages[-1] else zip(self.commands, given, strict=True))

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
        for a in self.of(hooks.Inertia):
            name, slides = a.parameter(a.hook.inertia), arm.prismatic[a.hook.joints[0]]
            least = np.min([values[f"m{k + 1}"] for k in range(arm.num_masses)], axis=0)
            if not slides and arm.num_lengths:
                least = least * np.min([values[f"l{k + 1}"] for k in range(arm.num_lengths)], axis=0) ** 2
            inertias, most = np.broadcast_arrays(values[name], LARGEST_RATIO * least)
            wrong = np.flatnonzero(~((inertias >= 0.0) & (inertias <= most)))
            if wrong.size:
                inertia, allowed = inertias.flat[wrong[0]], most.flat[wrong[0]]
                raise ValueError(
                    f"{name} is {inertia:g}; give 0 to {allowed:g} {'kg' if slides else 'kg m^2'}, a million "
                    f"times the lightest mass{'' if slides else ' on the shortest link'}: rounding would "
                    "hide the arm behind more"
                )

    @cached_property
    def inertias(self) -> Added:
        """Inertias that effects add to the arm: the joints of each, and the field with its number."""
        return tuple((a.hook.joints, a.parameter(a.hook.inertia)) for a in self.of(hooks.Inertia))

    def loaded(self, arm: Arm, values: Mapping[str, float]) -> Arm:
        """The arm with the masses and inertias that effects add to its own, from all parameters; ValueError
        if a mass is not positive then, or an inertia negative."""
        if self.carried:
            heavier = self.moving_masses(values, self.states.initial)
            masses = tuple(heavier.get(f"m{k + 1}", mass) for k, mass in enumerate(arm.masses))
            checked = positive_numbers("masses with what effects add", masses, arm.num_masses, "kg")
            arm = dataclasses.replace(arm, masses=checked)
        self.check_inertias(arm, values)
        inertias = {name: values[name] for _, name in self.inertias}
        return with_inertias(arm, self.inertias, inertias) if inertias else arm


def _sharing(arm: Arm, effects: Sequence[Effect]) -> tuple[str, tuple[str, ...]]:
    """The key of the effect whose links share commands, and their units; ValueError if there are two such
    effects, or if its links are not one at each joint."""
    effect, units, count = effects[0], tuple(effects[0].shared_commands(arm)), len(arm.joints)
    if len(effects) > 1:
        keys = " and ".join(repr(e.key) for e in effects)
        raise ValueError(f"effects: {keys} both share commands; leave one of them out")
    links = [hook for hook in effect.hooks(arm) if isinstance(hook, Actuation)]
    at = [hook.joint for hook in links]
    if sorted(at) != [*range(count)] or len(units) > count:
        raise ValueError(
            f"effects: {effect.key!r} shares {len(units)} commands and has links at the joints {at}; give it "
            f"one link at each of the {count} joints, and at most {count} commands"
        )
    return effect.key, units


def _without_idle(every: Sequence[Any], key: str, units: Sequence[str]) -> list[Any]:
    """Hooks without the links in front of shared commands that are those of none, as the third and fourth
    delays of an arm with two commands."""
    order = [(hook.link if isinstance(hook, Actuation) else 0, n) for n, (_, hook) in enumerate(every)]
    first = min(o for o, (effect, hook) in zip(order, every, strict=True) if effect.key == key)
    return [
        pair
        for o, pair in zip(order, every, strict=True)
        if not (isinstance(pair[1], Actuation) and o < first and pair[1].joint >= len(units))
    ]


def field_of(fields: Iterable[Attached[Field]], x: Quantities) -> tuple[Any, Any]:
    """The sum (ax, ay) of some fields; absent without any."""
    vectors = [field.functions["function"](x) for field in fields]
    return (total(ax for ax, _ in vectors), total(ay for _, ay in vectors)) if vectors else (ABSENT, ABSENT)


DRAWN = " draws "
"""Between the field of a state and its draw in the name of a quantity, as in no other name."""


def _attached(
    known: Mapping[str, set[str]], switches: Iterator[int], guards: Iterator[int], effect: Effect, hook: Any,
    by_side: bool = False,
) -> Attached[Any]:  # fmt: skip
    """A hook whose functions are bound; its boundaries get the next numbers of switches and guards. With
    ``by_side`` a link has the law for each side of its guard in place of its function, or else no guard."""
    key, law = effect.key, "" if getattr(hook, "switch", None) is None else f"switch{next(switches)}"
    if by_side:
        hook = dataclasses.replace(hook, function=hook.by_side, by_side=None)
    used = hook
    if getattr(hook, "by_side", None) is not None:
        used = dataclasses.replace(hook, guard=None, by_side=None)
    guard = getattr(used, "guard", None)
    names = () if guard is None else tuple(f"guard{next(guards)}" for _ in range(dialect.check(guard)))
    laws = dict(zip(hooks.sides(len(names)), names, strict=True)) if names else {hooks.SIDE: law}

    def quantity(part: Any, field: str, argument: str) -> str:
        """The name of the quantity that a function of a hook or a state takes."""
        source = hooks.source_of(argument, part, hook, known[key])
        if laws.get(source):
            return f"side_{laws[source]}"
        if isinstance(part, State) and DRAW.fullmatch(source):  # every state has its own
            return f"{key}.{part.name}{DRAWN}{source}"
        if source == hooks.ELAPSED and field == "closed":
            return TIME
        if source == hooks.PASSED:
            return f"passed_{key}"
        return f"{key}{source}" if source.startswith(".") else source

    def bound(part: Any) -> Functions:
        at_instant = isinstance(part, State) and part.when == "instant"
        return {
            INSTANT_UPDATE if at_instant and field == "update" else field: Bound(
                f, tuple(quantity(part, field, argument) for argument in arguments_of(f)), key
            )
            for field, f in functions_of(part).items()
        }

    states = {f"{key}.{state.name}": bound(state) for state in states_of(hook)}
    return Attached(effect, hook, bound(used), states, law, names)
