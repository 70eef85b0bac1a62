import dataclasses
import math
from dataclasses import dataclass

from redundant_envs.effects.hooks import Arm, Effect, Field, Hook
from redundant_envs.effects.numbers import Curve, Example, Numbers, number, numbers, one, pair, strength
from redundant_envs.language.algebra import physics


@physics(gives="ax ay")
def field(g, down_x, down_y):
    """Minus the gravity vector: an arm at rest in the field is an arm accelerated upwards."""
    return -g * down_x, -g * down_y


@dataclass(frozen=True)
class Gravity(Effect):
    """Uniform gravity.

    Parameters
    ----------
    g : float
        Strength of the field, m/s^2.
    down : (float, float)
        The unit vector that points down, projected on the plane of the arm; its length is at most
        1. (0, -1) means a vertical plane; :meth:`on_plane` computes it for a tilted one.
    """

    g: float = dataclasses.field(default=9.81, metadata=one(strength, "m/s^2"))
    down: Numbers = dataclasses.field(default=(0.0, -1.0), metadata=pair(numbers))

    example = Example({"g": 9.81}, zero={"g": 0.0}, curve=Curve("force", "position", 3.2))

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.hypot(*self.down) > 1.0 + 1e-12:
            raise ValueError(f"Gravity.down is {self.down}; give a unit vector, or its projection")

    @classmethod
    def on_plane(cls, g: float = 9.81, tilt: float = 0.0, roll: float = 0.0) -> "Gravity":
        """Gravity in a plane tilted by ``tilt`` [rad] away from vertical and rolled by ``roll``.

        A horizontal plane (tilt = pi/2) has no gravity; ``roll`` turns the direction of steepest
        descent counter-clockwise from -y.
        """
        tilt, roll = number("tilt", tilt), number("roll", roll)
        down = math.cos(tilt)
        return cls(g, (down * math.sin(roll), -down * math.cos(roll)))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return (Field(field),)
