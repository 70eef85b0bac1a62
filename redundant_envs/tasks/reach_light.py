"""Reach a goal and hold it in a pose in which no motor needs much effort."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from redundant_envs.effects.hooks import effort_unit
from redundant_envs.language.algebra import (
    maximum,
    minimum,
    numbered,
    physics,
    saturation,
    squash,
    tolerance,
    where,
)
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.base import hard_stops
from redundant_envs.tasks.reach import ReachTask, effort_term, end_term, rate_term, success

AT_STOP = 1e-3
"""m: a slider that is so near to a stop leans on it, and the stop bears its load."""


def largest_effort(joints: int) -> Callable[..., Any]:
    """The largest effort of a motor in this step, as a share of its limit; its excess, and whether there is
    one, over ``light``."""

    @physics(gives="load cost heavy", takes=(*numbered("action{}", joints), "light"))
    def largest_effort(*values: Any) -> Any:
        *actions, light = values
        load = functools.reduce(maximum, map(abs, actions))
        return load, maximum(load - light, 0.0), where(load > light, 1.0, 0.0)

    return largest_effort


def loads_at_rest(scene: Scene, limits: tuple[str, ...]) -> list[Callable[..., Any]]:
    """They give ``rest<k>``: the effort with which motor k would hold the present pose against gravity, as a
    share of its limit. A slider at a hard stop leans on it."""
    arm, stops = scene.robot, {joint: ends for joint, *ends in hard_stops(scene)}
    shares = np.linalg.inv(np.asarray(arm.motor_map, float))  # t = B^-1 G
    places = [
        [f"phi{k + 1}", *stops[k]] if arm.prismatic[k] and k in stops else [] for k in range(len(limits))
    ]
    return [_load_at_rest(k, shares[k], limit, places[k]) for k, limit in enumerate(limits)]


def _load_at_rest(joint: int, shares: Any, limit: str, place: list[str]) -> Callable[..., Any]:
    terms = [(float(share), f"G{j + 1}") for j, share in enumerate(shares) if share]

    @physics(gives=f"rest{joint + 1}", takes=(*(name for _, name in terms), limit, *place))
    def load_at_rest(*values: Any) -> Any:
        forces, (limit, *ends) = values[: len(terms)], values[len(terms) :]
        pairs = zip(terms, forces, strict=True)
        effort = functools.reduce(lambda rest, pair: rest + pair[0][0] * pair[1], pairs, 0.0)
        if ends:
            position, low, high = ends
            effort = where(position <= low + AT_STOP, minimum(effort, 0.0), effort)
            effort = where(position >= high - AT_STOP, maximum(effort, 0.0), effort)
        return effort / limit

    return load_at_rest


def observed_loads(joints: int) -> Callable[..., Any]:
    @physics(gives=numbered("rest{}_obs", joints), takes=(*numbered("rest{}", joints), "light"))
    def observed_loads(*values: Any) -> Any:
        *loads, light = values
        return tuple(squash(load, light) for load in loads)

    return observed_loads


def largest_at_rest(joints: int) -> Callable[..., Any]:
    @physics(gives="rest", takes=numbered("rest{}", joints))
    def largest_at_rest(*loads: Any) -> Any:
        return functools.reduce(maximum, map(abs, loads))

    return largest_at_rest


@physics(gives="hold_new touched_new")
def light_counter(hold, touched, distance, speed, load, reach, goal_tolerance, hold_speed, light):
    """Steps in a row at the goal, slow and with little effort; whether the goal was ever touched."""
    at_goal = where(distance <= goal_tolerance * reach, 1.0, 0.0)
    slow = where(speed <= hold_speed * reach, 1.0, 0.0)
    easy = where(load <= light, 1.0, 0.0)
    return at_goal * slow * easy * (hold + 1.0), where(touched + at_goal > 0.0, 1.0, 0.0)


@physics(gives="most_load")
def most_load(load, rest):
    """The load at rest counts, too: efforts that alternate around it are below it in every other step."""
    return maximum(load, rest)


@physics(gives="light_term")
def light_term(distance, reach, most_load, light, goal_tolerance):
    """0.42 tolerance(distance, goal_tolerance reach) tolerance(max(most load - 0.97 light, 0), 0.03 light)"""
    excess = maximum(most_load - 0.97 * light, 0.0)
    return 0.42 * tolerance(distance, goal_tolerance * reach) * tolerance(excess, 0.03 * light)


@physics(gives="pose_term")
def pose_term(distance, reach, rest, light):
    """0.26 tolerance(distance, 0.3 reach) tolerance(max(load at rest - 0.8 light, 0), 0.667 light)"""
    excess = maximum(rest - 0.8 * light, 0.0)
    return 0.26 * tolerance(distance, 0.3 * reach) * tolerance(excess, 0.667 * light)


@physics(gives="settle_term")
def settle_term(distance, speed, reach):
    """0.06 (1 - saturation(speed, 1.6 reach) tolerance(distance, 0.1 reach))"""
    return 0.06 * (1.0 - saturation(speed, 1.6 * reach) * tolerance(distance, 0.1 * reach))


@dataclass(frozen=True)
class ReachLightTask(ReachTask):
    """Bring the tip to a goal and hold it in a pose that asks no motor for more than a share of its limit.

    Parameters
    ----------
    light : float
        Largest effort, as a share of the limit, of any motor while the goal is held.
    """

    light: float = 0.3
    hold_steps: int = 25
    outer: float = 0.6

    name = "ReachLight"
    summary = "brings its tip to a goal and holds it there with little effort"
    expert = "redundant_envs.control.experts.reach_light:ReachLight"
    metrics: ClassVar[tuple[str, ...]] = (*ReachTask.metrics, "heavy", "load", "cost", "rest")
    flags: ClassVar[tuple[str, ...]] = (*ReachTask.flags, "heavy")
    failures: ClassVar[Mapping[str, str]] = {"heavy": "a motor had to work too hard at the end"}
    labels = {**ReachTask.labels, "rest": "load_at_rest"}
    held_outputs: ClassVar[tuple[str, ...]] = (*ReachTask.held_outputs, "heavy", "load", "cost")
    summed: ClassVar[tuple[str, ...]] = ("cost",)
    weights = (0.1, 0.1, 0.0)
    units = {**ReachTask.units, "light": "limits"}
    ranges = {**ReachTask.ranges, "light": (1e-6, 1.0)}

    def functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        joints, limits = len(scene.robot.joints), scene.effort_units() or scene.action_units()
        taken = scene.command_units()
        if not scene.effort_units() and taken != tuple(effort_unit(scene.robot, k) for k in range(joints)):
            raise ValueError(
                f"the task {self.name} counts efforts, and the motors of the scene take {', '.join(taken)}; "
                "give a scene whose commands are efforts, without DCMotor"
            )
        return (
            *super().functions(scene), largest_effort(joints), *loads_at_rest(scene, limits),
            observed_loads(joints), largest_at_rest(joints), most_load,
        )  # fmt: skip

    def success_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return light_counter, success

    @property
    def settling_term(self) -> Callable[..., Any]:
        return settle_term

    def distance_terms(self) -> tuple[Callable[..., Any], ...]:
        return super().distance_terms()[:2]  # light_term is the precise one

    def reward_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        joints = len(scene.robot.joints)
        efforts, rates = effort_term(joints), rate_term(joints)
        light = light_term, pose_term, efforts
        return (*self.distance_terms(), *light, self.settling_term, rates, end_term)

    def reward_note(self) -> str:
        return f"{super().reward_note()} The most load is the larger one of `load` and `load_at_rest`."

    def observation(self, scene: Scene) -> dict[str, str]:
        what = "effort that holds the pose against gravity / limit"
        joints = enumerate(scene.robot.joints, start=1)
        loads = {f"rest{k}_obs": f"squash({what} of {joint} / light)" for k, joint in joints}
        return {**super().observation(scene), **loads}

    def success_note(self) -> str:
        return (
            f"{super().success_note()} In these steps no motor used more\nthan {self.light:g} of its limit: "
            '`info["load"]` is the largest share, `info["cost"]` its excess over that,\n'
            'and `info["load_at_rest"]` the largest share that would hold the present pose.'
        )
