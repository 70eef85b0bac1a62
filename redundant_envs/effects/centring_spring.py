from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook
from redundant_envs.effects.numbers import Curve, Example, Numbers, not_negative, numbers, row, travel
from redundant_envs.language.algebra import physics
from redundant_envs.robots.parameters import for_sliders


@physics
def force(position, lower, upper, stiffness):
    """Report 1.3, the last two terms of H2 and of H4, on the left-hand side there."""
    return -(stiffness * (position - upper) + stiffness * (position - lower))


@physics
def energy(position, lower, upper, stiffness):
    """Report 1.1, modified PE, the last four terms."""
    return 0.5 * stiffness * (upper - position) ** 2 + 0.5 * stiffness * (lower - position) ** 2


@physics
def steepness(stiffness):
    return 2.0 * stiffness


@dataclass(frozen=True)
class CentringSpring(Effect):
    """k/2 (r_max - r)^2 + k/2 (r_min - r)^2 on the prismatic joints of an arm, always on.

    It pulls towards the middle of the travel with stiffness 2k and does not limit anything;
    the report's text describes :class:`LimitSpring`.

    Parameters
    ----------
    stiffness : sequence of one for each slider
        Stiffness k of each slider's spring, N/m, not negative.
    lower, upper : sequences of one for each slider
        Ends r_min and r_max of the travel, m.
    """

    stiffness: Numbers = field(metadata=row(not_negative, "N/m"))
    lower: Numbers = field(metadata=row(numbers, "m"))
    upper: Numbers = field(metadata=row(numbers, "m"))

    example = Example(
        {"stiffness": (80.0, 80.0), "lower": (0.0, 0.0), "upper": (0.25, 0.25)},
        zero={"stiffness": (0.0, 0.0)},
        curve=Curve("force", "position", 0.3),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("lower", "upper"):
            numbers(f"CentringSpring.{name}", getattr(self, name), len(self.stiffness))
        for i, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True)):
            travel(f"CentringSpring.{{}}[{i}]", lower, upper)

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        drawn = zip(pose.arm.sliders(), self.stiffness, strict=True)
        return tuple(one for k, stiffness in drawn if stiffness for one in shapes.spring(pose, k))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        joints = for_sliders("CentringSpring", arm.kind, arm.sliders(), len(self.stiffness))
        binds = ({x: f".{x}[{i}]" for x in ("lower", "upper", "stiffness")} for i in range(len(joints)))
        pairs = zip(joints, binds, strict=True)
        return tuple(Force(k, force, bind, potential=energy, stiffness=steepness) for k, bind in pairs)
