"""How an effect attaches to an arm: a closed list of hooks, bound by the names of quantities.

An effect is a frozen dataclass whose numbers are per-environment parameters, plus marked functions
of the physics dialect. ``hooks(arm)`` says where they attach. In ``bind`` an argument of the
function is mapped to the name of a quantity, or to one of the effect's own numbers or states as ".field"
or ".field[k]"; an argument that is not mapped takes the quantity of its own name.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from redundant_envs.robots.arm import Arm


@dataclass(frozen=True)
class State:
    """A number of an effect that changes with the motion: saved, restored and reset as coordinates are.

    Parameters
    ----------
    name : str
        "name" or "name[k]"; the effect's functions bind it as ".name".
    unit : str
    derivative : function, optional
        Its rate of change: it is integrated beside the arm's states.
    update : function, optional
        Its value after a control interval, from the quantities at the interval's end; within the interval
        it is constant. Give this or ``derivative``.
    bind : mapping
    initial : float
        At the start of an episode or a motion.
    rate : function, optional
        Largest change of the derivative per change of the state [1/s], from the parameters alone: error
        control takes steps that are short enough for it.
    """

    name: str
    unit: str
    derivative: Callable[..., Any] | None = None
    update: Callable[..., Any] | None = None
    bind: Mapping[str, str] = field(default_factory=dict)
    initial: float = 0.0
    rate: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Field:
    """A uniform field: the function of parameters returns (ax, ay), minus the gravity vector [m/s^2]."""

    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Point:
    """A point mass of the arm, counted from 0; the last one is the tip."""

    number: int


SIDE = "side"
"""Argument of a force's functions that tells which of its laws holds."""


@dataclass(frozen=True)
class Force:
    """A force on one joint, N m on a revolute joint and N on a prismatic one, or at a :class:`Point`.

    At a point the function returns (fx, fy) [N]; it may depend on the point's position, such as x4, y4, and
    velocity, vx4, vy4 (these count from 1).

    ``conservative`` is the part of it that is minus the derivative of ``potential`` [J] with respect
    to the position of the joint or the point: it is booked in the potential energy, the power of the rest
    as work.
    With a potential and nothing else said it is the whole force, which then may depend on the position
    alone. A force without a potential is all booked as work. ``python -m redundant_envs verify``
    differentiates the potential and compares.

    ``stiffness`` [N/m or N m/rad] and ``damping`` [N s/m or N m s/rad] give the largest that the
    force can have, from the parameters alone: error control takes steps short enough for a spring
    before an estimate could have seen it. They are derivatives of the force, by its position at rest and
    by its rate; ``verify`` differentiates it and compares. A force with a ``damping`` brakes: one that
    drives gives none, or is an :class:`Actuation`. The damping of a force on a joint may depend on
    ``phi<k>`` and ``phid<k>`` of that joint, too, where it is not the same everywhere.

    ``states`` belong to the force: friction with memory has one for each joint.

    ``switch`` names two of the effect's numbers, (".lower", ".upper"): positions of the joint at which the
    law of the force changes, as that of a spring at the end of a joint's travel. Its functions then may take
    ``side``: 1 above the upper, -1 below the lower, 0 between. Where steps are chosen for their error, none
    has two laws in it: the change is located in time, as an impact is. So each law must be smooth beyond its
    own positions, too, and both must give the same force where they meet.

    Other kinks are found in what the function computes of what moves (comparisons, ``abs``, ``minimum``,
    ``maximum``, ``where``, ``floor``): an interval that may have one has to come out the same with half as
    many steps. ``kink`` is a function that changes its sign at one that the function does not show, or in
    place of one that it shows: it stands for all that ``where`` chooses from in it.
    """

    joint: int | Point
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    potential: Callable[..., Any] | None = None
    conservative: Callable[..., Any] | None = None
    stiffness: Callable[..., Any] | None = None
    damping: Callable[..., Any] | None = None
    states: tuple[State, ...] = ()
    switch: tuple[str, str] | None = None
    kink: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if self.potential is not None and self.conservative is None:
            object.__setattr__(self, "conservative", self.function)

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the velocities along which it acts: of the joint, or of the point."""
        if isinstance(self.joint, Point):
            return f"vx{self.joint.number + 1}", f"vy{self.joint.number + 1}"
        return (f"phid{self.joint + 1}",)


class Link(enum.IntEnum):
    """Where an effect stands in the chain from the command of a motor to its effort."""

    DELAY = 0
    DEAD_ZONE = 1
    LAG = 2
    TORQUE_SPEED = 3
    LIMITS = 4


@dataclass(frozen=True)
class Actuation:
    """Maps the effort that reaches a link in the chain of one motor to the effort that leaves it.

    In ``function``, and in the functions of ``states``, ``command<k>`` (k counts from 1) is what reaches the
    link. Links act in the order of :class:`Link`, those of one kind in the order of the scene's effects.

    Kinks, and ``kink``, are those of :class:`Force`, where a rate or a state comes before them in the chain.
    """

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    link: Link = Link.LIMITS
    states: tuple[State, ...] = ()
    kink: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Impact:
    """Hard ends of the travel of a prismatic joint; their numbers are own fields (".lower[0]")."""

    joint: int
    lower: str
    upper: str
    restitution: str


@dataclass(frozen=True)
class PointMass:
    """A mass that moves with a point mass of the arm: its number is a field of the effect (".mass"), kg."""

    point: Point
    mass: str


@dataclass(frozen=True)
class Inertia:
    """An inertia that resists a change of a joint's rate, or of the sum of some joints' rates.

    A motor's rotor resists that of its joint, in kg m^2 (kg of a slider), gears squared. A link's inertia
    about its point mass, where its centre of mass then is, resists that of its absolute angle: of all
    revolute joints up to it. The number is a field of the effect (".inertias[0]"), at most a million times
    the lightest mass on the shortest link.
    """

    joints: tuple[int, ...]
    inertia: str


class Reading(enum.Enum):
    """What a sensor of a joint reads."""

    POSITION = "phi{}"
    RATE = "phid{}"


@dataclass(frozen=True)
class Sensing:
    """What the sensor of one joint reads, rad and rad/s, m and m/s; observed postures follow from it.

    In ``function`` ``phi<k>``, or ``phid<k>`` of a rate (k counts from 1), is what reaches the sensor; those
    of one joint act in the order of the scene's effects. All else is true: motion, reward, ``info``, a task's
    memory, and the goals beside the observation of goal environments. A reading that is no number, or beyond
    1e6 rad or m, 1e100 rad/s or m/s, is a fault (NON_FINITE), at a start told by ``info`` alone.
    """

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    reading: Reading = Reading.POSITION


Hook = Field | Force | Actuation | Impact | PointMass | Inertia | Sensing


@dataclass(frozen=True)
class Effect:
    """Base of all effects.

    A subclass validates its numbers in ``__post_init__`` and gives ``hooks``. Its class name is
    its name in scene files; ``key`` is its name in parameters ("limit_spring.r1").
    """

    static: ClassVar[tuple[str, ...]] = ()
    """Fields that choose the structure; all others are per-environment numbers."""
    of_joints: ClassVar[tuple[str, ...]] = ()
    """Fields with a number for each joint; a single number serves all of them."""

    def __init_subclass__(cls) -> None:
        """Refuse numbers with the names of what every effect has."""
        super().__init_subclass__()
        for name, annotation in inspect.get_annotations(cls).items():
            if hasattr(Effect, name) and "ClassVar" not in str(annotation):
                raise ValueError(f"{cls.__name__} has a number {name!r}, as every effect has; rename it")

    @property
    def key(self) -> str:
        """Name of this effect in parameter names."""
        return snake_case(type(self).__name__)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        """Where the effect attaches to an arm; ValueError if it does not fit."""
        raise NotImplementedError(
            f"{type(self).__name__} does not say where it attaches; write a method hooks(self, arm)"
        )

    def fitted(self, arm: Arm) -> Effect:
        """The effect as a scene with this arm has it: plain numbers, and one for each joint."""
        count, changed = len(arm.joints), {}
        for f in dataclasses.fields(self):
            given = getattr(self, f.name)
            value = _of_python(given, static=f.name in self.static)
            if f.name in self.of_joints:
                wide = hasattr(value, "__len__") and not isinstance(value, str | bytes)
                value = tuple(value) if wide else (value,) * count
                if len(value) != count:
                    raise ValueError(
                        f"{type(self).__name__}.{f.name} has {len(value)} entries; {arm.kind} has {count} "
                        f"joints: give {count} numbers, or one for all"
                    )
            if value is not given and f.init:
                changed[f.name] = value
        return dataclasses.replace(self, **changed) if changed else self

    def states(self, arm: Arm) -> dict[str, State]:
        """Its states by their names."""
        found = [s for h in self.hooks(arm) if isinstance(h, Force | Actuation) for s in h.states]
        return {s.name: s for s in found}

    def travel(self, arm: Arm) -> dict[int, tuple[str, str]]:
        """Joints this effect limits: joint -> own fields of the lower and the upper limit.

        Those of its impacts that have both ends; an effect that limits joints by forces gives its own.
        """
        numbers = self.parameters()
        ends = {h.joint: (h.lower[1:], h.upper[1:]) for h in self.hooks(arm) if isinstance(h, Impact)}
        return {k: names for k, names in ends.items() if all(math.isfinite(numbers[name]) for name in names)}

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        """Own numbers in units of which an environment takes its actions, one for each motor; () if none."""
        return ()

    def parameters(self) -> dict[str, float]:
        """The effect's numbers: "field" or "field[k]" -> value."""
        values: dict[str, float] = {}
        for f in dataclasses.fields(self):
            if f.name in self.static:
                continue
            value = getattr(self, f.name)
            if isinstance(value, tuple):
                values.update({f"{f.name}[{k}]": v for k, v in enumerate(value)})
            else:
                values[f.name] = value
        return values


def _of_python(value: Any, static: bool) -> Any:
    """Numbers of NumPy as Python's own: floats, unless they are static; a row of them as a tuple."""
    if isinstance(value, tuple):
        plain = tuple(_of_python(v, static) for v in value)
        return value if all(a is b for a, b in zip(plain, value, strict=True)) else plain
    if getattr(getattr(value, "dtype", None), "kind", "") not in ("i", "u", "f"):
        return value
    if value.ndim:
        return tuple(_of_python(v, static) for v in value)
    return value.item() if static else float(value)


def snake_case(name: str) -> str:
    """LimitSpring -> limit_spring."""
    return "".join("_" + c.lower() if c.isupper() else c for c in name).lstrip("_")
