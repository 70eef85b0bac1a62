"""What every task says: a protocol that the compiled episode follows, for any arm."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.algebra import gives_of, physics
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import number
from redundant_envs.scene import Scene

Function = Callable[..., Any]


@dataclass(frozen=True)
class Task:
    """What an arm is asked to do.

    A task is a frozen dataclass whose numbers are known to its functions by their names. Its functions are of
    the physics dialect and find each other, and the quantities of the arm, by names; beside those they know
    ``action1 ..``, ``low<k>`` and ``high<k>`` (ends of the travel of slider k), ``reach``, ``interval`` (the
    control interval, s) and ``steps`` (control steps of the episode before this one).

    An episode begins with ``begin_functions``, which give the task's ``memory`` from ``draw1 ..``, uniform in
    (0, 1). After each control interval first ``moves`` are made, then reward and metrics are found, then
    ``updates`` are made; the observation follows from state and memory alone.

    Parameters
    ----------
    start_angle : float
        Start angles of the revolute joints are uniform in +- this, inside their limits, rad.
    speed_bound : float
        Generalized velocity beyond which a lane ends (or is flagged), rad/s or m/s: at 50 rad/s a control
        interval of 20 ms is a whole radian.
    """

    start_angle: float = 2.0
    speed_bound: float = 50.0

    static: ClassVar[tuple[str, ...]] = ()
    """Fields that choose the structure, of which a task has others; functions do not know their names."""
    name: ClassVar[str]
    """Of the task in ids (``RPRP`` + name + ``-v0``) and in ``task={"type": name}``."""
    summary: ClassVar[str] = "has a task"
    """What the arm does, as the sentence goes on that begins with the arm's description."""
    draws: ClassVar[int] = 0
    """Uniform draws of an episode beside those of the start."""
    memory: ClassVar[tuple[str, ...]] = ()
    """What is remembered from step to step. ``goal_x`` and ``goal_y`` are shown, and set by options."""
    begin_functions: ClassVar[tuple[Function, ...]] = ()
    moves: ClassVar[Mapping[str, str]] = {}
    """Memory -> the quantity that it becomes in every step, before anything is measured."""
    updates: ClassVar[Mapping[str, str]] = {}
    """Memory -> the quantity that it becomes after everything was measured; 0 when an episode begins."""
    metrics: ClassVar[tuple[str, ...]] = ()
    """Quantities that ``info`` shows."""
    flags: ClassVar[tuple[str, ...]] = ()
    """Those of them that are true (1) or false (0)."""
    labels: ClassVar[Mapping[str, str]] = {}
    """Metrics -> their names in ``info``, where these differ."""
    held_outputs: ClassVar[tuple[str, ...]] = ()
    """Metrics that are known only after a step, and kept until the next one."""
    angles: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Angles of the task -> names of their sines and cosines."""
    goal_functions: ClassVar[tuple[Function, ...]] = ()
    """They give ``goal_reward`` from tip and goal alone; tasks with ``goal_conditioned`` need them."""
    goal_conditioned: ClassVar[bool] = False
    """Whether observations are dictionaries with goals, as hindsight replay needs them."""
    speed_bound_ends: ClassVar[bool] = True
    """Whether passing the speed bound ends an episode, or is only reported."""
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Allowed numbers; of those not named any positive one is allowed, and 0 only if negative ones are."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            where = f"{type(self).__name__}.{field.name}"
            given: Any = getattr(self, field.name)
            value = number(where, given)
            if hasattr(given, "dtype"):  # a number of NumPy
                object.__setattr__(self, field.name, given.item())
            low, high = self.ranges.get(field.name, (0.0, math.inf))
            if low >= 0.0 and value <= 0.0:
                raise ValueError(f"{where} is {value}; it must be positive")
            if not low <= value <= high:
                raise ValueError(f"{where} is {value}; it must lie in {low:g} to {high:g}")

    def parameters(self) -> dict[str, float]:
        """Numbers of the task, per environment."""
        fields = (f.name for f in dataclasses.fields(self) if f.name not in self.static)
        return {name: float(getattr(self, name)) for name in fields}

    def functions(self, scene: Scene) -> tuple[Function, ...]:
        """The task's quantities for the arm of a scene, those of the reward included."""
        return (full_reach(scene.robot), *self.reward_functions(scene), *self.goal_functions)

    def reward_functions(self, scene: Scene) -> tuple[Function, ...]:
        """They give the terms of the reward, whose sum it is. The docstring of each is its formula.

        One that takes ``paid`` is told what the others have paid in the episode, and by ``ended`` whether a
        fault ends it.
        """
        raise NotImplementedError(f"{type(self).__name__} does not say what is rewarded")

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, each within -1 to 1, with what they mean."""
        raise NotImplementedError(f"{type(self).__name__} does not say what is observed")

    def reward_terms(self, scene: Scene) -> tuple[str, ...]:
        """Names of the reward terms; their sum is the reward."""
        return tuple(name for f in self.reward_functions(scene) for name in gives_of(f))

    def reward_note(self) -> str:
        """What a page says before the table of reward terms."""
        return "The sum of the terms."

    def success_note(self) -> str:
        """What a page says of success."""
        return ""

    def start_note(self) -> str:
        """What a page says of an episode's start beside that of the arm."""
        return ""

    def aliases(self, scene: Scene) -> dict[str, str]:
        """low<k>, high<k> of the prismatic joints: the parameters that limit their travel."""
        travel = scene.travel()
        names: dict[str, str] = {}
        for k in scene.robot.sliders():
            if k not in travel:
                raise ValueError(
                    f"the {self.name.lower()} task needs limited travel of {scene.robot.joints[k]!r}; "
                    "add a PrismaticStop with both ends or a LimitSpring for it to the scene's effects"
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
    """How far the stretched arm reaches."""

    @physics(gives="reach", takes=" ".join(arm.extent))
    def full_reach(first, *rest):
        for length in rest:
            first = first + length
        return first

    return full_reach
