"""How effects are drawn: plain shapes in metres, which every picture of a scene shows.

An effect gives them by its method ``shapes``; coordinates are those of the arm, whose base is (0, 0). Masses
that effects add, and stops of joints, are drawn without one, from their hooks.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects.numbers import fields_with
from redundant_envs.language.algebra import numbered
from redundant_envs.robots.arm import Arm
from redundant_envs.support.values import shown, with_fields

Place = tuple[float, float]
NEAR = 1.4
"""A picture shows what the arm can touch as far as this many reaches from the base: obstacles that are larger
or farther away do not shrink the arm to a dot."""


class Circle(NamedTuple):
    """A filled circle, such as an obstacle; of radius 0 a dot."""

    centre: Place
    radius: float


class HalfSpace(NamedTuple):
    """All that is beyond a straight edge, through a point and across a normal out of it."""

    point: Place
    normal: Place


class Line(NamedTuple):
    """A line through points, such as a cable; faint unless it is ``taut``."""

    points: tuple[Place, ...]
    taut: bool = True


class Load(NamedTuple):
    """A mass [kg], which the arm carries; a ring while it is not ``held``."""

    place: Place
    mass: float
    held: bool = True


class Spring(NamedTuple):
    """A spring, as a thin line through points."""

    points: tuple[Place, ...]


class Arrow(NamedTuple):
    """A force or a torque: a line with a head at its end."""

    points: tuple[Place, ...]


class Ground(NamedTuple):
    """How far the base is from where it was on the ground: a grid of dots moves instead, those add up."""

    displacement: Place


Shape = Circle | HalfSpace | Line | Load | Spring | Arrow | Ground


class Pose:
    """An arm in a pose, with the numbers of the environment that is drawn, and the states of the effect."""

    def __init__(self, arm: Arm, q: NDArray[np.float64], states: Mapping[str, float]) -> None:
        self.arm, self.q, self.states = arm, q, states

    @cached_property
    def points(self) -> list[Place]:
        """Positions of the point masses, m; the last one is the tip."""
        return [(float(x), float(y)) for x, y in self.arm.points(self.q)]

    @property
    def ends(self) -> list[Place]:
        """The base and the point masses: with a mass behind each joint, joint k is at ``ends[k]``."""
        return [(0.0, 0.0), *self.points]

    @cached_property
    def positions(self) -> list[float]:
        """Positions of the joints, rad and m."""
        known = {**self.arm.parameter_values(), **dict(zip(self.arm.coordinates, self.q, strict=True))}
        return [float(x) for x in self.arm.evaluate(numbered("phi{}", len(self.arm.joints)), known)]

    @property
    def shows_joints(self) -> bool:
        """Whether there is a point mass behind each joint."""
        return self.arm.num_masses == len(self.arm.joints)

    def moved(self, joint: int, to: Any) -> NDArray[np.float64]:
        """:attr:`ends`, (n, 1 + masses, 2), with one joint at other positions (n,)."""
        to = np.asarray(to, dtype=np.float64)
        phi = [to if k == joint else np.full(to.shape, x) for k, x in enumerate(self.positions)]
        q = np.stack(np.broadcast_arrays(*self.arm.coordinates_of_joints(*phi)), axis=-1)
        points = self.arm.points(q)
        return np.concatenate([np.zeros((len(points), 1, 2)), points], axis=1)


TURNS, COILS = 1.75, 12  # of the spring of a joint that turns, and of one that slides
THIN, WIDE = 0.025, 0.06  # radii of a spring of a joint that turns, in units of the arm's length
LONG = 2.0  # a force of this share of the arm's weight, the other way up, has an arrow as long as the arm
MOST_SWEEP = 5.0  # rad: of the arrow of a torque


def _size(arm: Arm) -> float:
    return sum(arm.lengths) or 1.0


def spring(pose: Pose, joint: int) -> tuple[Spring, ...]:
    """A spring on a joint: a spiral that the joint winds up, or coils along a slider."""
    if not pose.shows_joints or not np.isfinite(pose.q).all():
        return ()
    size, ends, at = _size(pose.arm), pose.ends, pose.positions[joint]
    if pose.arm.prismatic[joint]:
        (x, y), (dx, dy) = ends[joint], np.subtract(ends[joint + 1], ends[joint])
        length = math.hypot(dx, dy) or 1.0
        side = THIN * size / length
        share = np.linspace(0.0, 1.0, 2 * COILS + 1)
        wave = side * np.where(np.arange(len(share)) % 2, 1.0, -1.0)
        wave[[0, -1]] = 0.0
        points = np.stack([x + share * dx - wave * dy, y + share * dy + wave * dx], axis=1)
    else:
        first = _direction(pose, joint) - at
        turn = np.linspace(0.0, 1.0, 48)
        angle = first + turn * (2.0 * np.pi * TURNS + at)
        radius = size * (THIN + (WIDE - THIN) * turn)
        points = np.asarray(ends[joint]) + (radius * np.stack([np.cos(angle), np.sin(angle)])).T
    return (Spring(tuple((float(px), float(py)) for px, py in points)),)


def _direction(pose: Pose, joint: int) -> float:
    """The absolute angle of the link behind a joint."""
    (x, y), (u, v) = pose.ends[joint], pose.ends[joint + 1]
    return math.atan2(v - y, u - x)


def push(pose: Pose, force: Place) -> Arrow:
    """The arrow of a force on the tip, (x, y) [N]."""
    (x, y), scale = pose.points[-1], _length_of_newton(pose.arm)
    return Arrow(((x, y), (x + scale * force[0], y + scale * force[1])))


def twist(pose: Pose, joint: int, effort: float) -> tuple[Arrow, ...]:
    """The arrow of a torque or a force [N m or N] on a joint."""
    if not pose.shows_joints or not np.isfinite(pose.q).all():
        return ()
    arm, (x, y) = pose.arm, pose.ends[joint]
    if arm.prismatic[joint]:
        (x, y), way = pose.ends[joint + 1], _length_of_newton(arm) * effort
        angle = _direction(pose, joint)
        return (Arrow(((x, y), (x + way * math.cos(angle), y + way * math.sin(angle)))),)
    sweep = _length_of_newton(arm) * effort / (WIDE * _size(arm) ** 2)
    angles = _direction(pose, joint) + np.linspace(0.0, min(max(sweep, -MOST_SWEEP), MOST_SWEEP), 24)
    radius = 1.3 * WIDE * _size(arm)
    return (Arrow(tuple((x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles.tolist())),)


def _length_of_newton(arm: Arm) -> float:
    return LONG * _size(arm) / (9.81 * sum(arm.masses))


def shapes_of(
    effects: Iterable[tuple[Any, Mapping[str, str]]], arm: Arm, q: NDArray[np.float64],
    known: Mapping[str, float],
) -> list[Shape]:  # fmt: skip
    """Shapes of effects on an arm in a pose; ``known`` has all numbers and states of the scene, and with each
    effect are its own names of its own ones, and the names that the scene gives them."""
    all_shapes: list[Shape] = []
    for effect, names in effects:
        values = {name: known[of_scene] for name, of_scene in names.items()}
        changed = fields_with(effect, {name: values[name] for name in effect.parameters()})
        shapes = with_fields(effect, **changed).shapes(Pose(arm, q, values))
        for shape in (shapes,) if isinstance(shapes, Shape) or not isinstance(shapes, Iterable) else shapes:
            if not isinstance(shape, Shape):
                raise ValueError(
                    f"{type(effect).__name__}.shapes gives {shown(shape)}; give shapes such as "
                    "redundant_envs.effects.shapes.Circle((x, y), radius)"
                )
            all_shapes.append(shape)
    return all_shapes


def seen_with(shapes: Sequence[Shape], reach: float) -> float:
    """How far from the base a picture of an arm with this reach shows, with the obstacles near it, m."""
    seen, most = reach, NEAR * reach
    for shape in shapes:
        if isinstance(shape, Circle):
            away = math.hypot(*shape.centre)
            if away - shape.radius <= reach:
                seen = max(seen, min(away + shape.radius, most))
        elif isinstance(shape, Line):
            seen = max([seen, *(away for p in shape.points if (away := math.hypot(*p)) <= most)])
    return seen
