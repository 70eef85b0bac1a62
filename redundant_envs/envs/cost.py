"""What scenes cost: time, evaluations, operations and memory of a control step, beside those without an
effect. A scene is compared with its bare arm: that with the effects of :data:`BARE` alone."""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import EffortLimits, Gravity, ViscousFriction
from redundant_envs.effects.hooks import Effect, Sensing
from redundant_envs.envs.core import Core
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.listing import OF_ENVIRONMENT, bill
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.progress import counted
from redundant_envs.support.timing import Times, by_turns, seconds, timed
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.base import hard_stops, narrowed

BARE = (EffortLimits, Gravity, ViscousFriction)
"""Effects of a bare arm: those of the environments, but for the ends of travel that only some arms have."""
TOLERANCES = {"one rk8 step": None, "1e-6 m": 1e-6}  # the second is that of "standard"
COLUMNS = ("at", "of", "ns", "ns_without", "times_bare", "evaluations", "operations", "bytes", "faults")
LANES = 4096
POSES = 64  # in which an arm is held, to find out what that takes
WARM, TIMED = 3, 8
"""Control intervals of a motion: those in which caches fill and rates grow from rest, and timed ones."""
TIMES_WEIGHT = 2.0  # commands of motors without limits, as multiples of the efforts that hold the arm
START_ANGLE, START_TRAVEL = 1.5, 0.25  # rad and m: starts are within +- the first, and from 0 to the second

Array = NDArray[np.float64]


class Pair(NamedTuple):
    """A scene, and the one with which its time is compared."""

    scene: Scene
    without: Scene


def fixed(scene: Scene, effects: Iterable[Effect]) -> Scene:
    """A scene with these effects, and without ranges: what is timed draws no numbers."""
    return dataclasses.replace(scene, effects=tuple(effects), randomize={})


def bare(scene: Scene) -> Scene:
    """The arm of a scene with those of its effects that every environment has."""
    return fixed(scene, (e for e in scene.effects if isinstance(e, BARE)))


def alone(arm: Scene, effect: Effect) -> Pair:
    """A bare arm with one effect more, and without it; an effect that the arm has replaces its own."""
    effects = {e.key: e for e in arm.effects}
    others = (e for e in arm.effects if e.key != effect.key)
    return Pair(fixed(arm, {**effects, effect.key: effect}.values()), fixed(arm, others))


def parts(scene: Scene) -> dict[str, Pair]:
    """The bare arm of a scene, each of its effects alone, and the whole scene."""
    arm = bare(scene)
    each = {effect.key: alone(arm, effect) for effect in scene.effects}
    return {"bare": Pair(arm, arm), **each, "whole scene": Pair(scene, arm)}


class Timed:
    """A motion of many lanes from rest under random actions, and then, with sensors, the observation of an
    environment with and without them."""

    def __init__(self, scene: Scene, lanes: int) -> None:
        joints, self.batch = len(scene.robot.joints), BatchSimulator(scene, lanes)
        places = starts(scene, np.random.default_rng(0).random((lanes, joints)))
        self.batch.set_state(places, np.zeros(joints))
        self.start = self.batch.save()
        most = commands(scene)
        shares = np.random.default_rng(1).uniform(-1.0, 1.0, (lanes, WARM + TIMED, len(most)))
        # (intervals, lanes, commands), N m and N, or what the first link of a motor takes
        self.efforts = np.ascontiguousarray(most * shares.swapaxes(0, 1))
        self.cores = observers(scene, lanes)  # with sensors, and without; none without sensors
        self.evaluations = self.faults = 0.0  # means of a lane and timed interval

    def sample(self) -> list[float]:
        """Times of all intervals and observations, s."""
        self.batch.restore(self.start)
        times, states = zip(*(timed(self.batch.advance, efforts) for efforts in self.efforts), strict=True)
        self.evaluations = float(np.mean([status.evaluations.mean() for status in states[WARM:]]))
        self.faults = float(np.mean([(status.numerics != 0).mean() for status in states[WARM:]]))
        for core in self.cores:
            core.observe()  # brings memory into the caches
            times += (seconds(core.observe),)
        return [*times]

    def nanoseconds(self, times: Times) -> float:
        """Of a control interval of a lane, and of the readings of its sensors."""
        intervals, observed = np.split(times.best, [len(self.efforts)])
        readings = observed[0] - observed[1] if self.cores else 0.0
        return 1e9 * float(intervals[WARM:].mean() + readings) / self.batch.num_envs

    @cached_property
    def price(self) -> tuple[int, int]:
        """Operations of a control step of a lane, and bytes of its memory, without those of a task."""
        rows = [counts for owner, counts in bill(self.batch.scene).items() if owner not in OF_ENVIRONMENT]
        return sum(sum(counts) - counts.bytes for counts in rows), sum(counts.bytes for counts in rows)


def observers(scene: Scene, lanes: int) -> tuple[Core, ...]:
    """The environment of a scene with sensors, and that without them; none where a scene can be none."""
    sensors = scene.attached.keys_of(Sensing)
    if not sensors or not scene.action_units() or not {*scene.robot.sliders()} <= scene.travel().keys():
        return ()
    rest = fixed(scene, (e for e in scene.effects if e.key not in sensors))
    return Core(scene, lanes, ReachTask()), Core(rest, lanes, ReachTask())


def starts(scene: Scene, draws: Array) -> Array:
    """Coordinates (lanes, joints) inside the limits of a scene, from uniform draws of the joints."""
    arm, values = scene.robot, scene.parameters()
    ranges = [(0.0, START_TRAVEL) if slides else (-START_ANGLE, START_ANGLE) for slides in arm.prismatic]
    for k, lower, upper in (*((k, *ends) for k, ends in scene.travel().items()), *hard_stops(scene)):
        ranges[k] = narrowed(*ranges[k], values[lower], values[upper])
    low, high = np.array(ranges).T
    return (low + draws * (high - low)) @ np.linalg.inv(arm.motor_map)


def commands(scene: Scene) -> Array:
    """Largest commands of a scene, (commands,): units of actions, as limits of motors, or where it has none
    :data:`TIMES_WEIGHT` times the efforts that hold the arm in some poses on the Earth, N m and N."""
    arm, values = scene.robot, scene.parameters()
    if names := scene.action_units():
        return np.array([values[name] for name in names])
    poses = starts(scene, np.random.default_rng(0).random((POSES, len(arm.joints))))
    return TIMES_WEIGHT * np.abs(arm.gravity_forces(poses) @ np.linalg.inv(arm.motor_map).T).max(axis=0)


def costs(
    pairs: Mapping[str, Pair], lanes: int = LANES, turns: int = 20, most: float = 0.2
) -> list[dict[str, Any]]:
    """Time pairs of scenes by turns; a row of :data:`COLUMNS` for each, at one rk8 step and at 1e-6 m. The
    time is that of a control interval of a lane, and of the readings of sensors in an observation: the best
    of some turns for each interval of a motion, the mean of its intervals. ``times_bare`` is the ratio of
    both times of a pair. After ``most`` seconds a scene has no more turns."""
    asked: list[Scene] = []  # what is timed, once
    for scene in itertools.chain.from_iterable(pairs.values()):
        if scene not in asked:
            asked.append(scene)
    rows = []
    with counted("cost", len(TOLERANCES) * (len(asked) + 1)) as done:
        for accuracy, tolerance in TOLERANCES.items():
            scenes = []
            for original in asked:
                scene = dataclasses.replace(original, integrator="rk8", substeps=1, tolerance=tolerance)
                scenes.append(Timed(scene, lanes))
                done(f"a scene at {accuracy}")
            times = by_turns({k: one.sample for k, one in enumerate(scenes)}, turns, most=most)
            done(f"{turns} turns at {accuracy}")
            ns = [one.nanoseconds(times[k]) for k, one in enumerate(scenes)]
            for name, pair in pairs.items():
                full, without = map(asked.index, pair)
                one, (operations, size) = scenes[full], scenes[full].price
                rows.append({
                    "at": accuracy, "of": name, "ns": round(ns[full], 1), "ns_without": round(ns[without], 1),
                    "times_bare": round(ns[full] / ns[without], 3), "evaluations": round(one.evaluations, 2),
                    "operations": operations, "bytes": size, "faults": round(one.faults, 4),
                })  # fmt: skip
    return rows
