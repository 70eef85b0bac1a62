"""Hard ends of the travel of sliders alone: impacts with restitution, located in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from redundant_envs.effects.hooks import Effect, Hook, Impact
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import for_sliders, number, travel
from redundant_envs.values import Ends, shown


@dataclass(frozen=True)
class PrismaticStop(Effect):
    """Limited travel of the sliders of an arm, as the text of the report describes it.

    A slider that reaches an end of its travel turns back with ``restitution`` times its speed, by
    an impulse along it that moves the whole arm, M dqd = e_j lambda. Impacts are located in time by
    stepping to them; a slider never is beyond its stop. When its bounces stay below 1e-9 m, a slider comes to
    rest at the stop, and it leaves the stop when it is pulled away.

    Parameters
    ----------
    lower, upper : sequences of one for each slider
        Ends of the travel of r1, r2, ..., m; None for an end without a stop.
    restitution : float
        Speed after an impact over speed before, 0 to 1.
    """

    lower: Ends
    upper: Ends
    restitution: float = 1.0

    def __post_init__(self) -> None:
        for name, none in (("lower", -math.inf), ("upper", math.inf)):
            ends = getattr(self, name)
            given = ends.tolist() if hasattr(ends, "tolist") else ends
            if not isinstance(given, tuple | list) or not given:
                raise ValueError(
                    f"PrismaticStop.{name} is {shown(ends)}; give an end for each slider, in their order"
                )
            kept = [None if isinstance(end, float) and end == none else end for end in given]
            named = {f"PrismaticStop.{name}[{i}]": end for i, end in enumerate(kept)}
            checked = tuple(None if end is None else number(field, end) for field, end in named.items())
            object.__setattr__(self, name, checked)
        if len(self.lower) != len(self.upper):
            raise ValueError(
                f"PrismaticStop.lower has {len(self.lower)} entries and upper {len(self.upper)}; give as "
                "many: one for each slider"
            )
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if low is not None and high is not None:
                travel(f"PrismaticStop.{{}}[{i}]", low, high)
        e = number("PrismaticStop.restitution", self.restitution)
        if not 0.0 <= e <= 1.0:
            raise ValueError(f"PrismaticStop.restitution is {e}; it must lie in 0 to 1")
        object.__setattr__(self, "restitution", e)

    def parameters(self) -> dict[str, float]:
        values = {"restitution": self.restitution}
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            values[f"lower[{i}]"] = -math.inf if low is None else low
            values[f"upper[{i}]"] = math.inf if high is None else high
        return values

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        sliders = for_sliders("PrismaticStop", arm.kind, arm.sliders(), len(self.lower))
        ends = ((k, f".lower[{i}]", f".upper[{i}]") for i, k in enumerate(sliders))
        return tuple(Impact(k, lower, upper, ".restitution") for k, lower, upper in ends)
