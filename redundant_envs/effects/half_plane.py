import math
from dataclasses import dataclass, field

from redundant_envs.effects import contact, shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, Obstacle, Point, named
from redundant_envs.effects.numbers import Example, Numbers, checked, not_negative, one, pair, positive, text
from redundant_envs.language.algebra import maximum, physics, sqrt
from redundant_envs.robots.parameters import SMALLEST


@physics
def depth_and_normal(x, y, point_x, point_y, normal_x, normal_y):
    """Depth below the edge, negative outside, and the unit normal."""
    inverse = 1.0 / sqrt(normal_x * normal_x + normal_y * normal_y)
    nx, ny = normal_x * inverse, normal_y * inverse
    return (point_x - x) * nx + (point_y - y) * ny, nx, ny


@physics
def gap_of_link(xa, ya, xb, yb, point_x, point_y, normal_x, normal_y):
    """An end of a straight link is its deepest point."""
    near, _, _ = depth_and_normal(xa, ya, point_x, point_y, normal_x, normal_y)
    far, _, _ = depth_and_normal(xb, yb, point_x, point_y, normal_x, normal_y)
    return -maximum(near, far)


LAWS = contact.laws(depth_and_normal)


@dataclass(frozen=True)
class HalfPlane(Effect):
    """Everything beyond a straight edge pushes the tip of the arm, or the ends of its links, out of itself.

    The law is that of :class:`Disc`. Of a straight link an end is always the deepest point, so links touch
    with their ends.

    Parameters
    ----------
    point : (float, float)
        A point of the edge, m.
    normal : (float, float)
        Direction out of the half-plane, towards the arm, of any length; (0, 1), a floor, by default.
    stiffness : float
        Stiffness k of the contact, N/m, positive.
    damping : float
        Damping c of the contact, s/m, not negative.
    friction : float
        Coefficient of friction mu, not negative.
    slip_speed : float
        Speed e, m/s, positive: at this speed along the edge the friction is 1/sqrt(2) of its level.
    along_links : bool
        Whether all ends of links touch the half-plane, or the tip alone.
    name : str
        Part of the name of its numbers, "half_plane_wall.friction"; several of a scene have different ones.
    """

    point: Numbers = field(metadata=pair(contact.place, "m", "m"))
    normal: Numbers = field(default=(0.0, 1.0), metadata=pair(contact.place, "1", "1"))
    stiffness: float = field(default=2e4, metadata=one(positive, "N/m"))
    damping: float = field(default=0.2, metadata=one(not_negative, "s/m"))
    friction: float = field(default=0.0, metadata=one(not_negative, "1"))
    slip_speed: float = field(default=0.05, metadata=one(positive, "m/s"))
    along_links: bool = field(default=False, metadata=checked(contact.whole_arm))
    name: str = field(default="", metadata=checked(text))

    static = ("along_links", "name")
    key = named("half_plane_")
    example = Example(
        {"point": (0.0, -0.5), "stiffness": 2000.0, "friction": 0.3},
        variants={"along links": {"along_links": True}},
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.hypot(*self.normal) < SMALLEST:
            raise ValueError(f"HalfPlane.normal is {self.normal}, no direction; give one such as (0, 1)")
        if self.point[0] * self.normal[0] + self.point[1] * self.normal[1] > 0.0:
            raise ValueError(
                f"HalfPlane.point is {self.point} m with the normal {self.normal}: it covers the base, "
                "(0, 0); give another point, or the opposite normal"
            )

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        (x, y), (nx, ny) = self.point, self.normal
        return (shapes.HalfSpace((x, y), (nx, ny)),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        points = range(0 if self.along_links else arm.num_masses - 1, arm.num_masses)
        return (*(Force(Point(k), **LAWS) for k in points), Obstacle(gap_of_link))
