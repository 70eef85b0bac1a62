import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.effects.delays import Delay
from redundant_envs.effects.hooks import Actuation, Arm, Hook, Instant, Link, State, effort_unit
from redundant_envs.effects.numbers import Curve, Example
from redundant_envs.language.algebra import floor, identity, maximum, numbered, physics, where
from redundant_envs.language.limits import ROUNDING


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
def acting_of(count: int) -> Callable[..., Any]:
    """The function that chooses the command that acts: the present one, or one of those ``count``."""

    @physics(takes=("command", "seconds", "control_dt", "passed", *numbered("sent{}", count)))
    def acting(command, seconds, control_dt, passed, *sent):
        age = whole_intervals(seconds, control_dt) + 1.0 - passed
        chosen = command
        for intervals, earlier in enumerate(sent, start=1):
            chosen = where(age == float(intervals), earlier, chosen)
        return chosen

    return acting


@dataclass(frozen=True)
class CommandDelay(Delay):
    """Motors get each command ``seconds`` after it is given, as over a bus: all of them alike.

    A delay of n control intervals and a rest lets the command of n + 1 intervals ago act for the rest of an
    interval, then that of n ago; before the first command the effort is 0. Where there is a rest, an interval
    is crossed in two pieces.

    Parameters
    ----------
    seconds : float
        Delay of each command, s, from 0 to ``longest``. What is within rounding of whole control
        intervals counts as these.
    longest : float
        The longest delay that any environment may have, s. It chooses how many commands are kept, one more
        than control intervals fit into it, at most 1024.
    """

    values = "commands"
    example = Example({"seconds": 0.013, "longest": 0.1}, curve=Curve("effort", "time", 0.5))

    def kept_at(self, control_dt: float) -> int:
        return int(whole_intervals(self.longest, control_dt)) + 1

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return (Instant(rest), *(self._link(k, effort_unit(arm, k)) for k in range(len(arm.joints))))

    def _link(self, joint: int, unit: str) -> Actuation:
        """The commands of a motor, the latest first; each interval moves them on by one."""
        names = [f"sent[{joint * self.kept + k}]" for k in range(self.kept)]
        before = [f"command{joint + 1}", *(f".{name}" for name in names)]
        states = tuple(
            State(name, unit, update=identity("before"), bind={"before": source})
            for name, source in zip(names, before, strict=False)
        )
        sent = {f"sent{k + 1}": f".{name}" for k, name in enumerate(names)}
        return Actuation(joint, acting_of(self.kept), sent, Link.DELAY, states=states)
