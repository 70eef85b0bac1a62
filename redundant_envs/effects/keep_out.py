from dataclasses import dataclass, field

from redundant_envs.effects import contact, shapes
from redundant_envs.effects.disc import OBSTACLE, check_base
from redundant_envs.effects.hooks import Arm, Effect, Hook, named
from redundant_envs.effects.numbers import Example, Numbers, checked, one, pair, positive, text


@dataclass(frozen=True)
class KeepOut(Effect):
    """A disc that the arm should keep out of: it pushes nothing, and costs no step anything.

    Tasks and controllers ask how far the links are from it; :class:`Disc` is the same disc with contact.

    Parameters
    ----------
    centre : (float, float)
        Its centre (x, y), m.
    radius : float
        Its radius, m, positive; the disc must not cover the base of the arm.
    name : str
        Part of the name of its numbers, "keep_out_left.radius"; several of a scene have different ones.
    """

    centre: Numbers = field(metadata=pair(contact.place, "m", "m"))
    radius: float = field(metadata=one(positive, "m"))
    name: str = field(default="", metadata=checked(text))

    static = ("name",)
    key = named("keep_out_")
    example = Example({"centre": (0.5, 0.4), "radius": 0.2})

    def __post_init__(self) -> None:
        super().__post_init__()
        check_base("KeepOut", self.centre, self.radius)

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        x, y = self.centre
        return (shapes.Circle((x, y), self.radius),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        return (OBSTACLE,)
