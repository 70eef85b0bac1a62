"""Limits of a scene's joints: the range of starts, and how far a joint is beyond its limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from redundant_envs.algebra import clamp, maximum, minimum, physics, where
from redundant_envs.effects.hooks import Impact
from redundant_envs.scene import Scene

Limit = tuple[int, str, str]  # a joint, and the names of the parameters that limit it below and above


def spring_limits(scene: Scene) -> list[Limit]:
    """Limits that a joint may pass against a force: those of springs."""
    hard = scene.attached.keys_of(Impact)
    return [
        (joint, f"{effect.key}.{low}", f"{effect.key}.{high}")
        for effect in scene.effects
        if effect.key not in hard
        for joint, (low, high) in effect.travel(scene.robot).items()
    ]


def hard_stops(scene: Scene) -> list[Limit]:
    """Limits that no joint can pass; one of them is infinite where there is no stop."""
    return [
        (a.hook.joint, a.parameter(a.hook.lower), a.parameter(a.hook.upper))
        for a in scene.attached.of(Impact)
    ]


def is_confined(scene: Scene) -> bool:
    """Whether hard stops keep every slider within its travel: else the tip may go anywhere."""
    values = scene.parameters()
    kept = {joint for joint, *ends in hard_stops(scene) if all(math.isfinite(values[end]) for end in ends)}
    return kept >= {*scene.robot.sliders()}


@physics
def narrowed(low, high, lower, upper):
    """The part of a range that lies inside limits; without one, the nearest range as wide inside them."""
    empty = maximum(low, lower) > minimum(high, upper)
    width = high - low
    shifted = clamp(low, lower, maximum(upper - width, lower))
    start = where(empty, shifted, maximum(low, lower))
    return start, minimum(where(empty, shifted + width, high), upper)


def range_of_starts(task: Any, scene: Scene, joint: int, value: Callable[[str], Any]) -> tuple[Any, Any]:
    """Range of the starts of a joint inside its limits; ``value`` gives a parameter by its name."""

    def signed(text: str) -> Any:
        return -value(text[1:]) if text.startswith("-") else value(text)

    low, high = map(signed, task.start_range(scene, joint))
    for limited, lower, upper in (*spring_limits(scene), *hard_stops(scene)):  # the last word is a stop's
        if limited == joint:
            low, high = narrowed(low, high, value(lower), value(upper))
    return low, high


@physics
def start_position(draw, low, high):
    """Uniform in a range."""
    return low + draw * (high - low)


@physics
def depth_beyond(position, lower, upper):
    return maximum(maximum(lower - position, position - upper), 0.0)
