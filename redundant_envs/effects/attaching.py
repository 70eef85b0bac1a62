"""Checks that an effect fits an arm: of every hook, when a scene is made, before anything is compiled."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_args

from redundant_envs import dialect
from redundant_envs.algebra import arguments_of, gives_of, name_of, numbered
from redundant_envs.effects.captured import check_effect
from redundant_envs.effects.hook_numbers import check_numbers
from redundant_envs.effects.hooks import (
    SIDE,
    Actuation,
    Effect,
    Field,
    Force,
    Gap,
    Hook,
    Impact,
    Inertia,
    Link,
    Point,
    PointMass,
    Reading,
    Sensing,
    State,
)
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import number
from redundant_envs.values import check_declared

STATE_NAME = re.compile(r"[^\W\d]\w*(\[\d+\])?")
Own = dict[str, bool]
"""Names of an effect's own numbers, and whether they are states."""
HOOKS = ", ".join(kind.__name__ for kind in get_args(Hook))
KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")


def attached(where: str, effect: Effect, arm: Arm) -> tuple[Hook, ...]:
    """The hooks of an effect on an arm, checked.

    Raises
    ------
    ValueError
        If the effect does not fit the arm, a function is outside the physics dialect, a name is unknown,
        or the potential and the force of the effect cannot belong together. ``where`` names the
        effect in the message.
    """
    kind = type(effect).__name__
    check_declared(where, effect, Effect)
    hooks = effect.hooks(arm)
    if not isinstance(effect.key, str) or not KEY.fullmatch(effect.key):
        raise ValueError(f"{where} has the key {effect.key!r}; give letters, digits, '_' and '.'")
    if not isinstance(hooks, tuple | list) or not all(isinstance(h, Hook) for h in hooks):
        raise ValueError(f"{kind}.hooks gives {hooks!r:.80}; give a tuple of {HOOKS}")
    for f in dataclasses.fields(effect):
        if not f.init and f.name not in effect.static:
            raise ValueError(
                f"{where} ({kind}).{f.name} is not an argument of its class, so it would not change with the "
                "others; compute it in the effect's functions, or name it in 'static'"
            )
    own: Own = dict.fromkeys(effect.parameters(), False)
    for field, value in effect.parameters().items():
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
            raise ValueError(f"{where} ({kind}).{field} is {value!r:.80}; give a number or a tuple of them")
    for n, hook in enumerate(hooks):
        states: Any = _states_of(hook)
        if not isinstance(states, tuple | list):
            raise ValueError(
                f"{where} ({kind}), hook {n}: states is {states!r:.60}; give a tuple, such as (State(...),)"
            )
        for state in states:
            name = getattr(state, "name", None)
            if not isinstance(name, str) or not STATE_NAME.fullmatch(name) or name in own:
                raise ValueError(
                    f"{where} ({kind}) has the state {name!r}; give a State with a name of its own, 'name' "
                    "or 'name[k]', that no other number of the effect has"
                )
            own[name] = True
    for n, hook in enumerate(hooks):
        try:
            _check_hook(hook, own, arm)
        except ValueError as error:
            raise ValueError(f"{where} ({kind}), hook {n} ({type(hook).__name__}): {error}") from None
    check_numbers(f"{where} ({kind})", effect, arm, hooks)
    _check_entries(f"{where} ({kind})", effect, arm, hooks)
    _check_units(f"{where} ({kind})", effect, arm)
    forces = [h for h in hooks if isinstance(h, Force)]
    booked = [h for h in forces if h.conservative is not None]
    if booked and all(h.potential is None for h in forces):
        raise ValueError(
            f"{where} ({kind}) has a conservative force and no potential; give the potential, or leave "
            "'conservative' out: the power of a force without a potential counts as work"
        )
    if not dialect.is_own(type(effect)):  # tests of the package hold this of its own effects
        check_effect(where, effect, arm)
    return tuple(hooks)


def _check_entries(where: str, effect: Effect, arm: Arm, hooks: Iterable[Hook]) -> None:
    """Refuse a field with several numbers of which some are used and some are not."""
    used = {name for low_high in effect.travel(arm).values() for name in low_high}
    used |= {*effect.action_units(arm)}
    for hook in hooks:
        for part in (hook, *_states_of(hook)):
            used |= {source[1:] for source in getattr(part, "bind", {}).values()}
            named = (getattr(part, field.name) for field in dataclasses.fields(part))
            used |= {name[1:] for name in named if isinstance(name, str) and name[:1] == "."}
    for field in dataclasses.fields(effect):
        entries = [name for name in effect.parameters() if name.startswith(f"{field.name}[")]
        unused = [name for name in entries if name not in used]
        if unused and len(unused) < len(entries):
            raise ValueError(
                f"{where}.{field.name} has {len(entries)} entries, of which no hook uses "
                f"{', '.join(unused)}; give {len(entries) - len(unused)}"
            )


def _check_units(where: str, effect: Effect, arm: Arm) -> None:
    """Refuse the unit of a number that an effect does not have."""
    numbers = effect.parameters()
    for name in effect.units(arm):
        if name not in {*numbers, *(n.split("[")[0] for n in numbers)}:
            raise ValueError(
                f"{where}.units has {name!r}, which is none of its numbers: "
                f"{', '.join(numbers) or 'it has none'}"
            )


def _states_of(hook: Any) -> tuple[State, ...]:
    return hook.states if isinstance(hook, Force | Actuation) else ()


def _check_hook(hook: Hook, own: Own, arm: Arm) -> None:
    at_point = isinstance(hook, Force) and isinstance(hook.joint, Point)
    if isinstance(hook, PointMass):
        _check_point(hook.point, arm)
        _own("mass", hook.mass, {n: False for n, moves in own.items() if not moves})
        return
    if isinstance(hook, Inertia):
        _check_inertia(hook, arm)
        _own("inertia", hook.inertia, {n: False for n, moves in own.items() if not moves})
        return
    if isinstance(hook, Force):
        _check_switch(hook, own)
    if isinstance(hook, Force) and isinstance(hook.joint, Point):
        _check_point(hook.joint, arm)
    elif not isinstance(hook, Field | Gap):
        _check_joint(hook.joint, arm)
    if isinstance(hook, Impact):
        for name in ("lower", "upper", "restitution"):
            _own(name, getattr(hook, name), {n: False for n, moves in own.items() if not moves})
        if not arm.prismatic[hook.joint]:
            raise ValueError(
                f"{arm.joints[hook.joint]!r} is not a slider; hard ends of travel are those of sliders"
            )
        return
    roots = _check_function("function", hook.function, hook, own, arm)
    wanted = 2 if at_point or isinstance(hook, Field) else 1
    if dialect.results_of(hook.function) != wanted:
        raise ValueError(
            f"function {name_of(hook.function)} returns {dialect.results_of(hook.function)} values; "
            f"a {type(hook).__name__}{' at a point' if at_point else ''} needs {wanted}"
        )
    if isinstance(hook, Field):
        moving = _beyond(roots, set(arm.parameter_values()))
        if moving:
            raise ValueError(
                f"{name_of(hook.function)} depends on {moving}; a uniform field may depend on "
                "parameters alone: give a Force at each point for another"
            )
    if isinstance(hook, Gap):
        _own("restitution", hook.restitution, {n: False for n, moves in own.items() if not moves})
        moving = _beyond(roots, {*arm.parameter_values(), *arm.coordinates})
        if moving:
            raise ValueError(
                f"{name_of(hook.function)} depends on {moving}; a gap may depend on the pose and on numbers"
            )
        if all(behind.isdisjoint(arm.coordinates) for behind in roots.values()):
            raise ValueError(f"{name_of(hook.function)} depends on no coordinate of the arm; a gap must move")
    if isinstance(hook, Sensing):
        if not isinstance(hook.reading, Reading):
            raise ValueError(
                f"reading is {hook.reading!r}; choose {', '.join(f'Reading.{r.name}' for r in Reading)}"
            )
        unknown = _beyond(roots, {*arm.parameter_values(), *arm.coordinates, *arm.rates})
        if unknown:
            raise ValueError(
                f"{name_of(hook.function)} depends on {unknown}; a sensor may use the motion and its numbers"
            )
    if isinstance(hook, Actuation) and not isinstance(hook.link, Link):
        raise ValueError(f"link is {hook.link!r}; choose {', '.join(f'Link.{link.name}' for link in Link)}")
    for state in _states_of(hook):
        _check_state(state, own, arm)
    if isinstance(hook, Force | Actuation) and hook.kink is not None:
        _check_function("kink", hook.kink, hook, own, arm)
        if dialect.results_of(hook.kink) != 1:
            raise ValueError(f"kink {name_of(hook.kink)} must return one value")
    if not isinstance(hook, Force):
        return
    numbers = set(arm.parameter_values())
    for name in ("potential", "conservative", "stiffness", "damping"):
        function = getattr(hook, name)
        if function is None:
            continue
        roots = _check_function(name, function, hook, own, arm)
        if dialect.results_of(function) != (wanted if name == "conservative" else 1):
            values = "two values" if at_point and name == "conservative" else "one value"
            raise ValueError(f"{name} {name_of(function)} must return {values}")
        fixed = name in ("stiffness", "damping")
        allowed = numbers if fixed else {*numbers, *arm.coordinates}
        if name == "damping" and not at_point:
            own_motion = {f"phi{_joint_of(hook) + 1}", f"phid{_joint_of(hook) + 1}"}
            roots = {source: behind for source, behind in roots.items() if source not in own_motion}
        moving = _beyond(roots, allowed)
        if not moving:
            continue
        if function is hook.function and name == "conservative":
            raise ValueError(
                f"{name_of(function)} has a potential and depends on {moving}, so not all of it is the "
                "derivative of the potential; give the part that is as a separate function, conservative="
            )
        what = "parameters" if fixed else "the position"
        if name == "damping" and not at_point:
            what = "parameters and the position and rate of its own joint"
        raise ValueError(f"{name} {name_of(function)} depends on {moving}; it may depend on {what} alone")


def _check_joint(joint: Any, arm: Arm) -> None:
    count = len(arm.coordinates)
    if isinstance(joint, bool) or not isinstance(joint, int) or not 0 <= joint < count:
        raise ValueError(f"joint is {joint!r}; give 0 to {count - 1} ({', '.join(arm.joints)})")


def _check_inertia(hook: Inertia, arm: Arm) -> None:
    """Refuse joints whose rates cannot be added."""
    if not isinstance(hook.joints, tuple) or not hook.joints or len({*hook.joints}) < len(hook.joints):
        raise ValueError(f"joints is {hook.joints!r}; give a tuple of joints, each once, such as (0,)")
    for joint in hook.joints:
        _check_joint(joint, arm)
    if len({arm.prismatic[k] for k in hook.joints}) > 1:
        raise ValueError(
            f"joints is {hook.joints!r}, which turn and slide: rad/s and m/s cannot be added; give one kind"
        )


def _check_switch(hook: Force, own: Own) -> None:
    """Refuse positions at which a force changes its law that are no two numbers of the effect."""
    if hook.switch is None:
        return
    if not isinstance(hook.switch, tuple) or len(hook.switch) != 2:
        raise ValueError(f"switch is {hook.switch!r}; give the names of two numbers, ('.lower', '.upper')")
    if isinstance(hook.joint, Point):
        raise ValueError(
            "switch is given, and the force acts at a Point; a change of law is located along a joint only"
        )
    for name in hook.switch:
        _own("switch", name, {n: False for n, moves in own.items() if not moves})


def _joint_of(hook: Force) -> int:
    assert isinstance(hook.joint, int)
    return hook.joint


def _check_point(point: Any, arm: Arm) -> None:
    place, count = getattr(point, "number", point), arm.num_masses
    whole = isinstance(point, Point) and isinstance(place, int) and not isinstance(place, bool)
    if not whole or not 0 <= place < count:
        raise ValueError(
            f"the number of the Point is {place!r}; give Point(0) to Point({count - 1}), the tip"
        )


def _beyond(roots: Mapping[str, set[str]], allowed: set[str]) -> str:
    """Names of the quantities that depend on more than is allowed."""
    return ", ".join(sorted(source for source, behind in roots.items() if behind - allowed))


def _check_state(state: State, own: Own, arm: Arm) -> None:
    """Refuse a state with neither a derivative nor an update, or with both."""
    if (state.derivative is None) == (state.update is None):
        raise ValueError(f"the state {state.name!r} needs either a derivative or an update")
    number(f"initial of the state {state.name!r}", state.initial)
    for name in ("derivative", "update", "rate"):
        function = getattr(state, name)
        if function is None:
            continue
        roots = _check_function(f"{name} of the state {state.name!r},", function, state, own, arm)
        if dialect.results_of(function) != 1:
            raise ValueError(f"{name} {name_of(function)} must return one value")
        if name == "rate" and any(behind - set(arm.parameter_values()) for behind in roots.values()):
            raise ValueError(f"rate {name_of(function)} may depend on parameters alone")


def _check_function(
    field: str,
    function: Callable[..., Any],
    hook: Field | Force | Actuation | Gap | Sensing | State,
    own: Own,
    arm: Arm,
) -> dict[str, set[str]]:
    """Check a hook's function and its names; returns the inputs of each quantity of the arm in it."""
    dialect.check(function)
    if not isinstance(hook.bind, Mapping):
        raise ValueError(f"bind is {hook.bind!r:.80}; give a mapping of arguments to names")
    found: dict[str, set[str]] = {}
    takes = (*hook_arguments(hook),)
    for name in hook.bind:
        if name not in takes:
            raise ValueError(
                f"bind has {name!r}, which no function here takes; they take {', '.join(takes) or 'nothing'}"
            )
    for argument in arguments_of(function):
        source = hook.bind.get(argument, argument)
        where = f"{field} {name_of(function)}, argument {argument!r}"
        if not isinstance(source, str):
            raise ValueError(f"{where}: bind gives {source!r:.80}; give a name in quotation marks")
        if source.startswith("."):
            _own(where, source, own)
            if own[source[1:]]:
                found[source] = {source}
        elif source == SIDE and isinstance(hook, Force) and hook.switch is not None:
            found[source] = roots_of(where, f"phi{_joint_of(hook) + 1}", arm)
        else:
            found[source] = roots_of(where, source, arm)
    return found


def hook_arguments(hook: Any) -> list[str]:
    """Arguments of all functions of a hook or a state, those of a hook's states included."""
    values = [getattr(x, field.name) for x in (hook, *_states_of(hook)) for field in dataclasses.fields(x)]
    return list(dict.fromkeys(a for f in values if callable(f) for a in arguments_of(f)))


def _own(where: str, source: str, own: Own) -> None:
    """Refuse the name of a number that the effect does not have."""
    if not isinstance(source, str) or source[:1] != "." or source[1:] not in own:
        valid = ", ".join(f".{name}" for name in own) or "none"
        raise ValueError(f"{where}: {source!r} is not a number of this effect; it has {valid}")


def roots_of(where: str, quantity: str, arm: Arm) -> set[str]:
    """States, commands and parameters on which a quantity of an arm depends."""
    givers = {name: f for f in arm.functions for name in gives_of(f)}
    angles = {name: angle for angle, pair in arm.sincos.items() for name in pair}
    commands = numbered("command{}", len(arm.joints))
    base = {*arm.coordinates, *arm.rates, *arm.parameter_values(), *commands, "ax", "ay"}
    roots: set[str] = set()
    waiting, seen = [quantity], {quantity}
    while waiting:
        name = waiting.pop()
        needed: Iterable[str] = ()
        if name in base:
            roots.add(name)
        elif name in angles:
            needed = (angles[name],)
        elif name in givers:
            needed = arguments_of(givers[name])
        else:
            raise ValueError(
                f"{where}: no quantity of {arm.kind} is called {quantity!r}, or it follows from the forces; "
                "give one such as phi1 (position of joint 1), phid1 (its rate), tip_x, tip_vx, s1, c1, m1, "
                "l1, or bind a number of the effect by '.name'"
            )
        waiting += [n for n in needed if n not in seen]
        seen.update(needed)
    return roots
