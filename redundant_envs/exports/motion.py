"""The equations of motion of a scene as a graph: functions of positions, rates and commands."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from redundant_envs.compiler.tracing.graph import Graph, Value, located
from redundant_envs.compiler.tracing.number import Number, value_of
from redundant_envs.effects import hooks
from redundant_envs.effects.bound_hooks import Attached
from redundant_envs.effects.hooks import Actuation
from redundant_envs.exports.files import Note, named, refuse_inexact
from redundant_envs.language.algebra import entries, numbered
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics

INPUTS = ("q", "qd", "commands")
REASONS: dict[type, str] = {
    **dict.fromkeys((hooks.Impact, hooks.Gap, hooks.Impulse), "it makes velocities jump"),
    hooks.Friction: "the force in a joint that sticks does not follow from the motion",
    hooks.Instant: "it acts within a control interval",
    hooks.Sensing: "sensors do not affect accelerations",
}
"""Why hooks are no part of such functions."""


def smooth_scene(scene: Scene, form: str, approximate: bool) -> tuple[Scene, list[Note]]:
    """The scene without the effects that are no functions of the motion, and notes of these; ValueError if
    there are some, and the result is not to be ``approximate``."""
    reasons = [(a.key, _reason(scene, a)) for a in scene.attached]
    unfit = {key: reason for key, reason in reversed(reasons) if reason}
    changing = [a.key for a in scene.attached.of(Actuation) if _changes_units(scene, a)]
    if unfit.keys() & changing:  # what gave a motor its voltage has nothing to act on
        unfit = {**dict.fromkeys(changing, "the motor behind it is left out"), **unfit}
    notes = [Note(named(e, scene), unfit[e.key], "left out") for e in scene.effects if e.key in unfit]
    refuse_inexact(notes, form, approximate)
    rest = tuple(e for e in scene.effects if e.key not in unfit)
    return dataclasses.replace(scene, effects=rest, randomize=None), notes


def _reason(scene: Scene, a: Attached[Any]) -> str:
    """Why a hook is no part of the function; "" if it is."""
    if type(a.hook) in REASONS:
        return REASONS[type(a.hook)]
    changes = hooks.states_of(a.hook) or a in scene.attached.moving_fields
    return "it has states of its own, or a field that changes with time" if changes else ""


def _changes_units(scene: Scene, a: Attached[Actuation]) -> bool:
    """Whether a link takes or gives something else than an effort."""
    return not {a.hook.takes, a.hook.gives} <= {"", hooks.effort_unit(scene.robot, a.hook.joint)}


def equations(scene: Scene, *wanted: str) -> dict[str, list[Value]]:
    """Results as values of a graph of whole functions, with the numbers of the scene, row by row: "qdd", "M",
    "h", "G", "tip", "J". Its loads are entries of ``q``, ``qd`` and ``commands``, the motors' commands.

    The scene has no effects with states or jumps.
    """
    n = len(scene.robot.joints)
    dynamics = Dynamics(scene, located=False)  # positions choose the law of a spring
    with located():
        graph = Graph(whole=True)
        sizes = zip(INPUTS, (n, n, len(dynamics.commands)), strict=True)
        q, qd, commands = ([Number(graph, graph.load(name, k)) for k in range(size)] for name, size in sizes)
        numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, commands, strict=True))}
        x = dynamics.quantities([*q, *qd], numbers)
        results: dict[str, Iterable[Any]] = {"qdd": dynamics.accelerations(x)[:n]}
        names = {
            "M": entries("M", n, n), "h": numbered("h{}", n), "G": numbered("G{}", n),
            "tip": ("tip_x", "tip_y"), "J": entries("J", 2, n),
        }  # fmt: skip
        results |= {name: x.each(names[name]) for name in wanted if name != "qdd"}
        return {name: [value_of(x) for x in results[name]] for name in wanted}
