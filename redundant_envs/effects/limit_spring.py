from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook
from redundant_envs.effects.numbers import Curve, Example, not_negative, number, one, positive, travel
from redundant_envs.language.algebra import clamp, identity, maximum, physics, where


@physics
def depth_beyond(position, lower, upper, side):
    """Distance of a joint beyond the limit of a side; 0 between the limits."""
    return position - where(side < 0.0, lower, where(side != 0.0, upper, position))


@physics
def spring(position, lower, upper, stiffness, side):
    return -stiffness * depth_beyond(position, lower, upper, side)


@physics
def spring_energy(position, lower, upper, stiffness):
    return 0.5 * stiffness * (position - clamp(position, lower, upper)) ** 2


@physics
def force(position, rate, lower, upper, stiffness, damping, side):
    """Spring and damper: the damper grows with depth, so the force is continuous at the limit,
    and the stop pushes, never pulls."""
    depth = depth_beyond(position, lower, upper, side)
    speed_in = where(side < 0.0, -rate, rate)
    return -depth * maximum(stiffness + damping * speed_in, 0.0)


@physics
def hold(rate, stiffness, damping, side):
    """Effective stiffness at a rate: where it would be negative, the joint loses contact with the stop."""
    return where(side == 0.0, 1.0, stiffness + damping * where(side < 0.0, -rate, rate))


@physics
def damper(position, lower, upper, damping):
    """Damping at a position, if the joint moves deeper."""
    return damping * abs(position - clamp(position, lower, upper))


@dataclass(frozen=True)
class LimitSpring(Effect):
    """Limited travel of one joint: the compliant form of the stop the report describes.

    Inside the limits there is no force. At depth d beyond one, the force back is
    d max(k + c d', 0). Under error control a step that reaches a limit ends there.

    Parameters
    ----------
    coordinate : str
        Joint: "r1" or "r2" (travel, m), or "joint1", "joint2", ... (relative angle, rad).
    lower, upper : float
        Limits of the travel, m or rad.
    stiffness : float
        Stiffness k of the spring, N/m or N m/rad, positive.
    damping : float
        Damping c per depth, N s/m^2 or N m s/rad^2, not negative.
    """

    coordinate: str
    lower: float = field(metadata=one(number, "rad", "m"))
    upper: float = field(metadata=one(number, "rad", "m"))
    stiffness: float = field(default=5000.0, metadata=one(positive, "N m/rad", "N/m"))
    damping: float = field(default=0.0, metadata=one(not_negative, "N m s/rad^2", "N s/m^2"))

    static = ("coordinate",)
    example = Example(
        {"coordinate": "joint2", "lower": -1.0, "upper": 1.0, "stiffness": 200.0, "damping": 5.0},
        curve=Curve("force", "position", 1.5),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        travel("LimitSpring.{}", self.lower, self.upper)

    @property
    def key(self) -> str:
        return f"limit_spring.{self.coordinate}"

    def travel(self, arm: Arm) -> dict[int, tuple[str, str]]:
        return {arm.joint_index(self.coordinate): ("lower", "upper")}

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        """The spring while it is pressed."""
        k = pose.arm.joint_index(self.coordinate)
        return () if self.lower <= pose.positions[k] <= self.upper else shapes.spring(pose, k)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        k = arm.joint_index(self.coordinate)
        return (
            Force(
                k, force, potential=spring_energy, conservative=spring, stiffness=identity("stiffness"),
                damping=damper, switch=(".lower", ".upper"), kink=hold,
            ),
        )  # fmt: skip
