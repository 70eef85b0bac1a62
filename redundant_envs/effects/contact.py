"""What contacts of an arm with obstacles have in common: their law and the checks of what is no number.

An obstacle pushes at the deepest point of the arm in it, along its outward normal, with the force of Hunt and
Crossley (1975), and rubs along its surface with regularised Coulomb friction.
"""

from collections.abc import Callable
from typing import Any

from redundant_envs.language.algebra import arguments_of, identity, maximum, physics, sqrt, where
from redundant_envs.robots.parameters import LARGEST

NUMBERS = ("stiffness", "damping", "friction", "slip_speed")  # numbers of the law


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
def pressing(depth, normal_x, normal_y, vx, vy, stiffness, damping, friction, slip_speed, side1, side2):
    pressed = depth_of_contact(depth, side1, side2)
    return push(pressed, normal_x, normal_y, vx, vy, stiffness, damping, friction, slip_speed)


@physics
def sliding_there(_, normal_x, normal_y, vx, vy, friction, side1, side2):
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
def elastic_energy(depth, normal_x, normal_y, stiffness):
    return 0.5 * stiffness * maximum(depth, 0.0) ** 2


def at_point(depth_and_normal: Callable[..., Any], law: Callable[..., Any]) -> Callable[..., Any]:
    """A law of the depth of a point and the normal there, as one of x, y and the numbers of a shape."""
    of_shape, others = arguments_of(depth_and_normal)[2:], arguments_of(law)[3:]
    motion = tuple(name for name in others if name in ("vx", "vy"))
    shape = slice(len(motion), len(motion) + len(of_shape))

    @physics(takes=("x", "y", *motion, *of_shape, *others[len(motion) :]))
    def of_point(x, y, *values):
        return law(*depth_and_normal(x, y, *values[shape]), *values[: shape.start], *values[shape.stop :])

    return of_point


def laws(depth_and_normal: Callable[..., Any]) -> dict[str, Any]:
    """Functions of the force at a point of the arm that touches a shape, by the fields of a ``Force``."""
    of_point = {
        "function": pressing, "guard": guards, "kink": sliding_there, "potential": elastic_energy,
        "conservative": elastic,
    }  # fmt: skip
    functions = {field: at_point(depth_and_normal, law) for field, law in of_point.items()}
    return {**functions, "stiffness": identity("stiffness")}


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
