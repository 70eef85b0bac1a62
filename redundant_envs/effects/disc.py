import math
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

from redundant_envs.effects import contact, shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, Obstacle, Point, named
from redundant_envs.effects.numbers import Example, Numbers, checked, not_negative, one, pair, positive, text
from redundant_envs.language.algebra import arguments_of, clamp, identity, maximum, physics, sqrt

TINY = 1e-60
"""m^2: added to squares of distances, none of which it changes unless they are below 1e-22 m, so that the
centre has no normal, and a link without length no direction, but nothing divides by 0."""


@physics
def depth_and_normal(x, y, centre_x, centre_y, radius):
    """Depth of a point in the disc, negative outside, and the outward normal there."""
    dx, dy = x - centre_x, y - centre_y
    square = dx * dx + dy * dy + TINY
    inverse = 1.0 / sqrt(square)  # one division in place of two
    return radius - square * inverse, dx * inverse, dy * inverse


AT_TIP = contact.laws(depth_and_normal)


@physics
def share_of_end(xa, ya, xb, yb, centre_x, centre_y):
    """Place of the point of a link that is nearest to the centre: 0 at its near end, 1 at its far end."""
    ux, uy = xb - xa, yb - ya
    along = (centre_x - xa) * ux + (centre_y - ya) * uy
    return clamp(along / (ux * ux + uy * uy + TINY), 0.0, 1.0)


@physics
def between(share, a, b):
    return a + share * (b - a)


@physics
def force_and_place(
    xa, ya, xb, yb, vxa, vya, vxb, vyb, centre_x, centre_y, radius, stiffness, damping, friction, slip_speed
):
    """Force at the point of a link that is nearest to the centre, and the place of that."""
    s = share_of_end(xa, ya, xb, yb, centre_x, centre_y)
    vx, vy = between(s, vxa, vxb), between(s, vya, vyb)
    depth, nx, ny = depth_and_normal(between(s, xa, xb), between(s, ya, yb), centre_x, centre_y, radius)
    inside, stays = contact.guards(depth, nx, ny, vx, vy, damping)
    pressed = contact.depth_of_contact(depth, inside, stays)
    fx, fy = contact.push(pressed, nx, ny, vx, vy, stiffness, damping, friction, slip_speed)
    return fx, fy, s


@physics(takes=arguments_of(force_and_place))
def at_near_end(*values):
    fx, fy, s = force_and_place(*values)
    return (1.0 - s) * fx, (1.0 - s) * fy


@physics(takes=arguments_of(force_and_place))
def at_far_end(*values):
    """With the near share the force at the point of contact, in sum and in moment."""
    fx, fy, s = force_and_place(*values)
    return s * fx, s * fy


@physics(takes=("xb", "yb", "vxb", "vyb", "centre_x", "centre_y", "radius", *contact.NUMBERS))
def at_end_of_first(xb, yb, vxb, vyb, *values):
    """The first link begins at the base, which bears the other share."""
    return at_far_end(0.0, 0.0, xb, yb, 0.0, 0.0, vxb, vyb, *values)


@physics
def turn_of_link(xa, ya, xb, yb, vxa, vya, vxb, vyb, centre_x, centre_y, radius, damping, friction):
    """Changes its sign where the point of contact of a link begins to slide the other way."""
    s = share_of_end(xa, ya, xb, yb, centre_x, centre_y)
    vx, vy = between(s, vxa, vxb), between(s, vya, vyb)
    depth, nx, ny = depth_and_normal(between(s, xa, xb), between(s, ya, yb), centre_x, centre_y, radius)
    inside, stays = contact.guards(depth, nx, ny, vx, vy, damping)
    return contact.sliding_there(depth, nx, ny, vx, vy, friction, inside, stays)


@physics
def turn_of_first(xb, yb, vxb, vyb, centre_x, centre_y, radius, damping, friction):
    return turn_of_link(0.0, 0.0, xb, yb, 0.0, 0.0, vxb, vyb, centre_x, centre_y, radius, damping, friction)


@physics
def depth_of_link(xa, ya, xb, yb, centre_x, centre_y, radius):
    s = share_of_end(xa, ya, xb, yb, centre_x, centre_y)
    depth, _, _ = depth_and_normal(between(s, xa, xb), between(s, ya, yb), centre_x, centre_y, radius)
    return depth


@physics
def square_of_link(xa, ya, xb, yb, centre_x, centre_y):
    """Square of the distance of a link from the centre, with one reciprocal for all discs of a scene in place
    of two divisions for each: the watch of a step needs many."""
    ux, uy = xb - xa, yb - ya
    per_square = 1.0 / (ux * ux + uy * uy + TINY)
    dx, dy = xa - centre_x, ya - centre_y
    s = clamp(-(dx * ux + dy * uy) * per_square, 0.0, 1.0)
    dx, dy = dx + s * ux, dy + s * uy
    return dx * dx + dy * dy + TINY


@physics
def gap_of_square(measure, radius):
    return sqrt(measure) - radius


OBSTACLE = Obstacle(gap_of_square, measure=square_of_link)


def deepest_of(count: int) -> Any:
    """The guard of an arm with some links: the depth of its deepest point."""
    points = tuple(f"{axis}{k + 1}" for k in range(count) for axis in "xy")

    @physics(takes=("centre_x", "centre_y", "radius", *points))
    def deepest(centre_x, centre_y, radius, *xy):
        ends = (0.0, 0.0, *xy)
        depths = [depth_of_link(*ends[2 * k : 2 * k + 4], centre_x, centre_y, radius) for k in range(count)]
        return reduce(maximum, depths)

    return deepest


@dataclass(frozen=True)
class Disc(Effect):
    """A disc that pushes the tip of the arm, or its links, out of itself.

    At a depth d the force is k d (1 + c d') along the normal (Hunt and Crossley 1975, for contact along a
    line), never a pull, with friction of at most mu times that.

    Parameters
    ----------
    centre : (float, float)
        Its centre (x, y), m.
    radius : float
        Its radius, m, positive; the disc must not cover the base of the arm.
    stiffness : float
        Stiffness k of the contact, N/m, positive.
    damping : float
        Damping c of the contact, s/m, not negative.
    friction : float
        Coefficient of friction mu, not negative.
    slip_speed : float
        Speed e, m/s, positive: at this speed along the surface the friction is 1/sqrt(2) of its level.
    along_links : bool
        Whether all links touch the disc, or the tip alone.
    name : str
        Part of the name of its numbers, "disc_left.radius"; several discs of a scene have different ones.
    """

    centre: Numbers = field(metadata=pair(contact.place, "m", "m"))
    radius: float = field(metadata=one(positive, "m"))
    stiffness: float = field(default=2e4, metadata=one(positive, "N/m"))
    damping: float = field(default=0.2, metadata=one(not_negative, "s/m"))
    friction: float = field(default=0.0, metadata=one(not_negative, "1"))
    slip_speed: float = field(default=0.05, metadata=one(positive, "m/s"))
    along_links: bool = field(default=False, metadata=checked(contact.whole_arm))
    name: str = field(default="", metadata=checked(text))

    static = ("along_links", "name")
    key = named("disc_")
    example = Example(
        {"centre": (0.5, 0.4), "radius": 0.2, "stiffness": 2000.0, "friction": 0.3},
        variants={"along links": {"along_links": True}},
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_base("Disc", self.centre, self.radius)

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        x, y = self.centre
        return (shapes.Circle((x, y), self.radius),)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        at_tip = (Force(Point(arm.num_masses - 1), **AT_TIP),)
        return (*(_along_links(arm) if self.along_links else at_tip), OBSTACLE)


def check_base(kind: str, centre: Numbers, radius: float) -> None:
    """ValueError if a disc covers the base of the arm."""
    if math.hypot(*centre) <= radius:
        raise ValueError(f"{kind}.radius is {radius} m: the disc covers the base; give a smaller one")


def _along_links(arm: Arm) -> tuple[Hook, ...]:
    """Forces at both ends of each link. The one at the tip has the guard, that of the whole arm: two links
    touch a disc at the same instant where their common joint does."""
    forces = []
    for far in range(arm.num_masses):
        bind = {f"{q}b": f"{q}{far + 1}" for q in ("x", "y", "vx", "vy")}
        if far:
            bind |= {f"{q}a": f"{q}{far}" for q in ("x", "y", "vx", "vy")}
            forces.append(Force(Point(far - 1), at_near_end, bind, stiffness=identity("stiffness")))
        law, turn = (at_far_end, turn_of_link) if far else (at_end_of_first, turn_of_first)
        guard = deepest_of(arm.num_masses) if far == arm.num_masses - 1 else None
        forces.append(Force(Point(far), law, bind, stiffness=identity("stiffness"), guard=guard, kink=turn))
    return tuple(forces)
