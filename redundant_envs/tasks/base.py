"""Base of all tasks: a protocol that the compiled episode follows, for any arm."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.effects.hooks import Impact
from redundant_envs.language.algebra import clamp, gives_of, maximum, minimum, physics, total, where
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import between, number
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import plain_data, shown, truth

Function = Callable[..., Any]


@dataclass(frozen=True)
class Task:
    """The objective of an arm: goal, start, observation and reward.

    A task is a frozen dataclass whose numbers are available to its functions by name. Its functions are in
    the physics dialect and find each other, and the quantities of the arm, by name; beside those they know
    ``action1 ..`` of the joints (in a mode of actions what its controller asks of each motor at the end of
    the interval, as a share of its limit), ``low<k>`` and ``high<k>`` (ends of the travel of slider k),
    ``reach``, ``interval`` (the control interval, s) and ``steps`` (control steps of the episode before this
    one).

    An episode begins with ``begin_functions``, which compute the task's ``memory`` from ``draw1 ..``, uniform
    in (0, 1). After each control interval first the ``moves`` are applied, then reward and metrics are
    computed, then the ``updates`` are applied; the observation follows from state and memory alone.

    Parameters
    ----------
    start_angle : float
        Start angles of the revolute joints are uniform in +- this, inside their limits.
    speed_bound : float
        Generalized velocity beyond which a lane ends, or is flagged: at 50 rad/s a control interval of 20 ms
        is a whole radian.

    Attributes
    ----------
    A subclass sets them in its body. All but ``name`` have a default.

    static : tuple of str, default ()
        Fields that choose the structure of a task. Environments have no such numbers, and functions take
        none of them.
    name : str
        Of the task in ids (``RPRP`` + name + ``-v0``) and in ``task={"type": name}``.
    summary : str, default "has a task"
        What the arm does: the sentence that begins with the arm's description goes on with it.
    steps : int, default 100
        Control steps after which an episode is truncated, unless ``max_episode_steps`` says another number.
    draws : int, default 0
        Uniform draws at the start of an episode, ``draw1 ..``, beside those of the joints; 0 to 64.
    memory : tuple of str, default ()
        What is remembered from step to step. ``goal_x`` and ``goal_y`` are shown, and set by options.
    moves : mapping of str to str, default {}
        Memory -> the quantity that it becomes in every step, before anything is measured.
    updates : mapping of str to str, default {}
        Memory -> the quantity that it becomes after everything was measured; 0 when an episode begins.
    metrics : tuple of str, default ()
        Quantities that ``info`` shows.
    flags : tuple of str, default ()
        Those of them that are true (1) or false (0).
    labels : mapping of str to str, default {}
        Metrics -> their names in ``info``, where these differ.
    held_outputs : tuple of str, default ()
        Metrics that are known only after a step, and kept until the next one.
    summed : tuple of str, default ()
        Those of them that a decision over several control steps sums, as it does rewards.
    failures : mapping of str to str, default {}
        Flags of ``info`` that tell why an episode is no success -> words of a report, such as "a link touched
        an obstacle"; the first one that is true counts.
    successes : (str, str), default ("held", "goals")
        What a report says of episodes that succeed: "held" so many "goals".
    ends : tuple of str, default ()
        Quantities that end an episode after a step in which one of them is positive (``terminated``).
    angles : mapping of str to (str, str), default {}
        Angles of the task, rad -> names of their sines and cosines.
    goal_functions : tuple of functions, default ()
        They give ``goal_reward`` from tip and goal alone; tasks with ``goal_conditioned`` need them.
    goal_conditioned : bool, default False
        Whether observations are dictionaries with goals, as hindsight replay needs them.
    expert : str, default that of computed torque
        "module:Class" of the controller that plays its episodes best: see ``redundant_envs.control.experts``.
    baseline : str, default computed torque, too
        The same of the classical controller from the pose nearest to the start, which an expert has to beat.
    speed_bound_ends : bool, default True
        Whether passing the speed bound ends an episode, or is only reported.
    units : mapping of str to str, default those of the two numbers above
        Numbers -> their units; a subclass adds its own to ``Task.units``. The page of an environment shows
        them beside the sentences under "Parameters".
    unused : tuple of str, default ()
        Numbers of its base class that mean nothing in this task, and that nobody can give.
    ranges : mapping of str to (float, float), default {}
        Numbers -> the least and the largest value allowed. A number that is not named may have any positive
        value; 0 is allowed only where negative values are.
    ordered : tuple of (str, str), default ()
        Pairs of numbers of which the first is at most the second.

    A subclass writes the methods ``reward_functions`` and ``observation``, and may replace any other;
    docs/tutorials/moving_target.md builds a complete one.
    """

    start_angle: float = 2.0
    speed_bound: float = 50.0

    static: ClassVar[tuple[str, ...]] = ()
    name: ClassVar[str]
    summary: ClassVar[str] = "has a task"
    steps: ClassVar[int] = 100
    draws: ClassVar[int] = 0
    memory: ClassVar[tuple[str, ...]] = ()
    moves: ClassVar[Mapping[str, str]] = {}
    updates: ClassVar[Mapping[str, str]] = {}
    metrics: ClassVar[tuple[str, ...]] = ()
    flags: ClassVar[tuple[str, ...]] = ()
    labels: ClassVar[Mapping[str, str]] = {}
    held_outputs: ClassVar[tuple[str, ...]] = ()
    summed: ClassVar[tuple[str, ...]] = ()
    failures: ClassVar[Mapping[str, str]] = {}
    successes: ClassVar[tuple[str, str]] = ("held", "goals")
    ends: ClassVar[tuple[str, ...]] = ()
    angles: ClassVar[Mapping[str, tuple[str, str]]] = {}
    goal_functions: ClassVar[tuple[Function, ...]] = ()
    goal_conditioned: ClassVar[bool] = False
    expert: ClassVar[str] = "redundant_envs.control.computed_torque:ComputedTorque"
    baseline: ClassVar[str] = "redundant_envs.control.computed_torque:ComputedTorque"
    speed_bound_ends: ClassVar[bool] = True
    units: ClassVar[Mapping[str, str]] = {"start_angle": "rad", "speed_bound": "rad/s or m/s"}
    unused: ClassVar[tuple[str, ...]] = ()
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {}
    ordered: ClassVar[tuple[tuple[str, str], ...]] = ()

    @classmethod
    def numbers(cls) -> list[str]:
        """Names of what a user may give."""
        return [field.name for field in dataclasses.fields(cls) if field.name not in cls.unused]

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            where = f"{type(self).__name__}.{field.name}"
            argument: Any = getattr(self, field.name)
            if field.name in self.unused and argument != field.default:
                raise ValueError(f"{where} is {shown(argument)}; it means nothing in this task: leave it out")
            if isinstance(field.default, bool):
                truth(where, argument)
                continue
            value = number(where, argument)
            if type(argument) not in (int, float):
                object.__setattr__(self, field.name, plain_data(argument))
            low, high = self.ranges.get(field.name, (0.0, math.inf))
            if low >= 0.0 and value <= 0.0:
                raise ValueError(f"{where} is {value}; it must be positive")
            between(where, value, low, high)
        for first, second in self.ordered:
            if (least := getattr(self, first)) > (most := getattr(self, second)):
                where = f"{type(self).__name__}.{first}"
                raise ValueError(
                    f"{where} is {least:g}, {second} is {most:g}; {first} must be at most {second}"
                )

    def parameters(self) -> dict[str, float]:
        """Numbers of the task, per environment."""
        return {name: float(getattr(self, name)) for name in self.numbers() if name not in self.static}

    def functions(self, scene: Scene) -> tuple[Function, ...]:
        """The task's quantities for the arm of a scene, those of the reward included."""
        return (full_reach(scene.robot), *self.reward_functions(scene), *self.goal_functions)

    def begin_functions(self, scene: Scene) -> tuple[Function, ...]:
        """They give the memory at the start of an episode, but for what is in ``updates``."""
        return ()

    def reward_functions(self, scene: Scene) -> tuple[Function, ...]:
        """They compute the terms of the reward, which is their sum. The docstring of each is its formula.

        A term with the argument ``paid`` receives the sum of the other terms over the episode, and in
        ``ended`` whether a fault ends the episode, which functions of ``held_outputs`` may take, too.
        """
        raise NotImplementedError(f"{type(self).__name__} does not say what is rewarded")

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, each within -1 to 1, with what they mean."""
        raise NotImplementedError(f"{type(self).__name__} does not say what is observed")

    def placements(self, scene: Scene) -> dict[str, str]:
        """Numbers of effects that the task sets when an episode begins, such as "keep_out.centre[0]", and the
        quantities of ``begin_functions`` that they become. Options of a reset win over them."""
        return {}

    def reward_terms(self, scene: Scene) -> tuple[str, ...]:
        """Names of the reward terms; their sum is the reward."""
        return tuple(name for f in self.reward_functions(scene) for name in gives_of(f))

    def reward_note(self) -> str:
        """Text of a page before the table of reward terms."""
        return "The sum of the terms."

    def success_note(self) -> str:
        """Text of a page about success."""
        return ""

    def pose_note(self) -> str:
        """Words of a page about the start of the revolute joints."""
        return f"joint angles uniform in +-{self.start_angle:g} rad"

    def end_note(self) -> str:
        """Words of a page before "a fault" that say what ends an episode."""
        return "only"

    def start_note(self) -> str:
        """Text of a page about an episode's start, beside the start of the arm."""
        return ""

    def path(self, known: Mapping[str, float]) -> Sequence[tuple[float, float]]:
        """Points of a line [m] that pictures show, such as the way of a target, from the memory of the task
        by its names; none by default."""
        return ()

    def aliases(self, scene: Scene) -> dict[str, str]:
        """low<k>, high<k> of the prismatic joints: the parameters that limit their travel."""
        travel = scene.travel()
        names: dict[str, str] = {}
        for k in scene.robot.sliders():
            if k not in travel:
                raise ValueError(
                    f"the {self.name.lower()} task needs limited travel of {scene.robot.joints[k]!r}; add a "
                    "PrismaticStop with both ends or a LimitSpring for it to the scene's effects"
                )
            names[f"low{k + 1}"], names[f"high{k + 1}"] = travel[k]
        return names

    def start_range(self, scene: Scene, joint: int) -> tuple[str, str]:
        """Range of a joint's start before its limits narrow it, as text of parameters."""
        if scene.robot.prismatic[joint]:
            names = self.aliases(scene)
            return names[f"low{joint + 1}"], names[f"high{joint + 1}"]
        return "-start_angle", "start_angle"


def full_reach(arm: Arm) -> Function:
    """Reach of the stretched arm."""

    @physics(gives="reach", takes=arm.extent)
    def full_reach(*lengths):
        return total(lengths)

    return full_reach


Limit = tuple[int, str, str]  # a joint, and the names of the parameters that limit it below and above


def spring_limits(scene: Scene) -> list[Limit]:
    """Limits that a joint may pass against a force: those of springs."""
    hard = scene.attached.keys_of(Impact)
    return [
        (joint, f"{effect.key}.{low}", f"{effect.key}.{high}")
        for effect in scene.effects
        if effect.key not in hard
        for joint, (low, high) in effect.travel(scene.robot).items()
    ]


def hard_stops(scene: Scene) -> list[Limit]:
    """Limits that no joint can pass; one of them is infinite where there is no stop."""
    return [
        (a.hook.joint, a.parameter(a.hook.lower), a.parameter(a.hook.upper))
        for a in scene.attached.of(Impact)
    ]


def is_confined(scene: Scene) -> bool:
    """Whether hard stops keep every slider within its travel: else the tip may go anywhere."""
    values = scene.parameters()
    bounded = {joint for joint, *ends in hard_stops(scene) if all(math.isfinite(values[end]) for end in ends)}
    return bounded >= {*scene.robot.sliders()}


@physics
def narrowed(low, high, lower, upper):
    """The part of a range that lies inside limits; without one, the nearest range as wide inside them."""
    empty = maximum(low, lower) > minimum(high, upper)
    width = high - low
    shifted = clamp(low, lower, maximum(upper - width, lower))
    start = where(empty, shifted, maximum(low, lower))
    return start, minimum(where(empty, shifted + width, high), upper)


def range_of_starts(task: Any, scene: Scene, joint: int, value: Callable[[str], Any]) -> tuple[Any, Any]:
    """Range of the starts of a joint inside its limits; ``value`` gives a parameter by its name."""
    texts = task.start_range(scene, joint)
    low, high = (-value(text[1:]) if text.startswith("-") else value(text) for text in texts)
    for limited, lower, upper in (*spring_limits(scene), *hard_stops(scene)):  # the last word is a stop's
        if limited == joint:
            low, high = narrowed(low, high, value(lower), value(upper))
    return low, high


@physics
def start_position(draw, low, high):
    """Uniform in a range."""
    return low + draw * (high - low)


@physics
def depth_beyond(position, lower, upper):
    return maximum(maximum(lower - position, position - upper), 0.0)
