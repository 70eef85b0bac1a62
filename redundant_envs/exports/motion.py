"""The accelerations of a scene as a function of positions, rates and efforts, on any kind of numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from redundant_envs.effects.attached import Attached
from redundant_envs.effects.hooks import Field, Friction, Gap, Impact, Impulse, Instant, Sensing, states_of
from redundant_envs.exports.document import Note, settled
from redundant_envs.lane.direct import fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.quantities import Quantities
from redundant_envs.scene import Scene

REASONS: dict[type, str] = {
    **dict.fromkeys((Impact, Gap, Impulse), "velocities that jump are no accelerations"),
    Friction: "the force of a joint that sticks does not follow from its motion",
    Instant: "nothing changes within an interval there",
    Sensing: "sensors change no acceleration",
}
"""Why hooks are no part of such a function."""


def smooth_scene(scene: Scene, form: str, approximate: bool) -> tuple[Scene, list[Note]]:
    """The scene without the effects that are no functions of the motion, and notes of these; ValueError if
    there are some, and the result is not to be ``approximate``."""
    reasons = [(a.key, _reason(scene, a)) for a in scene.attached]
    unfit = {key: reason for key, reason in reversed(reasons) if reason}
    notes = [Note(type(e).__name__, unfit[e.key], "left out") for e in scene.effects if e.key in unfit]
    settled(notes, form, approximate)
    rest = tuple(effect for effect in scene.effects if effect.key not in unfit)
    return dataclasses.replace(scene, effects=rest, randomize=None), notes


def _reason(scene: Scene, a: Attached[Any]) -> str:
    """Why a hook is no part of the function; "" if it is."""
    if type(a.hook) in REASONS:
        return REASONS[type(a.hook)]
    moves = isinstance(a.hook, Field) and a not in scene.attached.constant_fields
    return "states beside the motion have no place in it" if moves or states_of(a.hook) else ""


def quantities_of(
    scene: Scene, q: Sequence[Any], qd: Sequence[Any], efforts: Sequence[Any]
) -> tuple[list[Any], Quantities]:
    """Accelerations, and the quantities from which they follow, at the numbers of the scene; ``efforts`` are
    the motors' commands, N m and N. The scene has no effects with states or jumps."""
    dynamics = Dynamics(scene, located=False)  # positions choose the law of a spring
    numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, efforts, strict=True))}
    x = dynamics.quantities([*q, *qd], numbers)
    return dynamics.accelerations(x)[: len(q)], x
