"""Checks that an effect fits an arm: of every hook, when a scene is made, before anything is compiled.

:data:`RULES` says of each function how many values it returns and what it may depend on.
"""

import dataclasses
import enum
import functools
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
    """What a function may depend on, beside parameters."""

    ANYTHING = "motion, commands, field and states"
    MOTION = "the motion"
    POSITION = "the position"
    OWN_JOINT = "parameters and the position and rate of its own joint"
    STATES = "parameters and states of its effect"
    PARAMETERS = "parameters"


class Rule(NamedTuple):
    """The rule of a function of a hook or a state."""

    values: int = 1  # that it returns; at most so many for those of SEVERAL
    may: May = May.ANYTHING
    refused: str = "{field} {name} depends on {more}; it may depend on {may} alone"


IT_MAY = "{field} {name} depends on {more}; it may depend on "
RULES: dict[type, dict[str, Rule]] = {
    hooks.Field: {"function": Rule(2, May.STATES, "{name} depends on {more}; a uniform field may depend on "
        "parameters and states of its effect: give a Force at each point for another")},
    hooks.Force: {
        "function": Rule(),
        "kink": Rule(hooks.MAX_KINKS),
        "guard": Rule(hooks.MAX_GUARDS),
        "potential": Rule(1, May.POSITION),
        "conservative": Rule(1, May.POSITION),
        "stiffness": Rule(1, May.PARAMETERS),
        "damping": Rule(1, May.OWN_JOINT),
    },
    hooks.Impulse: {"function": Rule()},
    hooks.Actuation: {
        "function": Rule(), "kink": Rule(hooks.MAX_KINKS), "guard": Rule(hooks.MAX_GUARDS), "by_side": Rule(),
    },
    hooks.Friction: {"limit": Rule(1, May.PARAMETERS,
        f"{IT_MAY}parameters and on speed, the size of the rate of its joint")},
    hooks.Gap: {"function": Rule(1, May.POSITION,
        "{name} depends on {more}; a gap may depend on the pose and on numbers")},
    hooks.Sensing: {"function": Rule(1, May.MOTION,
        "{name} depends on {more}; a sensor may use the motion and its numbers")},
    hooks.Instant: {"after": Rule(1, May.PARAMETERS, "after {name} depends on {more}; an instant may depend "
        "on parameters and control_dt alone")},
    State: {
        "derivative": Rule(),
        "update": Rule(),
        "initial": Rule(1, May.MOTION, f"{IT_MAY}parameters, on draws and on the motion at the start"),
        "rate": Rule(1, May.PARAMETERS, "rate {name} may depend on parameters alone"),
        "closed": Rule(),
    },
}  # fmt: skip
"""Functions of hooks and of states. At a point those of :data:`AXES` return two values."""
AXES = "function", "conservative"
SEVERAL = "guard", "kink"
"""Functions of hooks that may return several values."""
TAKING_DRAWS = "update", "initial"
"""Functions of states that may take draws."""
OWN_NUMBERS = "mass", "inertia", "lower", "upper", "restitution"
"""Fields of hooks that name numbers of the effect, none of them but a mass a state."""
STATE_NAME = re.compile(r"[^\W\d]\w*(\[\d+\])?")
Own = dict[str, bool]
"""Names of an effect's own numbers, and whether they are states."""
HOOKS = ", ".join(kind.__name__ for kind in get_args(Hook))
KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")
KEPT_CHECKS = 4096
"""Effects on arms that are known to fit, at most."""
_fitting: set[Any] = set()
"""Of this package's effects on arms those that fit, as texts, which tell all their numbers: whoever changes a
number of a scene makes the scene again, and checking nine effects took 8 ms (Zen 5)."""


def check_attached(where: str, effect: Effect, arm: Arm) -> None:
    """Check the hooks of an effect on an arm.

    ValueError if the effect, called ``where``, does not fit the arm, a function is outside the physics
    dialect, a name is unknown, or a potential and a force cannot belong together. One of this package that
    fitted such an arm before is not checked again.
    """
    kind, known = type(effect), None
    if dialect.is_own(kind):
        known = kind, kind.hooks, repr(effect), type(arm), repr(arm)
    if known in _fitting:
        return
    check_declared(where, effect, Effect)
    every = effect.hooks(arm)
    if not isinstance(effect.key, str) or not KEY.fullmatch(effect.key):
        raise ValueError(f"{where} has the key {effect.key!r}; give letters, digits, '_' and '.'")
    if not isinstance(every, tuple | list) or not all(isinstance(h, Hook) for h in every):
        raise ValueError(f"{kind.__name__}.hooks gives {every!r:.80}; give a tuple of {HOOKS}")
    called = f"{where} ({kind.__name__})"
    own = _own_numbers(called, effect, every)
    for n, hook in enumerate(every):
        try:
            _check_hook(hook, own, arm)
        except ValueError as error:
            raise ValueError(f"{called}, hook {n} ({type(hook).__name__}): {error}") from None
    _check_masses(called, every)
    _check_instants(called, every)
    check_numbers(called, effect, arm, every)
    _check_uses(called, effect, arm, every)
    forces = [h for h in every if isinstance(h, hooks.Force)]
    if any(h.conservative is not None for h in forces) and all(h.potential is None for h in forces):
        raise ValueError(
            f"{called} has a conservative force and no potential; give the potential, or leave "
            "'conservative' out: the power of a force without a potential counts as work"
        )
    if known is None:  # tests of the package hold this of its own effects
        check_effect(where, effect, arm)
        return
    if len(_fitting) >= KEPT_CHECKS:
        _fitting.clear()
    _fitting.add(known)


def _parts(every: Iterable[Hook]) -> Iterator[tuple[int, Any]]:
    """Hooks and their states, with the numbers of the hooks."""
    return ((n, part) for n, hook in enumerate(every) for part in (hook, *states_of(hook)))


def _own_numbers(called: str, effect: Effect, every: Iterable[Hook]) -> Own:
    """An effect's numbers and the states of its hooks; refuses what is no number, and names given twice."""
    for f in dataclasses.fields(effect):
        if not f.init and f.name not in effect.static:
            raise ValueError(
                f"{called}.{f.name} is not an argument of its class, so it would not change with the "
                "others; compute it in the effect's functions, or name it in 'static'"
            )
    own: Own = dict.fromkeys(effect.parameters(), False)
    for field, value in effect.parameters().items():
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
            raise ValueError(f"{called}.{field} is {value!r:.80}; give a number or a tuple of them")
    for n, hook in enumerate(every):
        states: Any = states_of(hook)
        if not isinstance(states, tuple | list):
            raise ValueError(
                f"{called}, hook {n}: states is {states!r:.60}; give a tuple, such as (State(...),)"
            )
        for state in states:
            name = getattr(state, "name", None)
            if not isinstance(name, str) or not STATE_NAME.fullmatch(name) or name in own:
                raise ValueError(
                    f"{called} has the state {name!r}; give a State with a name of its own, 'name' "
                    "or 'name[k]', that no other number of the effect has"
                )
            own[name] = True
    return own


def _check_instants(called: str, every: Iterable[Hook]) -> None:
    """Refuse a second instant of an effect, and what only an effect with an instant may have."""
    instants = sum(isinstance(hook, hooks.Instant) for hook in every)
    if instants > 1:
        raise ValueError(f"{called} has {instants} instants; give one, and further ones to other effects")
    for n, part in _parts(every):
        when, is_state = getattr(part, "when", "interval"), isinstance(part, State)
        if when not in hooks.WHEN or (when == "instant" and not instants):
            what = f"the state {part.name!r}" if is_state else f"the {type(part).__name__}"
            raise ValueError(
                f"{called}, hook {n}: {what} has when={when!r:.40}; give "
                f"{' or '.join(map(repr, hooks.WHEN))}, the latter in an effect with an Instant"
            )
        if is_state and when == "instant" and part.update is None:
            raise ValueError(
                f"{called}, hook {n}: the state {part.name!r} has when='instant' and no update; give one"
            )
        takes = {part.bind.get(a, a) for f in functions_of(part).values() for a in arguments_of(f)}
        if hooks.PASSED in takes and not instants:
            raise ValueError(
                f"{called}, hook {n}: a function takes {hooks.PASSED!r}, and the effect has no instant; add "
                "Instant(after=...) to its hooks"
            )


def _check_masses(called: str, every: Iterable[Hook]) -> None:
    """Refuse a mass that changes within an interval."""
    states = {f".{s.name}": s for hook in every for s in states_of(hook)}
    for hook in every:
        if not isinstance(hook, hooks.PointMass) or hook.mass not in states:
            continue
        state = states[hook.mass]
        if state.update is None or state.when == "instant":
            kind = "derivative" if state.update is None else "when='instant'"
            raise ValueError(
                f"{called} has the mass {hook.mass!r}, a state with {kind}; give one with an update that "
                "changes between intervals"
            )


def check_numbers(where: str, effect: Effect, arm: Arm, every: Iterable[Hook]) -> None:
    """ValueError if ends of a travel, or positions at which a force changes its law, are in the wrong order,
    or if an impact would create energy; in a scene, and in each lane."""
    numbers = effect.parameters()

    def check_order(what: str, lower: str, upper: str) -> None:
        low, high = numbers[lower[1:]], numbers[upper[1:]]
        if not low < high:
            raise ValueError(
                f"{where}: {what} is {lower} to {upper}, which are {low} and {high}; the first must be below "
                "the second"
            )

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
                raise ValueError(
                    f"{where}.travel gives {end!r}, which is not a number of this effect; it has "
                    f"{', '.join(numbers) or 'none'}"
                )
        check_order(f"the travel of {arm.joints[int(joint)]!r}", *(f".{end}" for end in ends))


def _check_uses(called: str, effect: Effect, arm: Arm, every: Iterable[Hook]) -> None:
    """Refuse a field with several numbers of which some are used and some are not, and the unit of a number
    that the effect does not have."""
    numbers = effect.parameters()
    used = {*effect.action_units(arm)}.union(*effect.travel(arm).values())
    for _, part in _parts(every):
        named = (getattr(part, field.name) for field in dataclasses.fields(part))
        sources = (*getattr(part, "bind", {}).values(), *named)
        used |= {name[1:] for name in sources if isinstance(name, str) and name[:1] == "."}
    for field in dataclasses.fields(effect):
        entries = [name for name in numbers if name.startswith(f"{field.name}[")]
        unused = [name for name in entries if name not in used]
        if unused and len(unused) < len(entries):
            raise ValueError(
                f"{called}.{field.name} has {len(entries)} entries, of which no hook uses "
                f"{', '.join(unused)}; give {len(entries) - len(unused)}"
            )
    for name in effect.units(arm):
        if name not in {*numbers, *(n.split("[")[0] for n in numbers)}:
            raise ValueError(
                f"{called}.units has {name!r}, which is none of its numbers: "
                f"{', '.join(numbers) or 'it has none'}"
            )


def _check_hook(hook: Hook, own: Own, arm: Arm) -> None:
    _check_place(hook, arm)
    named = [(field, getattr(hook, field)) for field in OWN_NUMBERS if hasattr(hook, field)]
    named += [("switch", name) for name in getattr(hook, "switch", None) or ()]
    for field, name in named:
        _check_own(field, name, [n for n, is_state in own.items() if not is_state or field == "mass"])
    for field, choices in (("link", hooks.Link), ("reading", hooks.Reading)):
        given = getattr(hook, field, None)
        if hasattr(hook, field) and not isinstance(given, choices):
            names = ", ".join(f"{choices.__name__}.{choice.name}" for choice in choices)
            raise ValueError(f"{field} is {given!r}; choose {names}")
    if isinstance(hook, hooks.Actuation):
        _check_link(hook)
    for _, part in _parts([hook]):
        if isinstance(part, State):
            _check_state(part, hook)
        for field, rule in RULES.get(type(part), {}).items():
            given = getattr(part, field)
            if given is not None and (field != "initial" or callable(given)):
                _check_function(field, rule, _Allowed(part, hook, own, arm))


def _check_state(state: State, hook: Hook) -> None:
    """Refuse a state without one way to change, and a closed form that is none."""
    name = f"the state {state.name!r}"
    if (state.derivative is None) == (state.update is None):
        raise ValueError(f"{name} needs either a derivative or an update")
    if state.derivative is not None and isinstance(hook, hooks.Sensing):
        raise ValueError(
            f"{name} of a sensor has a derivative; give an update: a sensor is read once in a control "
            "interval"
        )
    if not callable(state.initial):
        number(f"initial of {name}", state.initial)
    if state.closed is None:
        return
    if state.derivative is None:
        raise ValueError(
            f"{name} has a closed form and no derivative; give the derivative, too: error control "
            "integrates it"
        )
    takes = [state.bind.get(argument, argument) for argument in arguments_of(state.closed)]
    needed = {hooks.ELAPSED: "the time since the step began", f".{state.name}": "the value then"}
    for source, what in needed.items():
        if source not in takes:
            raise ValueError(
                f"closed of {name}, {name_of(state.closed)}, does not take {source!r}, {what}; a closed form "
                "is a function of both"
            )


def _check_link(hook: hooks.Actuation) -> None:
    """Refuse units of a link that are no text, one that it gives without one that it takes, and laws of a
    guard that it does not have."""
    for field in ("takes", "gives"):
        unit = getattr(hook, field)
        if not isinstance(unit, str) or unit != unit.strip():
            raise ValueError(
                f"{field} is {unit!r:.80}; give a unit such as 'V', or '' for that of the command"
            )
    if hook.by_side is not None and hook.guard is None:
        raise ValueError("by_side is given without a guard; give the guard whose sides it takes")
    if hook.gives and not hook.takes:
        raise ValueError(
            f"gives is {hook.gives!r} without takes; name the unit of the command, too, takes='rad/s'"
        )


def _check_place(hook: Any, arm: Arm) -> None:
    """Refuse joints and points that the arm does not have, or where no such hook can be."""
    place = getattr(hook, "joint", getattr(hook, "point", None))
    at_point = isinstance(hook, hooks.PointMass) or _acts_at_point(hook)
    joints: Any = (place,) if hasattr(hook, "joint") and not at_point else ()
    if at_point:
        k = getattr(place, "number", place)
        if not isinstance(place, Point) or not _is_one_of(arm.num_masses, k):
            last = arm.num_masses - 1
            raise ValueError(f"the number of the Point is {k!r}; give Point(0) to Point({last}), the tip")
    if isinstance(hook, hooks.Inertia):
        joints = hook.joints
        if not isinstance(joints, tuple) or not joints or len({*joints}) < len(joints):
            raise ValueError(f"joints is {joints!r}; give a tuple of joints, each once, such as (0,)")
    for joint in joints:
        if not _is_one_of(len(arm.joints), joint):
            last = len(arm.joints) - 1
            raise ValueError(f"joint is {joint!r}; give 0 to {last} ({', '.join(arm.joints)})")
    if len({arm.prismatic[k] for k in joints}) > 1:
        raise ValueError(
            f"joints is {joints!r}, which turn and slide: rad/s and m/s cannot be added; give one kind"
        )
    if getattr(hook, "switch", None) is None:
        return
    if hook.guard is not None:
        raise ValueError("switch and guard are given, and both say which law holds; give the guard alone")
    if not isinstance(hook.switch, tuple) or len(hook.switch) != 2:
        raise ValueError(f"switch is {hook.switch!r}; give the names of two numbers, ('.lower', '.upper')")
    if at_point:
        raise ValueError(
            "switch is given, and the force acts at a Point; a change of law is located along a joint only"
        )


def _is_one_of(count: int, index: Any) -> bool:
    return isinstance(index, int) and not isinstance(index, bool) and 0 <= index < count


def _acts_at_point(part: Any) -> bool:
    return isinstance(part, hooks.Force | hooks.Impulse) and isinstance(part.joint, Point)


class _Allowed(NamedTuple):
    """A hook or one of its states, and what the functions of it may take."""

    part: Any
    hook: Any
    own: Own
    arm: Arm


def _check_function(field: str, rule: Rule, known: _Allowed) -> None:
    """Check a function of a hook or a state: its text, the names that it takes, and its rule."""
    part, arm = known.part, known.arm
    function = getattr(part, field)
    values, name = dialect.check(function), name_of(function)
    if field in SEVERAL and values > rule.values:
        raise ValueError(f"{field} {name} returns {values} values; it may return {rule.values} at most")
    roots = dict(_roots(field, known))
    at_point = _acts_at_point(part)
    wanted = 2 if at_point and field in AXES else rule.values
    if values != wanted and field not in SEVERAL:
        kind = f"{type(part).__name__}{' at a point' if at_point else ''}"
        if field == "function":
            raise ValueError(f"function {name} returns {values} values; a {kind} needs {wanted}")
        raise ValueError(f"{field} {name} must return {'two values' if wanted == 2 else 'one value'}")
    may = May.PARAMETERS if rule.may is May.OWN_JOINT and at_point else rule.may
    allowed, free = {*arm.parameter_values()}, set[str]()
    if may in (May.POSITION, May.MOTION):
        allowed |= {*arm.coordinates}
    if may is May.MOTION:
        allowed |= {*arm.rates}
    if may is May.STATES:
        allowed |= {f".{name}" for name, is_state in known.own.items() if is_state}
    if may is May.OWN_JOINT:
        free |= {*part.motion}
    if isinstance(part, hooks.Sensing):
        free |= {source for source in roots if source.startswith(".")}  # states of its effect
    more = ", ".join(sorted(source for source in roots.keys() - free if roots[source] - allowed))
    if more and may is not May.ANYTHING:
        if field == "conservative" and function is part.function:
            raise ValueError(
                f"{name} has a potential and depends on {more}, so not all of it is the derivative of the "
                "potential; give the part that is as a separate function, conservative="
            )
        raise ValueError(rule.refused.format(field=field, name=name, more=more, may=may.value))
    if isinstance(part, hooks.Gap) and all(behind.isdisjoint(arm.coordinates) for behind in roots.values()):
        raise ValueError(f"{name} depends on no coordinate of the arm; a gap must move")


def _roots(field: str, known: _Allowed) -> Iterator[tuple[str, Set[str]]]:
    """What each quantity that a function takes depends on; refuses names that nothing has."""
    part, _, own, arm = known
    if not isinstance(part.bind, Mapping):
        raise ValueError(f"bind is {part.bind!r:.80}; give a mapping of arguments to names")
    every = [f for _, x in _parts([part]) for f in functions_of(x).values()]
    takes = list(dict.fromkeys(a for f in every for a in arguments_of(f)))
    for name in part.bind:
        if name not in takes:
            raise ValueError(
                f"bind has {name!r}, which no function here takes; they take {', '.join(takes) or 'nothing'}"
            )
    function = getattr(part, field)
    label = f"{field} of the state {part.name!r}," if isinstance(part, State) else field
    for argument in arguments_of(function):
        source = part.bind.get(argument, argument)
        where = f"{label} {name_of(function)}, argument {argument!r}"
        if not isinstance(source, str):
            raise ValueError(f"{where}: bind gives {source!r:.80}; give a name in quotation marks")
        if source.startswith("."):
            _check_own(where, source, own)
            yield source, {source} if own[source[1:]] else set()
        elif DRAW.fullmatch(source):
            if not isinstance(part, State) or field not in TAKING_DRAWS:
                raise ValueError(
                    f"{where}: {source!r} is a draw, which only the functions {' and '.join(TAKING_DRAWS)} "
                    "of a State take; keep it in a state, and bind that"
                )
            yield source, set()
        elif source == hooks.SPEED and isinstance(part, hooks.Friction):
            continue
        elif source == hooks.CONTROL_DT or (source == hooks.ELAPSED and field == "closed"):
            yield source, set()
        elif source == hooks.PASSED:
            yield source, {source}
        else:
            try:
                yield source, _roots_of_side(source, field, known) or roots_of(source, arm)
            except ValueError:
                raise ValueError(
                    f"{where}: no quantity of {arm.kind} is called {source!r}, or it follows from the "
                    "forces; give one such as phi1 (position of joint 1), phid1 (its rate), tip_x, tip_vx, "
                    "s1, c1, m1, l1, or bind a number of the effect by '.name'"
                ) from None


def _roots_of_side(source: str, field: str, known: _Allowed) -> Set[str]:
    """What a side depends on, which says which law of a hook holds; nothing if a quantity is no side."""
    hook, arm = known.hook, known.arm
    if source == hooks.SIDE and getattr(hook, "switch", None) is not None:
        return roots_of(hook.motion[0], arm)
    guard = getattr(hook, "guard", None)
    without_side = field == "guard" or (field == "function" and getattr(hook, "by_side", None) is not None)
    if guard is None or without_side or source not in hooks.sides(dialect.check(guard)):
        return frozenset()
    return frozenset().union(*(behind for _, behind in _roots("guard", known._replace(part=hook))))


def _check_own(where: str, source: Any, own: Collection[str]) -> None:
    """Refuse the name of a number that the effect does not have."""
    if not isinstance(source, str) or source[:1] != "." or source[1:] not in own:
        valid = [f".{name}" for name in own]
        raise ValueError(
            f"{where}: {source!r} is not a number of this effect; it has {', '.join(valid) or 'none'}"
        )


@functools.lru_cache(maxsize=256)
def roots_of(quantity: str, arm: Arm) -> frozenset[str]:
    """States, commands and parameters that a quantity of an arm takes, by running the functions of the arm on
    numbers that are loaded by name; ValueError if it takes any other."""
    commands = numbered("command{}", len(arm.joints))
    loads = Loads((*arm.coordinates, *arm.rates, *arm.parameter_values(), *commands, "ax", "ay"))
    _ = Quantities({}, arm.functions, arm.sincos, loads)[quantity]
    return frozenset(loads)
