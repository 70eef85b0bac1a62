"""Hard ends of the travel of both sliders: impacts with restitution, located in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import maximum, minimum, physics, sqrt, where
from redundant_envs.effects.hooks import Effect, Hook, Impact
from redundant_envs.robots.parameters import Arm, number


@physics
def turning_point(q0, v0, q1, v1, h):
    """Time and place where the cubic through both ends of a step turns; the end if it does not.

    The place is taken 5 % further than the cubic goes: a turn so near a stop is looked at closely.
    """
    s0 = h * v0
    d = q1 - q0
    c2 = 3.0 * d - h * (2.0 * v0 + v1)
    c3 = h * (v0 + v1) - 2.0 * d
    root = sqrt(maximum(c2 * c2 - 3.0 * c3 * s0, 0.0))
    turns = v0 * v1 < 0.0
    s = where(turns, s0 / (where(v0 > 0.0, root, -root) - c2), 1.0)
    place = q0 + s * (s0 + s * (c2 + s * c3))
    nearest = where(v0 > 0.0, maximum(q0, q1), minimum(q0, q1))
    return s * h, where(turns, place + 0.05 * (place - nearest), q1)


@physics
def meeting(q0, v0, q1, v1, h, lower, upper):
    """How a step meets a stop, and when its motion turns.

    0: not at all; 1 or -1: it ends beyond the upper or lower one; 2 or -2: it may go beyond and
    come back; 3: it starts at a stop and does not leave it.
    """
    turns_at, place = turning_point(q0, v0, q1, v1, h)
    out = where(place > upper, 2.0, where(place < lower, -2.0, 0.0))
    out = where(q1 > upper, 1.0, where(q1 < lower, -1.0, out))
    out = where(q0 >= upper, where(v0 >= 0.0, 3.0, out), out)
    return where(q0 <= lower, where(v0 <= 0.0, 3.0, out), out), turns_at


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
            if isinstance(ends, str) or not hasattr(ends, "__len__") or len(ends) != 2:
                raise ValueError(f"PrismaticStop.{name} is {ends!r}; give two ends, those of r1 and r2")
            checked = tuple(
                None if end is None or end == none else number(f"PrismaticStop.{name}[{i}]", end)
                for i, end in enumerate(ends)
            )
            object.__setattr__(self, name, checked)
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if low is not None and high is not None and low >= high:
                raise ValueError(
                    f"PrismaticStop.lower[{i}] is {low}, upper[{i}] is {high}; lower must be below"
                )
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
