"""Hard ends of the travel of both sliders: impacts with restitution, located in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import maximum, minimum, physics, sqrt, where
from redundant_envs.effects.hooks import Effect, Hook, Impact
from redundant_envs.integrators.stops import bounds, closeness, excursions
from redundant_envs.robots.parameters import Arm, number, travel
from redundant_envs.values import shown


@physics
def turning_time(q0, v0, q1, v1, h):
    """Time at which the cubic through both ends of a step turns; the end if it does not."""
    s0 = h * v0
    d = q1 - q0
    c2 = 3.0 * d - h * (2.0 * v0 + v1)
    c3 = h * (v0 + v1) - 2.0 * d
    root = sqrt(maximum(c2 * c2 - 3.0 * c3 * s0, 0.0))
    return h * where(v0 * v1 < 0.0, s0 / (where(v0 > 0.0, root, -root) - c2), 1.0)


@physics
def meeting(q0, v0, q1, v1, h, least, most, first, last, unseen, unseen_end, lower, upper):
    """How a step meets a stop, and when its motion turns.

    0: not at all. 1 or -1: it ends beyond the upper or lower one, which it passes once. 2 or -2: it
    turns once, and may be beyond the upper or lower one then. 4: it may pass them more often than its
    ends and its turn tell.

    ``least``, ``most``, ``first`` and ``last`` are accelerations at the stages, explained in ``bounds``. A
    velocity that keeps its sign meets a stop once at most, an acceleration that does turns once.
    """
    lo, hi = bounds(q0, least, most, first, last, unseen, unseen_end, lower, upper)
    above, below = excursions(q0, v0, q1, v1, h, lo, hi, lower, upper)
    close = closeness(q0, lower, upper)
    sinks = h * minimum(lo, 0.0)
    lifts = h * maximum(hi, 0.0)
    rising = where(v0 + sinks >= 0.0, 1.0, where(v1 - lifts >= 0.0, 1.0, 0.0))
    falling = where(v0 + lifts <= 0.0, 1.0, where(v1 - sinks <= 0.0, 1.0, 0.0))
    # While an acceleration grows, or falls, its velocity stays below, or above, its ends.
    grows = where(first <= least, where(last >= most, 1.0, 0.0), 0.0)
    falls = where(first >= most, where(last <= least, 1.0, 0.0), 0.0)
    falling = where(maximum(v0, v1) <= 0.0, maximum(falling, grows), falling)
    rising = where(minimum(v0, v1) >= 0.0, maximum(rising, falls), rising)
    turning = (1.0 - rising) * (1.0 - falling)
    ends = where(q1 > upper, 1.0, where(q1 < lower, -1.0, 0.0))
    # A motion with q'' <= hi < 0 is at most v0^2 / (2 |hi|) above its start, and so from its end.
    top = minimum(v0 * v0 + 2.0 * hi * (upper - q0 + close), v1 * v1 + 2.0 * hi * (upper - q1 + close))
    bottom = minimum(v0 * v0 - 2.0 * lo * (q0 - lower + close), v1 * v1 - 2.0 * lo * (q1 - lower + close))
    above_bent = where(hi <= 0.0, where(top > 0.0, above, 0.0), 0.0)
    below_bent = where(lo >= 0.0, where(bottom > 0.0, below, 0.0), 0.0)
    met = where(above_bent > 0.0, where(ends > 0.0, ends, 2.0), ends)
    met = where(below_bent > 0.0, where(ends < 0.0, ends, -2.0), met)
    bent = where(hi <= 0.0, 1.0, where(lo >= 0.0, 1.0, 0.0))
    unclear = (1.0 - bent) * maximum(abs(ends), maximum(above, below))
    met = where(turning > 0.0, where(unclear > 0.0, 4.0, met), ends)
    return met, turning_time(q0, v0, q1, v1, h)


@dataclass(frozen=True)
class PrismaticStop(Effect):
    """Limited travel of both sliders of the RPRP arm: what the report describes in words.

    A slider that reaches an end of its travel turns back with ``restitution`` times its speed, by
    an impulse along it that moves the whole arm, M dqd = e_j lambda. Impacts are located in time by
    stepping to them; a slider never is beyond its stop. One that hardly bounces (its bounces stay
    below 1e-9 m) comes to rest at the stop, and leaves it when it is pulled away.

    Parameters
    ----------
    lower, upper : (float, float)
        Ends of the travel of r1 and r2, m; None where there is none.
    restitution : float
        Speed after an impact over speed before, 0 to 1.
    """

    lower: tuple[float | None, float | None]
    upper: tuple[float | None, float | None]
    restitution: float = 1.0

    def __post_init__(self) -> None:
        for name, none in (("lower", -math.inf), ("upper", math.inf)):
            ends = getattr(self, name)
            given = ends.tolist() if hasattr(ends, "tolist") else ends
            if not isinstance(given, tuple | list) or len(given) != 2:
                raise ValueError(f"PrismaticStop.{name} is {shown(ends)}; give two ends, those of r1 and r2")
            checked = tuple(
                None
                if end is None or (isinstance(end, float) and end == none)
                else number(f"PrismaticStop.{name}[{i}]", end)
                for i, end in enumerate(given)
            )
            object.__setattr__(self, name, checked)
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if low is not None and high is not None:
                travel(f"PrismaticStop.lower[{i}]", low, f"PrismaticStop.upper[{i}]", high)
        e = number("PrismaticStop.restitution", self.restitution)
        if not 0.0 <= e <= 1.0:
            raise ValueError(f"PrismaticStop.restitution is {e}; it must lie in 0 to 1")
        object.__setattr__(self, "restitution", e)

    def parameters(self) -> dict[str, float]:
        values = {"restitution": self.restitution}
        for i in range(2):
            low, high = self.lower[i], self.upper[i]
            values[f"lower[{i}]"] = -math.inf if low is None else low
            values[f"upper[{i}]"] = math.inf if high is None else high
        return values

    def travel(self, arm: Arm) -> dict[int, tuple[str, str]]:
        return {
            k: (f"lower[{i}]", f"upper[{i}]")
            for i, k in enumerate(sliders(arm))
            if self.lower[i] is not None and self.upper[i] is not None
        }

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return tuple(
            Impact(k, f".lower[{i}]", f".upper[{i}]", ".restitution", meeting)
            for i, k in enumerate(sliders(arm))
        )


def sliders(arm: Any) -> list[int]:
    """Joint numbers of the two sliders; ValueError for an arm without."""
    joints = [k for k in range(4) if arm.prismatic[k]]
    if len(joints) != 2:
        raise ValueError(
            f"PrismaticStop ends the travel of the two sliders of RPRP; {arm.kind} has {len(joints)}"
        )
    return joints
