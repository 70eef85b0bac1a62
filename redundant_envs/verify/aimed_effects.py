# mypy: allow-untyped-defs
"""Effects with states and kinks, for scenes that are aimed at the ways of crossing an interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import clamp, maximum, physics, where
from redundant_envs.effects.hooks import Actuation, Effect, Force, Hook, Link, State


@physics
def approach(command, effort, time_constant):
    return (command - effort) / time_constant


@physics
def effort_of(effort):
    return effort


@physics
def fastest_change(time_constant):
    return 1.0 / time_constant


@dataclass(frozen=True)
class Lag(Effect):
    """The effort of each motor approaches its command: a state of each is integrated beside the arm's."""

    time_constant: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        return tuple(self._link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))

    def _link(self, k: int, unit: str) -> Actuation:
        own = {"effort": f".effort[{k}]", "time_constant": ".time_constant"}
        bind = {"command": f"command{k + 1}", **own}
        state = State(f"effort[{k}]", unit, derivative=approach, bind=bind, rate=fastest_change)
        return Actuation(k, effort_of, own, Link.LAG, states=(state,))


@physics
def wind_up(rate, position, turn):
    return 0.5 * turn + 0.1 * rate + 0.01 * position


@physics
def backlash(rate, position, turn, play, drag):
    beyond = maximum(abs(position - turn) - play, 0.0)
    return -drag * beyond * clamp(10.0 * rate, -1.0, 1.0)


@dataclass(frozen=True)
class Play(Effect):
    """A force on the last joint with two kinks, and a state that changes after each interval only."""

    play: float
    drag: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        k = len(arm.coordinates)
        here = {"rate": f"phid{k}", "position": f"phi{k}", "turn": ".turn"}
        state = State("turn", "rad", update=wind_up, bind=here)
        return (Force(k - 1, backlash, {**here, "play": ".play", "drag": ".drag"}, states=(state,)),)


@physics
def dry(rate, level):
    return where(rate > 0.0, -level, level)


@dataclass(frozen=True)
class DryFriction(Effect):
    """A force on the last joint that jumps where its rate changes its sign: pulls of stops jump with it."""

    level: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        k = len(arm.coordinates)
        return (Force(k - 1, dry, {"rate": f"phid{k}", "level": ".level"}),)
