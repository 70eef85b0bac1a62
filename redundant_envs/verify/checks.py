"""A check, and the subject and random states on which checks are run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import SHORTEST_INTERVAL, Scene
from redundant_envs.support.extras import MissingPackage
from redundant_envs.tasks.base import hard_stops, narrowed
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, Promise, Verdict
from redundant_envs.verify.subjects import Subject

Array = NDArray[Any]

ROUNDING = 32 * np.finfo(np.float64).eps  # relative rounding error of what differences are taken of
LEAST_SHARE = 0.5  # of the states that must be smooth, and of the intervals that must be judged
STATES = {Mode.QUICK: 256, Mode.STANDARD: 1024, Mode.FULL: 8192}  # of each mode, unless the command says
Measure = Callable[["Sample"], Finding]


class Check(NamedTuple):
    """A function that measures a subject, and the promise about its result."""

    name: str
    family: str
    promise: Promise
    mode: Mode  # the smallest one in which it runs
    measure: Measure  # raises NotApplicable with a reason

    def run(self, trial: Sample) -> Outcome:
        """The outcome for a subject; an error of the subject's own code is a miss whose text reports it."""
        try:
            with np.errstate(all="ignore"):
                finding = self.measure(trial)
        except (NotApplicable, MissingPackage) as reason:
            verdict, finding = Verdict.NOT_APPLICABLE, Finding(math.nan, "", str(reason))
        except Exception as error:  # code of users may raise any error, and the other checks continue
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            words = f"it could not be measured: {kind}{error}"
            verdict, finding = Verdict.MISSED, Finding(math.nan, "", words)
        else:
            verdict = Verdict.KEPT if self.promise.holds(finding.found) else Verdict.MISSED
            verdict = verdict if self.promise.relation else Verdict.MEASURED
        return Outcome(self.family, self.name, self.promise, verdict, finding)


def check(name: str, promise: Promise, mode: Mode = Mode.QUICK) -> Callable[[Measure], Check]:
    """Turn a function into a check; :func:`checks_of` finds it in its module."""

    return lambda measure: Check(name, measure.__module__.rpartition(".")[2], promise, mode, measure)


def checks_of(*modules: Any) -> tuple[Check, ...]:
    """The checks of some modules, in the order of their definitions."""
    return tuple(x for module in modules for x in vars(module).values() if isinstance(x, Check))


class Outcome(NamedTuple):
    """A line of the table: promise and finding for a subject."""

    family: str
    check: str
    promise: Promise
    verdict: Verdict
    finding: Finding


@dataclasses.dataclass(frozen=True)
class Sample:
    """A subject and its random states; checks share intermediate results."""

    subject: Subject
    count: int = STATES[Mode.STANDARD]  # of random states
    seed: int = 0  # of the states
    chosen: tuple[Array, Array, Array] | None = dataclasses.field(default=None, repr=False, compare=False)
    """States to be judged instead of random ones: ``count`` of them."""
    _kept: dict[Any, Any] = dataclasses.field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"states is {self.count}; give at least 1")

    @property
    def scene(self) -> Scene:
        return self.subject.scene

    @property
    def arm(self) -> Arm:
        """The arm with the masses and inertias that effects add."""
        return self.scene.loaded_robot

    @cached_property
    def states(self) -> tuple[Array, Array, Array]:
        """Coordinates and velocities, (count, joints) each, and commands, (count, commands)."""
        return self.chosen or random_states(self.scene, self.count, self.seed)

    @cached_property
    def joint_efforts(self) -> Array:
        """Efforts at the joints, (count, joints): the commands, or random ones where links share these."""
        q, _, commands = self.states
        if self.scene.attached.sharing is None:
            return commands
        values, rng = self.scene.parameters(), np.random.default_rng(self.seed + 5)
        limits = [values[name] for name in self.scene.effort_units()] or [1.0]
        return rng.uniform(-1.0, 1.0, q.shape) * limits

    @cached_property
    def poses(self) -> tuple[Array, Array]:
        """Coordinates and velocities, (up to count, joints) each: also beyond the travel, after turns, and
        with unlimited sliders on either side of 0, but not where points of masses are undefined."""
        arm: Any = self.scene.robot
        q, qd, _ = random_states(self.scene, self.count, self.seed, BEYOND)
        joints, rng = q @ arm.motor_map, np.random.default_rng(self.seed + 3)
        for k in range(len(arm.joints)):
            if k not in self.scene.travel() and arm.prismatic[k]:
                joints[:, k] = FAR * (sum(arm.lengths) or 1.0) * rng.uniform(-1.0, 1.0, self.count)
            elif k not in self.scene.travel():
                joints[::2, k] *= WIDE
        q = joints @ np.linalg.inv(arm.motor_map)
        there = np.isfinite(arm.points(q)).all(axis=(1, 2))
        return (q[there], qd[there]) if there.any() else (q, qd)

    @cached_property
    def square(self) -> Array:
        """The poses whose joint angles are multiples of a right angle: straight, folded and square."""
        arm = self.scene.robot
        joints = self.poses[0] @ arm.motor_map
        turns = np.random.default_rng(self.seed + 4).integers(0, 4, joints.shape)
        turns[0] = 0
        return np.where(arm.prismatic, joints, 0.5 * np.pi * turns) @ np.linalg.inv(arm.motor_map)

    @cached_property
    def calm(self) -> Array:
        """The longest time of each state, (count,) s, in which no joint turns by more than a radian or slides
        by more than the reach, at its rate or from rest: rounding hardly grows within it."""
        q, qd, _ = self.states
        B = self.scene.robot.motor_map
        unit = np.where(self.arm.prismatic, np.linalg.norm(self.arm.points(q), axis=2).max(), 1.0)
        qdd = self.arm.forward_dynamics(q, qd, self.joint_efforts @ B.T)
        rate, faster = (np.abs(x @ B / unit).max(axis=1) for x in (qd, qdd))
        return np.minimum(1.0 / rate, 1.0 / np.sqrt(faster))

    @cached_property
    def calm_scene(self) -> Scene:
        """The scene, with an interval that is calm for at least half of the states."""
        seconds = min(self.scene.control_dt, max(float(np.median(self.calm)), SHORTEST_INTERVAL))
        return dataclasses.replace(self.scene, control_dt=seconds)

    def shared(self, make: Callable[[Sample], Any]) -> Any:
        """The result of a function for this trial, computed once."""
        if make not in self._kept:
            self._kept[make] = make(self)
        return self._kept[make]

    def worst(self, gaps: Array, names: Iterable[str] = ()) -> tuple[float, str, int]:
        """The largest of (states,) or (states, joints or names, ...) numbers, where it is, and its state."""
        filled = np.where(np.isnan(gaps), np.inf, gaps)
        place = np.unravel_index(int(np.argmax(filled)), filled.shape)
        where = f"state {place[0]}"
        if len(place) > 1:
            where += f", {(tuple(names) or self.arm.joints)[place[1]]}"
        return float(gaps[place]), where, int(place[0])

    def finding(self, gaps: Array, words: str, names: Iterable[str] = ()) -> Finding:
        """The largest of some numbers; ``{:.1e}`` in the words is replaced by it."""
        most, where, _ = self.worst(gaps, names)
        return Finding(most, where, words.format(most))


def worst_of(findings: list[Finding], reason: str) -> Finding:
    """The finding with the largest number; NotApplicable with a reason if there is none."""
    if not findings:
        raise NotApplicable(reason)
    return max(findings, key=lambda f: np.inf if np.isnan(f.found) else f.found)


def enough(good: Array, reason: str, share: float = LEAST_SHARE) -> None:
    """NotApplicable with a reason, unless a share of the states is good."""
    if np.mean(good) < share:
        raise NotApplicable(reason)


def ratio(difference: Any, scale: Any) -> Array:
    """A difference in units of a scale; if the scale is 0, it is 0 or infinite."""
    difference, scale = np.broadcast_arrays(np.abs(difference), scale)
    return np.where(scale > 0.0, difference / scale, np.where(difference == 0.0, 0.0, np.inf))


BEYOND = 0.5  # distance of poses beyond the travel, in units of it: springs at its ends act only there
WIDE = 5.0  # factor on unlimited angles in every second pose, so that they turn more than once
FREE = (0.0, 0.2)  # positions of unlimited sliders, m; of those with one stop, the nearest inside it
ANGLES = (-np.pi, np.pi)  # positions of joints that turn freely, rad; of those with one stop, the nearest
FAR = 1.0  # largest distance of unlimited sliders from 0, to either side, in units of the sum of all lengths


def random_states(scene: Scene, count: int, seed: int, beyond: float = 0.0) -> tuple[Array, Array, Array]:
    """Coordinates and velocities, (count, joints) each, and commands, (count, commands).

    Angles are uniform all around, travel uniform, rates normal: 2 rad/s, 0.5 m/s. One slider in four, and
    one joint in four of those with stops, is at rest at an end of its travel, which ``beyond`` widens to both
    sides, in units of itself. Commands are uniform within the units of the scene's actions, or efforts
    within the largest that hold the weights in these states.
    """
    arm: Any = scene.robot
    rng = np.random.default_rng(seed)
    prismatic, shape = np.array(arm.prismatic), (count, len(arm.joints))
    joints, values = rng.uniform(*ANGLES, shape), scene.parameters()
    ranges = dict.fromkeys(arm.sliders(), FREE)
    ranges |= {k: (values[low], values[high]) for k, (low, high) in scene.travel().items()}
    for k, lower, upper in hard_stops(scene):
        ranges[k] = narrowed(*ranges.get(k, ANGLES), values[lower], values[upper])
    for k, (low, high) in ranges.items():
        margin = beyond * (high - low)
        joints[:, k] = rng.uniform(low - margin, high + margin, count)
    rates = rng.normal(0.0, 1.0, shape) * np.where(prismatic, 0.5, 2.0)
    for k in {*arm.sliders(), *(k for k, *_ in hard_stops(scene))} & scene.travel().keys():
        at_end = rng.random(count) < 0.25
        joints[at_end, k], rates[at_end, k] = np.where(rng.random(count) < 0.5, *ranges[k])[at_end], 0.0
    inverse = np.linalg.inv(arm.motor_map)
    limits = np.array([values[name] for name in scene.action_units()])
    if not limits.size:
        limits = np.abs(scene.loaded_robot.gravity_forces(joints @ inverse) @ inverse.T).max(axis=0)
    return joints @ inverse, rates @ inverse, rng.uniform(-1.0, 1.0, (count, len(limits))) * limits
