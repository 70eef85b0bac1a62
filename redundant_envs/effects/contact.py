"""What contacts of an arm with obstacles have in common: their law and the checks of what is no number.

An obstacle pushes at the deepest point of the arm in it, along its outward normal, with the force of Hunt and
Crossley (1975), and rubs along its surface with regularised Coulomb friction.
"""

from collections.abc import Callable
from typing import Any

from redundant_envs.language.algebra import arguments_of, identity, maximum, physics, sqrt, where
from redundant_envs.robots.parameters import LARGEST

NUMBERS = ("stiffness", "damping", "friction", "slip_speed")
"""Numbers of the law."""


@physics
def guards(depth, normal_x, normal_y, vx, vy, damping):
    """Positive where a point is inside, and where it does not leave so fast that it would be pulled. Both are
    located: where a contact that was lost inside ends, the elastic part of the force ends."""
    return depth, 1.0 - damping * (vx * normal_x + vy * normal_y)


@physics
def depth_of_contact(depth, inside, stays):
    """The depth of a point that presses; 0 without contact. ``inside`` and ``stays`` are positive or not."""
    return where(inside > 0.0, where(stays > 0.0, depth, 0.0), 0.0)


@physics
def push(depth, normal_x, normal_y, vx, vy, stiffness, damping, friction, slip_speed):
    """Force on a point that presses: F = k d (1 + c d') along the normal, and friction of at most mu F."""
    leaving, sliding = vx * normal_x + vy * normal_y, vy * normal_x - vx * normal_y
    normal = stiffness * depth * (1.0 - damping * leaving)
    rubbing = -friction * normal * sliding / sqrt(sliding * sliding + slip_speed * slip_speed)
    return normal * normal_x - rubbing * normal_y, normal * normal_y + rubbing * normal_x


@physics
def sliding_there(normal_x, normal_y, vx, vy, friction, side1, side2):
    """Changes its sign where a point that presses, and rubs, begins to slide the other way. Friction changes
    steeply there, and error estimates see less than that."""
    sliding = where(side1 > 0.0, where(side2 > 0.0, vy * normal_x - vx * normal_y, 1.0), 1.0)
    return where(friction > 0.0, sliding, 1.0)


@physics
def elastic(depth, normal_x, normal_y, stiffness):
    """The part of the force that has a potential."""
    spring = stiffness * maximum(depth, 0.0)
    return spring * normal_x, spring * normal_y


@physics
def elastic_energy(depth, stiffness):
    return 0.5 * stiffness * maximum(depth, 0.0) ** 2


def laws(depth_and_normal: Callable[..., Any]) -> dict[str, Any]:
    """Functions of the force at a point of the arm that touches a shape, by the fields of a ``Force``; the
    depth of the point and the normal there follow from x, y and the numbers of the shape."""
    of_shape = arguments_of(depth_and_normal)[2:]
    place, motion = ("x", "y", *of_shape), ("x", "y", "vx", "vy", *of_shape)

    @physics(takes=(*motion, *NUMBERS, "side1", "side2"))
    def force(x, y, vx, vy, *values):
        shape, (*numbers, side1, side2) = values[: len(of_shape)], values[len(of_shape) :]
        depth, nx, ny = depth_and_normal(x, y, *shape)
        return push(depth_of_contact(depth, side1, side2), nx, ny, vx, vy, *numbers)

    @physics(takes=(*motion, "damping"))
    def touches(x, y, vx, vy, *values):
        *shape, damping = values
        return guards(*depth_and_normal(x, y, *shape), vx, vy, damping)

    @physics(takes=(*motion, "friction", "side1", "side2"))
    def turn(x, y, vx, vy, *values):
        *shape, friction, side1, side2 = values
        _, nx, ny = depth_and_normal(x, y, *shape)
        return sliding_there(nx, ny, vx, vy, friction, side1, side2)

    @physics(takes=(*place, "stiffness"))
    def spring(x, y, *values):
        *shape, stiffness = values
        return elastic(*depth_and_normal(x, y, *shape), stiffness)

    @physics(takes=(*place, "stiffness"))
    def energy(x, y, *values):
        *shape, stiffness = values
        depth, _, _ = depth_and_normal(x, y, *shape)
        return elastic_energy(depth, stiffness)

    return {
        "function": force, "guard": touches, "kink": turn, "potential": energy, "conservative": spring,
        "stiffness": identity("stiffness"),
    }  # fmt: skip


def whole_arm(field: str, value: Any) -> bool:
    """Whether all links touch an obstacle, or the tip alone."""
    if not isinstance(value, bool):
        raise ValueError(f"{field} is {value!r:.80}; give false, for the tip alone, or true")
    return value


def place(field: str, value: tuple[float, float]) -> tuple[float, float]:
    """A point or a direction whose products with others are finite."""
    if max(map(abs, value)) > LARGEST:
        raise ValueError(f"{field} is {value}; it must lie in {-LARGEST:g} to {LARGEST:g}")
    return value
