"""How an effect attaches to an arm: a closed list of hooks, bound by the names of quantities.

An effect is a frozen dataclass whose numbers are per-environment parameters, plus marked functions
of the physics dialect. ``hooks(arm)`` says where they attach; :class:`Effect` says what ``bind`` is.
"""

import dataclasses
import enum
import functools
import inspect
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from redundant_envs.effects.numbers import COORDINATE, DECLARED, Declared, declared_in
from redundant_envs.effects.shapes import Pose, Shape
from redundant_envs.robots.arm import Arm as Arm

# Arguments of functions that are no quantities of the arm.
ELAPSED, PASSED, CONTROL_DT, SIDE, SPEED = "elapsed", "passed", "control_dt", "side", "speed"
ENDS_OF_LINK, MEASURE = ("xa", "ya", "xb", "yb"), "measure"  # in functions of an obstacle
WHEN = "interval", "instant"
MAX_INSTANTS = 4
"""Most instants in a scene: each adds a piece to every interval."""
MAX_GUARDS, MAX_KINKS = 4, 2
"""Most values of the guard of one hook, of which its functions have as many sides, and of its ``kink``."""


def sides(count: int) -> list[str]:
    """Arguments that are the sides of a guard with some values: "side", or "side1", "side2", ..."""
    return [SIDE] if count == 1 else [f"{SIDE}{k + 1}" for k in range(count)]


@dataclass(frozen=True)
class State:
    """A number of an effect that changes with the motion; it is saved, restored and reset like coordinates.

    Its ``name`` is "name" or "name[k]"; it has a ``unit``. Either ``derivative`` is its rate of change, or
    ``update`` is its value after a control interval, from the quantities at the interval's end, and it is
    constant within the interval. ``rate`` is the largest change of the derivative per change of the state
    [1/s], from the parameters alone: error control takes steps that are short enough for it. ``initial`` is
    its value at the start of a motion: a number, or a function of parameters and of the motion there.

    ``update`` and ``initial`` may take draws: ``uniform1``, ``uniform2``, ... in (0, 1), and ``normal1``,
    ``normal2``, ... of the standard normal distribution. They follow from the key of the lane's episode, the
    number of the interval, the effect's key and the state's name alone, and are different for others.

    ``closed`` is the value of a state with a derivative after a time ``elapsed`` [s], from its value before
    and quantities that are taken as constant. Fixed steps evaluate it in place of the derivative, so they may
    be longer than the state's time constant. Quantities that change in a step are taken at its stages; with a
    ``rate``, which then is that of its decay, so much earlier that the state has the right delay.

    With ``when="instant"`` the update takes place at the :class:`Instant` of the effect, from the quantities
    there, with ``passed`` 0; in an interval without the instant the state stays.
    """

    name: str
    unit: str
    derivative: Callable[..., Any] | None = None
    update: Callable[..., Any] | None = None
    bind: Mapping[str, str] = field(default_factory=dict)
    initial: float | Callable[..., Any] = 0.0
    rate: Callable[..., Any] | None = None
    closed: Callable[..., Any] | None = None
    when: str = "interval"


@dataclass(frozen=True)
class Instant:
    """A time within each control interval at which something of the effect changes; at most one per effect.

    ``after`` gives it in seconds from the start of the interval, from parameters and ``control_dt`` alone.
    The interval is crossed in two pieces that meet there, and share the tolerance. Functions of the effect
    then may take ``passed``: 0 before the instant, 1 from then on; states of the effect may be updated there.

    A time that is negative, not below the length of the interval, or no number does not happen in it. A time
    of 0 is the start of the interval, and adds no step.
    """

    after: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Field:
    """A uniform field: the function returns (ax, ay), minus the gravity vector [m/s^2]; those of a scene add.

    A function of parameters alone is a field with a potential. One that takes ``states`` of the effect, such
    as the acceleration of a moving base, changes with time, and its power counts as work.
    """

    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    states: tuple[State, ...] = ()


@dataclass(frozen=True)
class Point:
    """A point mass of the arm, counted from 0; the last one is the tip."""

    number: int


class _Acting:
    """What acts on a joint or at a point."""

    joint: int | Point

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the velocities along which it acts: of the joint, or of the point."""
        if isinstance(self.joint, Point):
            return f"vx{self.joint.number + 1}", f"vy{self.joint.number + 1}"
        return (f"phid{self.joint + 1}",)


@dataclass(frozen=True)
class Force(_Acting):
    """A force on one joint, N m on a revolute joint and N on a prismatic one, or at a :class:`Point`.

    At a point the function returns (fx, fy) [N]. ``states`` belong to the force, such as those of a friction
    with memory.

    ``conservative`` is the part of it that is minus the derivative of ``potential`` [J] by the position of
    the joint or the point: it counts as potential energy, and the power of the rest as work. By default, with
    a potential, it is the whole force, which then may depend on the position alone.

    ``stiffness`` [N/m or N m/rad] and ``damping`` [N s/m or N m s/rad] are the largest derivatives of the
    force, by the position at rest and by the rate, from the parameters alone: error control takes steps short
    enough for them before an estimate could have seen them. A force with a ``damping`` must brake. The
    damping of a force on a joint may depend on ``phi<k>`` and ``phid<k>`` of that joint, too.

    ``switch`` names two of the effect's numbers, (".lower", ".upper"): positions of the joint at which the
    law of the force changes. Its functions then may take ``side``: 1 above the upper, -1 below the lower, 0
    between. Under error control no step contains two laws: the change is located in time, as an impact is. So
    each law must be smooth beyond its own positions, too, and both must give the same force where they meet.

    ``guard`` is the same for a law that changes where a function of positions, rates, states and commands
    changes its sign: ``side`` is 1 where it is positive or 0, and -1 where it is negative. A guard may return
    up to four values; then there are ``side1``, ``side2``, ... Each law, and the guard, must be smooth beyond
    its own range. With fixed steps the sign at each stage selects the law.

    Other kinks are found by running the function on numbers that know whether they move (comparisons,
    ``abs``, ``minimum``, ``maximum``, ``where``, ``floor``): an interval that may have one has to give the
    same result with half as many steps. ``kink`` is a function that changes its sign at a kink that the
    function does not show, or that replaces those of the values that ``where`` chooses from in it. It may
    return two values, such as those at both ends of a narrow range in which a smooth law bends.
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
    guard: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if self.potential is not None and self.conservative is None:
            object.__setattr__(self, "conservative", self.function)

    @property
    def motion(self) -> tuple[str, str]:
        """Names of the position and the rate of its joint."""
        assert isinstance(self.joint, int)
        return f"phi{self.joint + 1}", f"phid{self.joint + 1}"


class Link(enum.IntEnum):
    """Position of an effect in the chain from the command of a motor to its effort."""

    DELAY = 0
    CONTROL = 1
    DEAD_ZONE = 2
    LAG = 3
    TORQUE_SPEED = 4
    LIMITS = 5
    GEAR = 6
    JOINT = 7


@dataclass(frozen=True)
class Actuation:
    """Maps the effort that reaches a link in the chain of a joint's motor to the effort that leaves it.

    In its functions, and in those of ``states``, ``command<k>`` (k counts from 1) is the input of the link.
    Links act in the order of :class:`Link`, those of one kind in the order of the scene's effects.

    A link hands on the unit of its command, which is an effort (N m or N), unless it ``takes`` another one,
    such as "V". Then what leaves it is an effort, or ``gives`` yet another unit. The command of a motor has
    the unit that the first of these links takes. A chain whose units do not meet is refused.

    Kinks, ``kink`` and ``guard`` are as in :class:`Force`. With ``by_side`` the guard counts only under error
    control, and only where the command of the link changes within an interval: then ``by_side``, which may
    take ``side``, stands for ``function``, which takes none, so that other scenes do not pay for the guard.
    """

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    link: Link = Link.LIMITS
    states: tuple[State, ...] = ()
    kink: Callable[..., Any] | None = None
    guard: Callable[..., Any] | None = None
    by_side: Callable[..., Any] | None = None
    takes: str = ""
    gives: str = ""


@dataclass(frozen=True)
class Friction:
    """Dry friction in a joint: a set-valued force that holds the joint as long as that takes no more than its
    limit, and that opposes its rate with the limit while it moves.

    ``limit`` gives the largest force [N m or N], not negative, from parameters, states of its effect with an
    ``update``, and ``speed``, the size of the rate of the joint; at 0 it is that of static friction. A joint
    that sticks has the rate 0 exactly. When joints stick and slip is located in time, with every integrator.
    Limits in one joint add up. A joint whose limit takes no ``speed`` and is 0, such as that of an open
    brake, moves as without friction. ``lock``, of parameters and states, is positive where the joint, once it
    sticks, is held whatever that takes, by impulses, too.
    """

    joint: int
    limit: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    lock: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Impact:
    """Hard ends of the travel of a joint, ``lower`` and ``upper`` [m, or rad of a revolute one], and the
    ``restitution`` there: fields of the effect (".lower[0]"). The impulse acts along the joint alone."""

    joint: int
    lower: str
    upper: str
    restitution: str


@dataclass(frozen=True)
class Gap:
    """A stop where a function of the motion is 0: the arm moves where it is positive.

    ``function`` gives the gap [m] from quantities of the pose, such as tip_x, and numbers of the effect; dual
    numbers differentiate it twice, so it must be smooth beyond 0, too. The impulse of impacts acts along the
    gradient of the gap, without friction, and ``restitution`` names a number of the effect. The stop holds
    nothing: a pressed arm bounces, and an interval with more than 256 impacts is given up with a fault.
    """

    function: Callable[..., Any]
    restitution: str
    bind: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Impulse(_Acting):
    """An impulse at the start of each control interval, on a joint [N m s or N s] or at a :class:`Point`.

    The function returns it, at a point as (px, py) [N s], from quantities at the end of the interval before,
    states of its effect and the new commands; 0 changes nothing. The velocities jump by M^-1 J^T p, and the
    energy that it gives counts as work. A slider at rest that an impulse sends into its stop strikes it.

    With ``when="instant"`` it acts at the :class:`Instant` of its effect instead, from the quantities there,
    with ``passed`` 0; in an interval without the instant it does not act.
    """

    joint: int | Point
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    states: tuple[State, ...] = ()
    when: str = "interval"


@dataclass(frozen=True)
class PointMass:
    """A mass that moves with a point mass of the arm: its number is a field of the effect (".mass"), kg.

    The number may be one of the ``states`` of the effect that have an ``update`` and are never negative.
    Where it grows, an object at rest in the plane joins the point, and the velocities of the arm jump so that
    M qd stays the same; where it becomes less, an object leaves with the velocity of the point, and the arm
    moves on as before. The energy that comes and goes counts as work.
    """

    point: Point
    mass: str
    states: tuple[State, ...] = ()


@dataclass(frozen=True)
class Inertia:
    """An inertia that resists a change of a joint's rate, or of the sum of some joints' rates.

    A motor's rotor resists the rate of its joint, in kg m^2 (kg for a slider), times the gear ratio squared.
    A link's inertia about its point mass, which then is its centre of mass, resists the rate of its absolute
    angle: the sum over all revolute joints up to it. The number is a field of the effect (".inertias[0]"), at
    most a million times the lightest mass on the shortest link.
    """

    joints: tuple[int, ...]
    inertia: str


class Reading(enum.Enum):
    """The quantity of a joint that a sensor measures."""

    POSITION = "phi{}"
    RATE = "phid{}"


@dataclass(frozen=True)
class Sensing:
    """The reading of the sensor of one joint, rad and rad/s, m and m/s; observed postures follow from it.

    In ``function`` ``phi<k>``, or ``phid<k>`` of a rate (k counts from 1), is what reaches the sensor; those
    of one joint act in the order of the scene's effects. All else is true: motion, reward, ``info``, a task's
    memory, and the goals beside the observation of goal environments. A reading that is no number, or beyond
    1e6 rad or m, 1e100 rad/s or m/s, is a fault (NON_FINITE), at a start reported by ``info`` alone.

    ``states`` belong to the sensor, such as its noise or what it read before. They have an ``update``, which
    is computed at the end of an interval, before the observation, one sensor after the other: in it
    ``phi<k>`` is what reaches the sensor at that instant. In their ``initial`` it is what reaches it at the
    start.
    """

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    reading: Reading = Reading.POSITION
    states: tuple[State, ...] = ()


@dataclass(frozen=True)
class Obstacle:
    """Something that the arm may come near. It acts on nothing: tasks and controllers ask how far it is.

    ``gap`` gives the least distance of a straight link from it [m], negative where the link is inside, from
    the ends of the link, ``xa, ya, xb, yb``, and from numbers of the effect. The obstacles of a scene are
    counted from 1, in the order of its effects. For obstacle k a task may take ``clearance<k>``, the gap of
    the nearest link; ``clearance<k>_<j>``, that of link j from the base; and after a control step
    ``closest<k>``, the least clearance within it.

    A gap with a kink where a link passes, like the distance from a point, comes of a ``measure``: that takes
    the ends of the link, is smooth and grows with the gap, like the square of the distance, and ``gap`` takes
    its value, as ``measure``. Its least value within a step is sought.
    """

    gap: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    measure: Callable[..., Any] | None = None


Hook = (
    Field | Force | Impulse | Actuation | Friction | Impact | Gap | PointMass | Inertia | Sensing | Instant
    | Obstacle
)  # fmt: skip


def states_of(hook: Any) -> tuple[State, ...]:
    """The states of a hook."""
    return getattr(hook, "states", ())


def functions_of(part: Any) -> dict[str, Callable[..., Any]]:
    """The functions of a hook or a state by their fields, such as "damping"."""
    values = {f.name: getattr(part, f.name) for f in dataclasses.fields(part)}
    return {name: value for name, value in values.items() if callable(value)}


OF_JOINT = {"position": "phi{}", "rate": "phid{}", "command": "command{}"}
OF_POINT = "x", "y", "vx", "vy"
AXES = {"_x": "[0]", "_y": "[1]"}


def source_of(argument: str, part: Any, hook: Any, names: Collection[str]) -> Any:
    """What an argument of a function of a hook, or of a state of it, takes, as :class:`Effect` says;
    ``names`` has the numbers and states of the effect."""
    place: Any = getattr(hook, "joint", None)
    if argument in part.bind or argument in names:
        return part.bind.get(argument, f".{argument}")
    of_state = "".join(part.name.partition("[")[1:]) if isinstance(part, State) else ""
    axis = f"{argument[:-2]}{AXES.get(argument[-2:])}"
    for name in (f"{argument}{of_state}", f"{argument}[{place}]", axis):
        if name in names:
            return f".{name}"
    if isinstance(hook, Sensing) and argument == "reading":
        return hook.reading.value.format(place + 1)
    if isinstance(place, Point):
        return f"{argument}{place.number + 1}" if argument in OF_POINT else argument
    return OF_JOINT[argument].format(place + 1) if place is not None and argument in OF_JOINT else argument


@dataclass(frozen=True)
class Effect:
    """Base of all effects; docs/extending.md has a complete one.

    A subclass validates its numbers in ``__post_init__``, unless they are declared with their checks (see
    :mod:`redundant_envs.effects.numbers`), and defines ``hooks``. Its class name is its name in scene files;
    ``key`` is its name in parameters ("limit_spring.r1").

    In the ``bind`` of a hook an argument of its functions is mapped to the name of a quantity, or to one of
    the effect's own numbers or states as ".field" or ".field[k]". An argument that is not mapped takes the
    own number or state of its name, with the index of the state or of the hook's joint, and for ``name_x``
    and ``name_y`` those of ``name``; ``position``, ``rate`` or ``command`` of the joint; ``x``, ``y``, ``vx``
    or ``vy`` of the point; the ``reading`` that reaches the sensor; or the quantity of its name. A name that
    is both an own one and that of a quantity has to be mapped.
    ``control_dt`` is the control interval of the scene [s], also while a simulator advances by less.

    Numbers whose default is None are absent unless they are given: a lane has no memory for them, and none of
    the effect's hooks may name them.

    Attributes
    ----------
    static : tuple of str, default ()
        Fields that choose the structure; all others are per-environment numbers.
    of_joints : tuple of str, default ()
        Fields with a number for each joint; a single number serves all of them.
    """

    static: ClassVar[tuple[str, ...]] = ()
    of_joints: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name, annotation in inspect.get_annotations(cls).items():
            if hasattr(Effect, name) and "ClassVar" not in str(annotation):
                raise ValueError(f"{cls.__name__} has a number {name!r}, as every effect has; rename it")
            default = vars(cls).get(name)
            declared = default.metadata.get(DECLARED) if isinstance(default, dataclasses.Field) else None
            if declared and declared.of_joints:
                cls.of_joints = (*cls.of_joints, name)

    def __post_init__(self, *args: Any) -> None:
        for name, declared in self.__declared().items():
            called = f"{type(self).__name__}.{name}"
            object.__setattr__(self, name, declared.check(called, declared.form(called, getattr(self, name))))
        if (following := getattr(super(), "__post_init__", None)) is not None:  # of another base class
            following(*args)

    def __present(self) -> Iterator[tuple[dataclasses.Field[Any], Any]]:
        """Its fields with their values, but for numbers that are left out, as their default None allows."""
        values = ((f, getattr(self, f.name)) for f in dataclasses.fields(self))
        return ((f, value) for f, value in values if value is not None or f.default is not None)

    def __declared(self) -> dict[str, Declared]:
        declared = {f.name: declared_in(type(self), f.name) for f, _ in self.__present()}
        return {name: entry for name, entry in declared.items() if entry is not None}

    @property
    def key(self) -> str:
        """Name of this effect in parameter names."""
        return snake_case(type(self).__name__)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        """Where the effect attaches to an arm; ValueError if it does not fit."""
        kind = type(self).__name__
        raise NotImplementedError(f"{kind} does not say where it attaches; write a method hooks(self, arm)")

    def fitted(self, arm: Arm) -> "Effect":
        """The effect as a scene with this arm has it: plain numbers, and one for each joint."""
        count, changed = len(arm.joints), {}
        for f, raw in self.__present():
            value = _of_python(raw, static=f.name in self.static)
            if f.name in self.of_joints:
                wide = hasattr(value, "__len__") and not isinstance(value, str | bytes)
                value = tuple(value) if wide else (value,) * count
                if len(value) != count:
                    raise ValueError(
                        f"{type(self).__name__}.{f.name} has {len(value)} entries; {arm.kind} has {count} "
                        f"joints: give {count} numbers, or one for all"
                    )
            if value is not raw and f.init:
                changed[f.name] = value
        return dataclasses.replace(self, **changed) if changed else self

    def at_interval(self, control_dt: float) -> "Effect":
        """The effect as a scene with this control interval [s] has it. An effect whose number of states
        depends on the interval overrides this; functions take ``control_dt`` as an argument instead."""
        return self

    def states(self, arm: Arm) -> dict[str, State]:
        """Its states by their names."""
        return {s.name: s for h in self.hooks(arm) for s in states_of(h)}

    def travel(self, arm: Arm) -> dict[int, tuple[str, str]]:
        """Joints this effect limits: joint -> own fields of the lower and the upper limit. These are its
        impacts with both ends; an effect that limits joints by forces overrides this."""
        numbers = self.parameters()
        ends = {h.joint: (h.lower[1:], h.upper[1:]) for h in self.hooks(arm) if isinstance(h, Impact)}
        return {k: names for k, names in ends.items() if all(math.isfinite(numbers[name]) for name in names)}

    def shapes(self, pose: Pose) -> Iterable[Shape]:
        """What a picture shows of the effect, from :mod:`redundant_envs.effects.shapes`; nothing by default.

        Its numbers here are those of the environment that is drawn. Masses that it adds, and stops, need no
        shapes.
        """
        return ()

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        """Own numbers in units of which an environment takes its actions, one for each command; () if none.

        They have the unit of the command that reaches the effect's links. If several effects of a scene give
        such numbers, those of the effect whose links come first in the chains are used.
        """
        return ()

    def effort_units(self, arm: Arm) -> tuple[str, ...]:
        """Own numbers in units of which a mode of actions counts the efforts that leave its links, one for
        each joint; () of all other effects. Rewards and pictures show these efforts in place of actions."""
        return ()

    def taken_per_effort(self, arm: Arm) -> tuple[float, ...]:
        """What the motors need for an effort of 1 at rest, of an effect whose links take no effort; else
        ()."""
        return ()

    def shared_commands(self, arm: Arm) -> tuple[str, ...]:
        """Units of the commands that its links at all joints share, at most one for each joint; () if each
        motor has a command of its own. Their functions take them as ``command1``, ``command2``, ...; links in
        front of them act on these commands, and those behind them on the efforts of the motors."""
        return ()

    def units(self, arm: Arm) -> dict[str, str]:
        """Known units of its numbers, "field" or "field[k]" -> unit: those that are declared; of masses,
        inertias and ends of travel they follow from the hooks. An effect gives its others."""
        units: dict[str, str] = {}
        for name, declared in self.__declared().items():
            if len(declared.units) == 1:
                units[name] = declared.units[0]
            elif declared.of_joints and declared.units:
                units |= {f"{name}[{k}]": declared.units[slides] for k, slides in enumerate(arm.prismatic)}
            elif isinstance(getattr(self, name), tuple):
                units |= {f"{name}[{k}]": unit for k, unit in enumerate(declared.units)}
            elif declared.units:
                units[name] = declared.units[arm.prismatic[arm.joint_index(getattr(self, COORDINATE))]]
        known, fields = ({name.partition("[")[0] for name in names} for names in (units, self.parameters()))
        for hook in self.hooks(arm) if fields - known else ():
            if isinstance(hook, PointMass) and hook.mass[1:] in self.parameters():
                units[hook.mass[1:]] = "kg"
            elif isinstance(hook, Inertia):
                units[hook.inertia[1:]] = "kg" if arm.prismatic[hook.joints[0]] else "kg m^2"
            elif isinstance(hook, Impact):
                unit = "m" if arm.prismatic[hook.joint] else "rad"
                units |= dict.fromkeys((hook.lower[1:], hook.upper[1:]), unit)
        return units

    def parameters(self) -> dict[str, float]:
        """The effect's numbers: "field" or "field[k]" -> value."""
        values: dict[str, float] = {}
        for f, value in self.__present():
            if f.name in self.static:
                continue
            if isinstance(value, tuple):
                values |= {f"{f.name}[{k}]": entry for k, entry in enumerate(value)}
            else:
                values[f.name] = value
        return values


def at_each_joint(hook_at: Callable[[Any, int, Arm], Hook]) -> Callable[[Any, Arm], tuple[Hook, ...]]:
    """The method ``hooks`` of an effect on every joint alike, from the hook at joint k, counted from 0."""
    return lambda self, arm: tuple(hook_at(self, k, arm) for k in range(len(arm.joints)))


def named(prefix: str) -> Any:
    """The property ``key`` of an effect with a ``name``, which tells several of a scene apart."""
    return property(lambda self: f"{prefix}{self.name}" if self.name else prefix[:-1])


def effort_unit(arm: Arm, joint: int) -> str:
    """Unit of the effort of a joint's motor."""
    return "N" if arm.prismatic[joint] else "N m"


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


WORD_BEGINS = re.compile(r"(?<=[^A-Z_])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
"""Places in the name of a class before which another word begins."""


@functools.cache
def snake_case(name: str) -> str:
    """LimitSpring -> limit_spring, DCMotor -> dc_motor: a run of capitals is one word."""
    return WORD_BEGINS.sub("_", name).lower()
