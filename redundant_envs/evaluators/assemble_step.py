"""The right-hand side of a scene and a step with it, as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from redundant_envs.effects.hooks import Actuation, Field, Force, Impact
from redundant_envs.evaluators.quantities import calls
from redundant_envs.evaluators.text import words
from redundant_envs.integrators.error_control import (
    blended_error,
    scale,
    tip_error,
    tip_weight,
)
from redundant_envs.integrators.fixed_step import step_lines
from redundant_envs.integrators.tableaus import METHODS

if TYPE_CHECKING:
    from redundant_envs.evaluators.assemble import Assembly

RightHandSide = tuple[list[str], list[str], list[Callable[..., Any]]]
"""Arguments beside the states, lines of the body, dialect functions that it calls."""
NO_FIELD = "-0.0"
"""The additive identity: x + (-0.0) is x for every x, so the compiler drops an absent field."""


def right_hand_side(
    a: Assembly, functions: Sequence[Callable[..., Any]], more: Iterable[str] = ()
) -> RightHandSide:
    """Arguments beside the states, body lines, and dialect functions of the right-hand side.

    ``functions`` give the quantities, ``qdd1`` to ``qdd4`` among them; ``more`` are names that
    are known beside the states and numbers.
    """
    arm, scene = a.scene.robot, a.scene
    lines: list[str] = []
    used: list[Callable[..., Any]] = []
    known = {*a.states, *a.numbers, *more, *(f"command{k}" for k in range(1, 5))}

    def statement(names: Iterable[str], function: Callable[..., Any], arguments: Sequence[str]) -> None:
        used.append(function)
        lines.append(f"{', '.join(names)} = {a.names.of(function)}({', '.join(arguments)})")

    def require(names: Iterable[str]) -> None:
        for call in calls(names, known, functions, arm.sincos):
            a.names.emit(call, lines, used)
            known.update(call.names)

    effort = {k: f"command{k + 1}" for k in range(4)}
    field = {name: NO_FIELD for name in ("ax", "ay") if name not in known}
    for effect, hook in a.hooks:
        if isinstance(hook, Impact) or (isinstance(hook, Field) and not field):
            continue  # it acts between steps, or is known before
        arguments = a.bound(effect, hook, hook.function)
        require(n for n in arguments if n not in known)
        if isinstance(hook, Field):
            statement(("ax", "ay"), hook.function, arguments)
            known.update(("ax", "ay"))
            field = {}
        elif isinstance(hook, Actuation):
            statement((f"motor{hook.joint + 1}",), hook.function, arguments)
            effort[hook.joint] = f"motor{hook.joint + 1}"
    for name, value in field.items():
        lines.append(f"{name} = {value}")
        known.add(name)

    joint: dict[int, list[str]] = {k: [] for k in range(4)}
    working: dict[int, list[str]] = {k: [] for k in range(4)}
    if scene.actuation == "joint":
        for k in range(4):
            joint[k].append(effort[k])
            working[k].append(effort[k])
    for i, (effect, hook) in enumerate(a.hooks):
        if isinstance(hook, Force):
            name = f"force{i}"
            statement((name,), hook.function, a.bound(effect, hook, hook.function))
            joint[hook.joint].append(name)
            if hook.conservative is hook.function:
                continue
            working[hook.joint].append(name)
            if hook.conservative is not None and a.track_work:
                booked = f"booked{i}"
                arguments = a.bound(effect, hook, hook.conservative)
                require(n for n in arguments if n not in known)
                statement((booked,), hook.conservative, arguments)
                working[hook.joint].append(f"(-{booked})")
    if any(joint.values()):
        for k in range(4):
            lines.append(f"t{k + 1} = {' + '.join(joint[k]) or '0.0'}")
            known.add(f"t{k + 1}")
        require(("Q1", "Q2", "Q3", "Q4"))
        if scene.actuation == "generalized":
            lines += [f"Q{k + 1} = Q{k + 1} + {effort[k]}" for k in range(4)]
    else:
        lines += [f"Q{k + 1} = {effort[k]}" for k in range(4)]
        known.update(f"Q{k + 1}" for k in range(4))
    require(("qdd1", "qdd2", "qdd3", "qdd4"))
    results = ["qdd1", "qdd2", "qdd3", "qdd4"]
    if a.track_work:
        power = [f"({' + '.join(working[k])}) * phid{k + 1}" for k in range(4) if working[k]]
        if power:
            require(f"phid{k + 1}" for k in range(4))
        if scene.actuation == "generalized":
            power += [f"{effort[k]} * {v}" for k, v in enumerate(arm.rates)]
        lines.append(f"power = {' + '.join(power) or '0.0'}")
        results.append("power")
    lines.append(f"return {', '.join(results)}")
    named = words(lines)
    given = (*(f"command{k}" for k in range(1, 5)), *a.numbers, *more)
    return [n for n in given if n in named], lines, used


def step_of(
    a: Assembly, rhs: RightHandSide, watched: Sequence[str] = ()
) -> tuple[list[str], list[Callable[..., Any]]]:
    """Straight lines of a step with a right-hand side, and dialect functions."""
    arm, method = a.scene.robot, METHODS[a.scene.integrator]
    arguments, _, functions = rhs
    call = f"rhs({{}}, {', '.join(arguments)})"
    lines = step_lines(method, arm.coordinates, arm.rates, a.states[8:], call, watched)
    used = list(functions)
    if a.estimates:
        lines += error_lines(a, used)
    return lines, used


def error_lines(a: Assembly, used: list[Callable[..., Any]]) -> list[str]:
    """Lines for ``error``: in metres at the tip, or for dop853 in units of its tolerance."""
    arm = a.scene.robot
    lines: list[str] = []
    if a.scene.integrator == "dop853":
        used += [scale, blended_error]
        rule = blended_error
        for s in a.states[:8]:
            lines.append(f"{s}_scale = {a.names.of(scale)}({s}, {s}_new)")
        for e in ("e5", "e3"):
            squares = " + ".join(f"({s}_{e} * {s}_scale) ** 2" for s in a.states[:8])
            lines.append(f"{e} = h_{e} * sqrt(({squares}) * 0.125)")
    else:
        wanted = ["n1", "n2", "n3", "n4"]
        used += [tip_error, tip_weight]
        rule = tip_error
        known = {*a.states, *a.numbers}
        for c in calls(wanted, known, (*arm.functions, arm.column_norms), arm.sincos):
            a.names.emit(c, lines, used)
        if a.scene.tolerance is not None:
            reach = " + ".join(f"l{k}" for k in range(1, arm.num_lengths + 1))
            for n, slides in zip(wanted, arm.prismatic, strict=True):
                lines += [] if slides else [f"{n} = {a.names.of(tip_weight)}({n}, {reach}, tip_tolerance)"]
        pairs = list(zip(wanted, arm.coordinates, arm.rates, strict=True))
        for e in ("e5", "e3"):
            terms = (f"{n} * (abs({q}_{e}) + interval * abs({v}_{e}))" for n, q, v in pairs)
            lines.append(f"{e} = h_{e} * ({' + '.join(terms)})")
    lines.append(f"error = {a.names.of(rule)}(e5, e3)")
    return lines
