import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from redundant_envs.effects.hooks import Arm, Effect, Hook, Impact
from redundant_envs.effects.numbers import Curve, Ends, Example, number, one, share, travel
from redundant_envs.support.values import shown

FREE = {"lower": -math.inf, "upper": math.inf}  # ends of the travel of a joint without stops


@dataclass(frozen=True)
class JointStop(Effect):
    """Limited travel of the joints of an arm, whether they turn or slide.

    A joint that reaches an end of its travel turns back with ``restitution`` times its rate, by an impulse
    along it that moves the whole arm, M dqd = b_j lambda, with b_j the column of the motor map. Impacts are
    located in time by stepping to them. A joint that is pressed onto a stop comes to rest there, with the
    rate 0, until it is pulled away. The angle of a joint is a difference of absolute angles, whose rounding,
    at most 4 ulp of the largest of these, is all that it may be beyond a stop.

    Parameters
    ----------
    lower, upper : sequences of one for each joint
        Ends of the travel, rad, and m of sliders; None or an infinite number for an end without a stop.
    restitution : float
        Rate after an impact over rate before, 0 to 1.
    """

    lower: Ends
    upper: Ends
    restitution: float = field(default=1.0, metadata=one(share))

    example = Example(
        {"lower": (-1.0, -1.0, -1.0, -1.0), "upper": (1.0, 1.0, 1.0, 1.0), "restitution": 0.0},
        curve=Curve("rate", "time", 0.6),
    )

    def __post_init__(self) -> None:
        kind = type(self).__name__
        for name in FREE:
            object.__setattr__(self, name, self._ends(name))
        if len(self.lower) != len(self.upper):
            raise ValueError(
                f"{kind}.lower has {len(self.lower)} entries and upper {len(self.upper)}; give as many"
            )
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if low is not None and high is not None:
                travel(f"{kind}.{{}}[{i}]", low, high)
        if not self._limited():
            raise ValueError("JointStop.lower and upper have no end of any joint; give one")
        super().__post_init__()

    def parameters(self) -> dict[str, float]:
        values = {"restitution": self.restitution}
        for i in self._limited():
            for name, none in FREE.items():
                end = getattr(self, name)[i]
                values[f"{name}[{i}]"] = none if end is None else end
        return values

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        if len(self.lower) != len(arm.joints):
            raise ValueError(
                f"JointStop.lower has {len(self.lower)} entries; {arm.kind} has {len(arm.joints)} joints: "
                f"give an end, or None, for each of {', '.join(arm.joints)}"
            )
        return tuple(Impact(i, f".lower[{i}]", f".upper[{i}]", ".restitution") for i in self._limited())

    def _limited(self) -> list[int]:
        """Joints with a stop at an end at least; the others take no part, and cost nothing."""
        pairs = zip(self.lower, self.upper, strict=True)
        return [i for i, (low, high) in enumerate(pairs) if low is not None or high is not None]

    def _ends(self, name: str) -> tuple[float | None, ...]:
        """Checked ends of the travel of all joints; None where there is none."""
        ends, field = getattr(self, name), f"{type(self).__name__}.{name}"
        values = ends.tolist() if hasattr(ends, "tolist") else ends
        if not isinstance(values, Sequence) or isinstance(values, str | bytes) or not values:
            raise ValueError(f"{field} is {shown(ends)}; give a sequence of ends, or None for those without")
        stops = [None if isinstance(end, float) and end == FREE[name] else end for end in values]
        return tuple(None if end is None else number(f"{field}[{i}]", end) for i, end in enumerate(stops))
