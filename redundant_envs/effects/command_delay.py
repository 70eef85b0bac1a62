"""Commands that reach the motors some time after they are given."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.effects.hooks import Actuation, Arm, Effect, Hook, Instant, Link, State
from redundant_envs.effects.numbers import Example, not_negative, number, one
from redundant_envs.language.algebra import floor, identity, maximum, numbered, physics, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.support.values import with_fields

MAX_KEPT = 1024
"""Most commands of a motor that are kept: each is a number of every environment, and moves once in an
interval."""


@physics
def whole_intervals(seconds, control_dt):
    """Control intervals that fit into a time; one that is short of it by rounding, four ulps, counts. Without
    a sum, it has the same bits wherever it is computed."""
    return floor((1.0 + ROUNDING) * (seconds / control_dt))


@physics
def rest(seconds, control_dt):
    """What is left of a delay then, s; 0 within rounding, four ulps."""
    left = seconds - whole_intervals(seconds, control_dt) * control_dt
    return where(left > ROUNDING * maximum(seconds, control_dt), left, 0.0)


@functools.lru_cache(maxsize=64)
def acting_of(kept: int) -> Callable[..., Any]:
    """The function that chooses the command that acts: the present one, or one of those ``kept``."""

    @physics(takes=("command", "seconds", "control_dt", "passed", *numbered("sent{}", kept)))
    def acting(command, seconds, control_dt, passed, *sent):
        age = whole_intervals(seconds, control_dt) + 1.0 - passed
        chosen = command
        for intervals, earlier in enumerate(sent, start=1):
            chosen = where(age == float(intervals), earlier, chosen)
        return chosen

    return acting


@dataclass(frozen=True)
class CommandDelay(Effect):
    """Motors get each command ``seconds`` after it is given, as over a bus: all of them alike.

    A delay of n control intervals and a rest lets the command of n + 1 intervals ago act for the rest of an
    interval, then that of n ago; before the first command the effort is 0. Where there is a rest, an interval
    is crossed in two pieces.

    Parameters
    ----------
    seconds : float
        s, from 0 to ``longest``. What is within rounding of whole control intervals counts as these.
    longest : float
        s: the longest delay that any environment may have. It chooses how many commands are kept, one more
        than control intervals fit into it, at most 1024.

    Attributes
    ----------
    control_dt : float or None
        Control interval of the scene that has the effect, s.
    """

    seconds: float = dataclasses.field(metadata=one(number, "s"))
    longest: float = dataclasses.field(metadata=one(not_negative))
    control_dt: float | None = dataclasses.field(default=None, init=False)

    static = ("longest", "control_dt")
    example = Example({"seconds": 0.013, "longest": 0.1})

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.seconds <= self.longest:
            raise ValueError(
                f"CommandDelay.seconds is {self.seconds} s; it must lie in 0 to longest, which is "
                f"{self.longest} s: give a shorter delay, or a larger longest"
            )

    def at_interval(self, control_dt: float) -> CommandDelay:
        """The effect with the commands that a scene with this control interval keeps."""
        made = with_fields(self, control_dt=control_dt)
        if made.kept > MAX_KEPT:
            raise ValueError(
                f"CommandDelay.longest is {self.longest} s, which at a control_dt of {control_dt} s needs "
                f"{made.kept} kept commands; at most {MAX_KEPT} are: give a longest below "
                f"{MAX_KEPT * control_dt:g} s, or a longer control_dt"
            )
        return made

    @property
    def kept(self) -> int:
        """Number of commands that are kept for each motor."""
        if self.control_dt is None:
            raise ValueError(
                "CommandDelay keeps as many commands as its scene's control_dt asks for; make a Scene"
            )
        return int(whole_intervals(self.longest, self.control_dt)) + 1

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        links = (self._link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))
        return (Instant(rest, {"seconds": ".seconds"}), *links)

    def _link(self, joint: int, unit: str) -> Actuation:
        """The commands of a motor, the latest first; each interval moves them on by one."""
        command = f"command{joint + 1}"
        names = [f"sent[{joint * self.kept + k}]" for k in range(self.kept)]
        before = [command, *(f".{name}" for name in names[:-1])]
        states = tuple(
            State(name, unit, update=identity("before"), bind={"before": source})
            for name, source in zip(names, before, strict=True)
        )
        sent = {f"sent{k + 1}": f".{name}" for k, name in enumerate(names)}
        bind = {"command": command, "seconds": ".seconds", **sent}
        return Actuation(joint, acting_of(self.kept), bind, Link.DELAY, states=states)
