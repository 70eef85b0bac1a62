from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook
from redundant_envs.effects.limit_spring import depth_beyond
from redundant_envs.effects.numbers import Curve, Example, not_negative, number, one, travel
from redundant_envs.language.algebra import physics


@physics
def force(position, lower, upper, side, soft, harder):
    return -soft * position - harder * depth_beyond(position, lower, upper, side)


@physics
def energy(position, lower, upper, side, soft, harder):
    return 0.5 * soft * position**2 + 0.5 * harder * depth_beyond(position, lower, upper, side) ** 2


@physics
def steepness(soft, harder):
    return soft + harder


@dataclass(frozen=True)
class TwoStageSpring(Effect):
    """Pulls a joint back to 0, harder beyond a knee on either side.

    Between the knees the force is -k x, at depth d beyond one it is -k x - k' d, d having the sign of x's
    side: a spring that meets a second one. Under error control a step that reaches a knee ends there.

    Parameters
    ----------
    coordinate : str
        Joint: "r1" or "r2" (travel, m), or "joint1", "joint2", ... (relative angle, rad).
    lower, upper : float
        Positions of the knees, m or rad.
    soft : float
        Stiffness k between the knees, N/m or N m/rad, not negative.
    harder : float
        k', what is added beyond a knee, N/m or N m/rad, not negative.
    """

    coordinate: str
    lower: float = field(metadata=one(number, "rad", "m"))
    upper: float = field(metadata=one(number, "rad", "m"))
    soft: float = field(metadata=one(not_negative, "N m/rad", "N/m"))
    harder: float = field(metadata=one(not_negative, "N m/rad", "N/m"))

    static = ("coordinate",)
    example = Example(
        {"coordinate": "joint2", "lower": -1.0, "upper": 1.0, "soft": 5.0, "harder": 200.0},
        curve=Curve("force", "position", 1.5),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        travel("TwoStageSpring.{}", self.lower, self.upper)

    @property
    def key(self) -> str:
        return f"two_stage_spring.{self.coordinate}"

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        return shapes.spring(pose, pose.arm.joint_index(self.coordinate))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        k, switch = arm.joint_index(self.coordinate), (".lower", ".upper")
        return (Force(k, force, potential=energy, stiffness=steepness, switch=switch),)
