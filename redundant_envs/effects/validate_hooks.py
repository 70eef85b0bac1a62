"""Checks that an effect fits an arm: of every hook, when a scene is made, before anything is compiled.

:data:`RULES` says of functions how many values they return and what they may depend on, :data:`FIELDS` what
other fields may be, and :data:`NEEDS` which go with others.
"""

import dataclasses
import enum
import functools
import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Set
from typing import Any, NamedTuple, get_args

from redundant_envs.compiler import dialect
from redundant_envs.compiler.tracing.number import Loads
from redundant_envs.effects import hooks
from redundant_envs.effects.baked_numbers import check_effect
from redundant_envs.effects.hooks import Effect, Hook, Point, State, functions_of, states_of
from redundant_envs.language.algebra import arguments_of, name_of, numbered
from redundant_envs.language.draws import DRAW
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import number
from redundant_envs.support.values import check_declared


class May(enum.Enum):
    """What a function may depend on, beside numbers of the scene."""

    ANYTHING = "motion, commands, field and states"
    READINGS = "parameters, the motion and states of its effect"
    START = "parameters, on draws and on the motion at the start"
    POSE = "parameters and the pose"
    OWN_JOINT = "parameters and the position and rate of its own joint"
    STATES = "parameters and states of its effect"
    LINK = "numbers of its effect and the ends of a link, xa, ya, xb, yb,"
    SPEED = "parameters, states of its effect and speed, the size of the rate of its joint,"
    PARAMETERS = "parameters"


class Rule(NamedTuple):
    """The rule of a function of a hook or a state."""

    values: int = 1  # that it returns; at most so many for those of SEVERAL
    may: May = May.ANYTHING


RULES = {
    "kink": Rule(hooks.MAX_KINKS),
    "guard": Rule(hooks.MAX_GUARDS),
    "potential": Rule(1, May.POSE),
    "conservative": Rule(1, May.POSE),
    "stiffness": Rule(1, May.PARAMETERS),
    "damping": Rule(1, May.OWN_JOINT),
    "limit": Rule(1, May.SPEED),
    "lock": Rule(1, May.STATES),
    "after": Rule(1, May.PARAMETERS),
    "gap": Rule(1, May.LINK),
    "initial": Rule(1, May.START),
    "rate": Rule(1, May.PARAMETERS),
}
"""Functions of hooks and states by their fields; all others return one value and may depend on anything, but
for those of :data:`FUNCTIONS`. At a point those of :data:`AXES` return two values."""
FUNCTIONS: Mapping[Any, Rule] = {
    hooks.Field: Rule(2, May.STATES),
    hooks.Gap: Rule(1, May.POSE),
    hooks.Sensing: Rule(1, May.READINGS),
}
"""``function`` of hooks."""
AXES = "function", "conservative"
SEVERAL = "guard", "kink"  # functions of hooks that may return several values
STEADY = "limit", "lock"  # functions that must be constant within an interval
TAKING_DRAWS = "update", "initial"  # functions of states that may take draws
UNIT = "a unit such as 'V', or '' for that of the command"
FIELDS: Mapping[str, tuple[Any, str]] = {
    "bind": (Mapping, "a mapping of arguments to names"),
    "states": (tuple | list, "a tuple, such as (State(...),)"),
    "takes": (str, UNIT),
    "gives": (str, UNIT),
    "joints": (tuple, "a tuple of joints"),
    "link": (hooks.Link, ", ".join(f"Link.{link.name}" for link in hooks.Link)),
    "reading": (hooks.Reading, "Reading.POSITION or Reading.RATE"),
}
"""Fields of hooks and states that are no functions: their types, and what to give."""
NEEDS = (
    ("by_side", "guard", "give the guard whose sides it takes"),
    ("gives", "takes", "name the unit of the command, too, takes='rad/s'"),
    ("closed", "derivative", "give it, too: error control integrates it"),
)
"""Fields that need another one, and why."""
OWN_NUMBERS = "mass", "inertia", "lower", "upper", "restitution"
"""Fields of hooks that name numbers of the effect, none of them but a mass a state."""
STATE_NAME = re.compile(r"[^\W\d]\w*(\[\d+\])?")
HOOKS = ", ".join(kind.__name__ for kind in get_args(Hook))
KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")


def function_fields(kind: Any) -> list[str]:
    """Fields of a hook or a state that are functions."""
    return [field.name for field in dataclasses.fields(kind) if "Callable" in str(field.type)]


def rule_of(kind: type, field: str) -> Rule:
    return FUNCTIONS.get(kind, Rule()) if field == "function" else RULES.get(field, Rule())


def check_attached(where: str, effect: Effect, arm: Arm) -> None:
    """Check the hooks of an effect on an arm.

    ValueError if the effect, called ``where``, does not fit the arm, a function is outside the physics
    dialect, a name is unknown, or a potential and a force cannot belong together.
    """
    if dialect.is_own(type(effect)):
        _check_own_effect(where, effect, arm, type(effect).hooks)
    else:
        _check_hooks(where, effect, arm)
        check_effect(where, effect, arm)  # tests of the package hold this of its own effects


@functools.lru_cache(maxsize=4096)
def _check_own_effect(where: str, effect: Effect, arm: Arm, _: Any) -> None:
    """The same, once: whoever changes a number of a scene makes the scene again, and checking nine effects
    took 8 ms (Zen 5). The last argument is their method ``hooks``, which may be replaced."""
    _check_hooks(where, effect, arm)


def _check_hooks(where: str, effect: Effect, arm: Arm) -> None:
    check_declared(where, effect, Effect)
    called, every = f"{where} ({type(effect).__name__})", effect.hooks(arm)
    if not isinstance(effect.key, str) or not KEY.fullmatch(effect.key):
        raise ValueError(f"{where} has the key {effect.key!r}; give letters, digits, '_' and '.'")
    if not isinstance(every, tuple | list) or not all(isinstance(h, Hook) for h in every):
        raise ValueError(f"{type(effect).__name__}.hooks gives {every!r:.80}; give a tuple of {HOOKS}")
    if sum(isinstance(hook, hooks.Instant) for hook in every) > 1:
        raise ValueError(f"{called} has 2 instants; give one, and further ones to other effects")
    _check_fields_of_effect(called, effect)
    known = _Known(effect, arm, every)
    for check, (n, hook) in itertools.product((known.add_states, known.check), enumerate(every)):
        try:
            check(hook)
        except ValueError as error:
            raise ValueError(f"{called}, hook {n} ({type(hook).__name__}): {error}") from None
    check_numbers(called, effect, arm, every)
    _check_uses(called, effect, arm, known.named)
    forces = [h for h in every if isinstance(h, hooks.Force)]
    if any(h.conservative is not None for h in forces) and all(h.potential is None for h in forces):
        raise ValueError(f"{called} has a conservative force and no potential; give the potential, too")


def _check_fields_of_effect(called: str, effect: Effect) -> None:
    for f in dataclasses.fields(effect):
        if not f.init and f.name not in effect.static:
            raise ValueError(f"{called}.{f.name} is not an argument of its class; name it in 'static'")
    for field, value in effect.parameters().items():
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
            raise ValueError(f"{called}.{field} is {value!r:.80}; give a number or a tuple of them")


def check_numbers(where: str, effect: Effect, arm: Arm, every: Iterable[Hook]) -> None:
    """ValueError if ends of a travel, or positions at which a force changes its law, are in the wrong order,
    or if an impact would create energy; in a scene, and in each lane."""
    numbers = effect.parameters()

    def check_order(what: str, lower: str, upper: str) -> None:
        low, high = numbers[lower[1:]], numbers[upper[1:]]
        if not low < high:
            raise ValueError(f"{where}: {what} is {lower} to {upper}, {low} to {high}; give the lower first")

    for hook in every:
        if isinstance(hook, hooks.Force) and hook.switch is not None:
            check_order("switch", *hook.switch)
        elif isinstance(hook, hooks.Impact):
            check_order("an impact's travel", hook.lower, hook.upper)
            restitution = numbers[hook.restitution[1:]]
            if not 0.0 <= restitution <= 1.0:
                raise ValueError(f"{where}{hook.restitution} is {restitution}; it must lie in 0 to 1")
    for joint, ends in effect.travel(arm).items():
        for end in ends:
            if end not in numbers:
                raise ValueError(f"{where}.travel gives {end!r}; it has {', '.join(numbers) or 'none'}")
        check_order(f"the travel of {arm.joints[int(joint)]!r}", *(f".{end}" for end in ends))


def _check_uses(called: str, effect: Effect, arm: Arm, named: set[str]) -> None:
    """Refuse a field with several numbers of which some are used and some are not, and the unit of a number
    that the effect does not have."""
    numbers = effect.parameters()
    used = named.union(effect.action_units(arm), *effect.travel(arm).values())
    for field in dataclasses.fields(effect):
        entries = [name for name in numbers if name.startswith(f"{field.name}[")]
        unused = [name for name in entries if name not in used]
        if unused and len(unused) < len(entries):
            raise ValueError(f"{called}.{field.name} has {len(entries)} entries; unused: {', '.join(unused)}")
    for name in effect.units(arm):
        if name not in {*numbers, *(n.split("[")[0] for n in numbers)}:
            raise ValueError(f"{called}.units has {name!r}; its numbers are {', '.join(numbers) or 'none'}")


class _Known:
    """What the hooks of an effect on an arm may name."""

    def __init__(self, effect: Effect, arm: Arm, every: Iterable[Hook]) -> None:
        self.arm, self.is_shipped = arm, dialect.is_own(type(effect))
        self.has_instant = any(isinstance(hook, hooks.Instant) for hook in every)
        self.quantities: dict[str, State | None] = dict.fromkeys(effect.parameters())
        """Own numbers of the effect, and its states."""
        self.named = set[str]()
        """Those of them that hooks take."""

    def add_states(self, hook: Hook) -> None:
        _check_types(hook)
        for state in states_of(hook):
            name = getattr(state, "name", None)
            if not isinstance(name, str) or not STATE_NAME.fullmatch(name) or name in self.quantities:
                raise ValueError(f"it has the state {name!r}; give a name of its own, 'name' or 'name[k]'")
            self.quantities[name] = state

    def check(self, hook: Hook) -> None:
        """ValueError about a hook, or one of its states."""
        _check_place(hook, self.arm)
        numbers = [name for name, state in self.quantities.items() if state is None]
        for field in OWN_NUMBERS:
            if hasattr(hook, field):
                self._check_name(field, getattr(hook, field), self.quantities if field == "mass" else numbers)
        for name in getattr(hook, "switch", None) or ():
            self._check_name("switch", name, numbers)
        mass = self.quantities[hook.mass[1:]] if isinstance(hook, hooks.PointMass) else None
        if mass is not None and (mass.update is None or mass.when == "instant"):
            raise ValueError(f"the mass {mass.name!r} changes within intervals; give it an update")
        for part in (hook, *states_of(hook)):
            self._check_part(part, hook)

    def _check_name(self, where: str, source: Any, names: Collection[str]) -> None:
        """ValueError about the name of a number that the effect does not have."""
        if not isinstance(source, str) or source[:1] != "." or source[1:] not in names:
            valid = ", ".join(f".{name}" for name in names)
            raise ValueError(f"{where}: {source!r} is not a number of this effect; it has {valid or 'none'}")
        self.named.add(source[1:])

    def _check_part(self, part: Any, hook: Hook) -> None:
        _check_types(part)
        what = f"the state {part.name!r}" if isinstance(part, State) else "it"
        when = getattr(part, "when", "interval")
        if when not in hooks.WHEN or (when == "instant" and not self.has_instant):
            raise ValueError(f"{what} has when={when!r:.40}; give 'interval', or 'instant' beside an Instant")
        for field, other, fix in NEEDS:
            if getattr(part, field, None) and not getattr(part, other):
                raise ValueError(f"{what} has {field} without {other}; {fix}")
        if isinstance(part, State):
            _check_state(part, hook)
        functions = (f for x in (part, *states_of(part)) for f in functions_of(x).values())
        takes = dict.fromkeys(argument for f in functions for argument in arguments_of(f))
        for name in getattr(part, "bind", ()):
            if name not in takes:
                raise ValueError(f"bind has {name!r}; its functions take {', '.join(takes) or 'nothing'}")
        for field in function_fields(type(part)):
            value = getattr(part, field)
            if value is not None and (field != "initial" or callable(value)):
                self._check_function(field, rule_of(type(part), field), part, hook)

    def _check_function(self, field: str, rule: Rule, part: Any, hook: Hook) -> None:
        """ValueError about the text of a function, the names that it takes, or its rule."""
        function, at_point, several = getattr(part, field), _acts_at_point(part), field in SEVERAL
        values, name = dialect.check(function), name_of(function)
        roots = dict(self._roots(field, part, hook))
        for source in (hooks.ELAPSED, f".{part.name}") if field == "closed" else ():
            if source not in roots:
                raise ValueError(f"closed {name} does not take {source!r}, as a closed form must")
        wanted = 2 if at_point and field in AXES else rule.values
        if values > wanted or (values < wanted and not several):
            raise ValueError(
                f"{field} {name} returns {values} values; it must return {'at most ' * several}{wanted}"
                f"{' at a point' * at_point}"
            )
        may = May.PARAMETERS if rule.may is May.OWN_JOINT and at_point else rule.may
        allowed, free = {*self.arm.parameter_values()}, set[str]()
        if may in (May.POSE, May.START, May.READINGS):
            allowed |= {*self.arm.coordinates}
        if may in (May.START, May.READINGS):
            allowed |= {*self.arm.rates}
        if may in (May.STATES, May.READINGS, May.SPEED):
            free |= {source for source in roots if source.startswith(".")}
        for state in (self.quantities[source[1:]] for source in free) if field in STEADY else ():
            if state is not None and state.derivative is not None:
                raise ValueError(
                    f"{field} {name} depends on the state {state.name!r}, which changes within an interval, "
                    f"while a {field} must be constant at each speed; give the state an update"
                )
        if may is May.OWN_JOINT:
            free |= {*part.motion}
        more = ", ".join(sorted(source for source in roots.keys() - free if roots[source] - allowed))
        if more and field == "conservative" and function is part.function:
            raise ValueError(
                f"{name} has a potential and depends on {more}; give its part without them as conservative="
            )
        if more and may is not May.ANYTHING:
            raise ValueError(f"{field} {name} depends on {more}; it may depend on {may.value} alone")
        if isinstance(part, hooks.Gap) and all(roots[x].isdisjoint(self.arm.coordinates) for x in roots):
            raise ValueError(f"{name} depends on no coordinate of the arm; a gap must move")

    def _roots(self, field: str, part: Any, hook: Hook) -> Iterator[tuple[str, Set[str]]]:
        """What each quantity that a function takes depends on; refuses names that nothing has."""
        function, arm = getattr(part, field), self.arm
        label = f"{field} of the state {part.name!r}," if isinstance(part, State) else field
        for argument in arguments_of(function):
            source = hooks.source_of(argument, part, hook, self.quantities)
            where = f"{label} {name_of(function)}, argument {argument!r}"
            if not isinstance(source, str):
                raise ValueError(f"{where}: bind gives {source!r:.80}; give a name in quotation marks")
            if source.startswith("."):
                self._check_name(where, source, self.quantities)
                # Effects of the package mean their own numbers, whatever the equations of a user's arm give.
                is_own = argument in part.bind or self.is_shipped
                if not is_own and self._roots_of_quantity(argument, field, part, hook) is not None:
                    raise ValueError(
                        f"{where}: the effect has a number of this name, and there is a quantity of the same "
                        f"name; bind it to {source!r} or {argument!r}"
                    )
                yield source, {source} if self.quantities[source[1:]] else set()
            elif (behind := self._roots_of_quantity(source, field, part, hook)) is not None:
                yield source, behind
            elif DRAW.fullmatch(source):
                raise ValueError(f"{where}: {source!r} is a draw; take it in update, initial of a State")
            elif source == hooks.PASSED:
                raise ValueError(f"{label} takes {source!r}; add Instant(after=...) to the hooks")
            else:
                raise ValueError(
                    f"{where}: no quantity of {arm.kind} is called {source!r}, or it follows from the "
                    "forces; give one such as phi1 (position of joint 1), phid1 (its rate), tip_x, "
                    "tip_vx, s1, c1, m1, l1, or bind a number of the effect by '.name'"
                )

    def _roots_of_quantity(self, name: str, field: str, part: Any, hook: Hook) -> Set[str] | None:
        """What a quantity that the effect does not have depends on; None if a function cannot take it."""
        if name == hooks.PASSED:
            return {name} if self.has_instant else None
        if DRAW.fullmatch(name):
            return set() if isinstance(part, State) and field in TAKING_DRAWS else None
        if isinstance(part, hooks.Obstacle):
            of_measure = field == "gap" and part.measure is not None
            return set() if name in ((hooks.MEASURE,) if of_measure else hooks.ENDS_OF_LINK) else None
        is_time = name == hooks.CONTROL_DT or (name == hooks.ELAPSED and field == "closed")
        if is_time or (name == hooks.SPEED and field == "limit"):
            return set()
        try:
            return self._roots_of_side(name, field, hook) or roots_of(name, self.arm)
        except ValueError:
            return None

    def _roots_of_side(self, source: str, field: str, hook: Any) -> Set[str]:
        """What a side depends on, which says which law of a hook holds; nothing if a quantity is no side."""
        if source == hooks.SIDE and getattr(hook, "switch", None) is not None:
            return roots_of(hook.motion[0], self.arm)
        guard = getattr(hook, "guard", None)
        without_side = field == "guard" or (field == "function" and getattr(hook, "by_side", None))
        if guard is None or without_side or source not in hooks.sides(dialect.check(guard)):
            return frozenset()
        return frozenset().union(*(behind for _, behind in self._roots("guard", hook, hook)))


def _check_types(part: Any) -> None:
    for field, (kind, what) in FIELDS.items():
        if hasattr(part, field) and not isinstance(getattr(part, field), kind):
            raise ValueError(f"{field} is {getattr(part, field)!r:.80}; give {what}")


def _check_state(state: State, hook: Hook) -> None:
    """ValueError about a state without one way to change, or whose closed form is none."""
    name = f"the state {state.name!r}"
    if (state.derivative is None) == (state.update is None):
        raise ValueError(f"{name} needs either a derivative or an update")
    if state.derivative is not None and isinstance(hook, hooks.Sensing):
        raise ValueError(f"{name} of a sensor has a derivative; give an update")
    if state.when == "instant" and state.update is None:
        raise ValueError(f"{name} has when='instant' and no update; give one")
    if not callable(state.initial):
        number(f"initial of {name}", state.initial)


def _check_place(hook: Any, arm: Arm) -> None:
    """ValueError about joints and points that the arm does not have, or where no such hook can be."""
    at_point = isinstance(hook, hooks.PointMass) or _acts_at_point(hook)
    place = getattr(hook, "joint", getattr(hook, "point", None))
    joints: Any = getattr(hook, "joints", () if at_point or place is None else (place,))
    if at_point:
        k = getattr(place, "number", place)
        if not isinstance(place, Point) or not _is_one_of(arm.num_masses, k):
            last = arm.num_masses - 1
            raise ValueError(f"the number of the Point is {k!r}; give Point(0) to Point({last}), the tip")
    if isinstance(hook, hooks.Inertia) and (not joints or len({*joints}) < len(joints)):
        raise ValueError(f"joints is {joints!r}; give a tuple of joints, each once, such as (0,)")
    for joint in joints:
        if not _is_one_of(len(arm.joints), joint):
            last = len(arm.joints) - 1
            raise ValueError(f"joint is {joint!r}; give 0 to {last} ({', '.join(arm.joints)})")
    if len({arm.prismatic[k] for k in joints}) > 1:
        raise ValueError(f"joints is {joints!r}, which turn and slide; give one kind")
    switch = getattr(hook, "switch", None)
    if switch is not None and (at_point or hook.guard or not isinstance(switch, tuple) or len(switch) != 2):
        raise ValueError(f"switch is {switch!r}; give ('.lower', '.upper') to a force on a joint, no guard")


def _is_one_of(count: int, index: Any) -> bool:
    return type(index) is int and 0 <= index < count


def _acts_at_point(part: Any) -> bool:
    return isinstance(part, hooks.Force | hooks.Impulse) and isinstance(part.joint, Point)


@functools.lru_cache(maxsize=256)
def roots_of(quantity: str, arm: Arm) -> frozenset[str]:
    """States, commands and parameters that a quantity of an arm takes, by running the functions of the arm on
    numbers that are loaded by name; ValueError if it takes any other."""
    commands = numbered("command{}", len(arm.joints))
    loads = Loads((*arm.coordinates, *arm.rates, *arm.parameter_values(), *commands, "ax", "ay"))
    _ = Quantities({}, arm.functions, arm.sincos, loads)[quantity]
    return frozenset(loads)
