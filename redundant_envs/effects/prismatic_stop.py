"""Hard ends of the travel of both sliders: impacts with restitution, located in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from redundant_envs.effects.hooks import Effect, Hook, Impact
from redundant_envs.robots.parameters import Arm, number, travel
from redundant_envs.values import shown


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
            Impact(k, f".lower[{i}]", f".upper[{i}]", ".restitution") for i, k in enumerate(sliders(arm))
        )


def sliders(arm: Any) -> list[int]:
    """Joint numbers of the two sliders; ValueError for an arm without."""
    joints = [k for k in range(4) if arm.prismatic[k]]
    if len(joints) != 2:
        raise ValueError(
            f"PrismaticStop ends the travel of the two sliders of RPRP; {arm.kind} has {len(joints)}"
        )
    return joints
