"""Reach a goal with the tip and hold it there: goal, start, observation, reward and success."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.language.algebra import (
    numbered,
    physics,
    saturation,
    sqrt,
    squash,
    tolerance,
    total,
    where,
)
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.base import Task


@physics(gives="goal_radius goal_angle")
def goal_polar(draw1, draw2, reach, inner, outer):
    """Uniform over the area of the annulus from inner to outer times the full reach."""
    return reach * sqrt(inner * inner + draw1 * (outer * outer - inner * inner)), 6.283185307179586 * draw2


@physics(gives="goal_x goal_y")
def goal_position(goal_radius, goal_s, goal_c):
    return goal_radius * goal_c, goal_radius * goal_s


@physics(gives="error_x error_y distance")
def goal_error(tip_x, tip_y, goal_x, goal_y):
    error_x = goal_x - tip_x
    error_y = goal_y - tip_y
    return error_x, error_y, sqrt(error_x * error_x + error_y * error_y)


@physics(gives="speed")
def tip_speed(tip_vx, tip_vy):
    return sqrt(tip_vx * tip_vx + tip_vy * tip_vy)


@physics(gives="hold_new touched_new")
def hold_counter(hold, touched, distance, speed, reach, goal_tolerance, hold_speed):
    """Steps in a row at the goal and slow; whether the goal was ever touched."""
    at_goal = where(distance <= goal_tolerance * reach, 1.0, 0.0)
    slow = where(speed <= hold_speed * reach, 1.0, 0.0)
    return at_goal * slow * (hold + 1.0), where(touched + at_goal > 0.0, 1.0, 0.0)


@physics(gives="is_success")
def success(hold_new, hold_steps, ended):
    """Whether the goal is held, and no fault has undone this step."""
    return where(ended > 0.0, 0.0, where(hold_new >= hold_steps, 1.0, 0.0))


def terms_of_distance(
    weights: tuple[float, float, float], precise: str = "goal_tolerance", share: float = 1.0, factor: str = ""
) -> tuple[Callable[..., Any], ...]:
    """The far, the near and the precise term of a reward with these weights.

    The precise one falls to a half at a ``share`` of ``precise``, a number of the task; with ``factor`` the
    quantity of that name multiplies them all.
    """
    margins = ("far", 0.5, ""), ("near", 0.1, ""), ("precise", share, precise)
    pairs = zip(margins, weights, strict=True)
    return tuple(distance_term(name, weight, part, of, factor) for (name, part, of), weight in pairs)


def distance_term(name: str, weight: float, share: float, number: str, factor: str) -> Callable[..., Any]:
    """A term that falls to a half at a share of a number of the task, or of 1, in reaches."""
    numbers, factors = ([word] if word else [] for word in (number, factor))

    @physics(gives=f"{name}_term", takes=("distance", "reach", *numbers, *factors))
    def distance_term(distance, reach, *values):
        width = share * values[0] if numbers and share != 1.0 else values[0] if numbers else share
        scale = weight * values[-1] if factors else weight
        return scale * tolerance(distance, width * reach)

    parts = [f"{share:g}"] * (share != 1.0 or not numbers) + numbers
    distance_term.__doc__ = (
        f"{' '.join([f'{weight:g}', *factors])} tolerance(distance, {' '.join(parts)} reach)"
    )
    return distance_term


def effort_term(joints: int) -> Callable[..., Any]:
    @physics(gives="effort_term", takes=numbered("action{}", joints))
    def effort_term(*actions):
        return 0.04 / joints * functools.reduce(lambda rest, action: rest - action**2, actions, float(joints))

    effort_term.__doc__ = f"{0.04 / joints:.4g} ({joints} - |action|^2)"
    return effort_term


@physics(gives="settle_term")
def settle_term(distance, speed, reach):
    """0.08 (1 - saturation(speed, 1.6 reach) tolerance(distance, 0.1 reach))"""
    return 0.08 * (1.0 - saturation(speed, 1.6 * reach) * tolerance(distance, 0.1 * reach))


def rate_term(joints: int) -> Callable[..., Any]:
    @physics(gives="rate_term", takes=numbered("phid{}", joints))
    def rate_term(*rates):
        return 0.02 * (1.0 - saturation(total(map(abs, rates)), 10.0 * joints))

    rate_term.__doc__ = f"0.02 (1 - saturation(sum of |joint rates|, {10 * joints}))"
    return rate_term


@physics(gives="end_term")
def end_term(ended, paid):
    """-(what the episode paid) if a fault ends it, else 0

    So such an episode returns 0, and no episode returns less.
    """
    return where(ended > 0.0, -paid, 0.0)


@physics(gives="goal_reward")
def goal_reward(distance, reach, goal_tolerance):
    """1 at the goal, 0 elsewhere: a function of the two goals alone, as HER needs."""
    return where(distance <= goal_tolerance * reach, 1.0, 0.0)


def observed_rates(arm: Arm) -> Callable[..., Any]:
    n = len(arm.joints)

    @physics(gives=numbered("rate{}_obs", n), takes=(*numbered("phid{}", n), "rate_scale"))
    def observed_rates(*values):
        *rates, rate_scale = values
        return tuple(squash(rate, rate_scale) for rate in rates)

    return observed_rates


def observed_travel(arm: Arm) -> list[Callable[..., Any]]:
    """How far each slider is from the middle of its travel."""
    functions = []
    for k in arm.sliders():

        @physics(gives=f"travel{k + 1}_obs", takes=f"phi{k + 1} low{k + 1} high{k + 1}")
        def observed_travel(position, low, high):
            return squash(2.0 * position - low - high, high - low)

        functions.append(observed_travel)
    return functions


@physics(gives="tip_x_obs tip_y_obs tip_vx_obs tip_vy_obs")
def observed_tip(tip_x, tip_y, tip_vx, tip_vy, reach):
    return (
        squash(tip_x, reach), squash(tip_y, reach), squash(tip_vx, 0.5 * reach), squash(tip_vy, 0.5 * reach),
    )  # fmt: skip


def posture_and_tip(arm: Arm) -> dict[str, str]:
    """Names of these quantities and their meaning: positions and velocities of the joints and the tip."""
    rates = {f"rate{k + 1}_obs": f"squash(joint rate {k + 1} / rate_scale)" for k in range(len(arm.joints))}
    half = "from mid-travel / half travel"
    travel = {f"travel{k + 1}_obs": f"squash({arm.joints[k]} {half})" for k in arm.sliders()}
    return {
        **arm.posture, **travel, **rates,
        "tip_x_obs": "squash(tip x / reach)", "tip_y_obs": "squash(tip y / reach)",
        "tip_vx_obs": "squash(tip velocity x / (0.5 reach per s))",
        "tip_vy_obs": "squash(tip velocity y / (0.5 reach per s))",
    }  # fmt: skip


@physics(gives="goal_x_obs goal_y_obs error_x_obs error_y_obs")
def observed_goal(goal_x, goal_y, error_x, error_y, reach):
    return (
        squash(goal_x, reach), squash(goal_y, reach),
        squash(error_x, 0.05 * reach), squash(error_y, 0.05 * reach),
    )  # fmt: skip


GOAL = {
    "goal_x_obs": "squash(goal x / reach)",
    "goal_y_obs": "squash(goal y / reach)",
    "error_x_obs": "squash((goal x - tip x) / (0.05 reach))",
    "error_y_obs": "squash((goal y - tip y) / (0.05 reach))",
}


@dataclass(frozen=True)
class ReachTask(Task):
    """Bring the tip to a random goal and hold it there.

    The numbers of every task (:class:`Task`) and these, in the ``units`` of the class.

    Parameters
    ----------
    goal_tolerance : float
        Largest distance from the goal that counts as there.
    hold_speed : float
        Largest tip speed that counts as held.
    hold_steps : int
        Control steps in a row, at the goal and slow, for hold success; a whole number.
    inner, outer : float
        Radii of the annulus in which goals are drawn; inner is below outer, and outer at most 1.
    rate_scale : float
        Joint rate that is observed as 0.707.
    """

    goal_tolerance: float = 0.02
    hold_speed: float = 0.1
    hold_steps: int = 10
    inner: float = 0.1
    outer: float = 0.95
    rate_scale: float = 4.0

    name = "Reach"
    summary = "brings its tip to a goal and holds it there"
    draws = 2
    memory: ClassVar[tuple[str, ...]] = ("goal_x", "goal_y", "hold", "touched")
    updates = {"hold": "hold_new", "touched": "touched_new"}
    metrics: ClassVar[tuple[str, ...]] = ("is_success", "touched_new", "distance", "manipulability")
    flags: ClassVar[tuple[str, ...]] = ("is_success", "touched_new")
    labels = {"touched_new": "touch_success"}
    held_outputs: ClassVar[tuple[str, ...]] = ("is_success", "touched_new")
    angles = {"goal_angle": ("goal_s", "goal_c")}
    goal_functions: ClassVar[tuple[Callable[..., Any], ...]] = (goal_error, goal_reward)
    weights: ClassVar[tuple[float, float, float]] = (0.25, 0.25, 0.36)
    """Of the terms of the reward that fall with the distance: far, near and precise."""
    units = {
        **Task.units, **dict.fromkeys(("goal_tolerance", "inner", "outer"), "reaches"),
        "hold_speed": "reaches/s", "hold_steps": "control steps", "rate_scale": "rad/s or m/s",
    }  # fmt: skip
    # The squares of these numbers neither overflow nor vanish beside those of a motion.
    ranges = {
        "goal_tolerance": (1e-9, 2.0),  # the tip is never farther from a goal than two reaches
        "hold_speed": (1e-9, 1e9),
        "hold_steps": (1, 1e9),
        "start_angle": (0.0, 1e6),  # sines are exact to the last digits up to here
        "rate_scale": (1e-9, 1e9),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hold_steps != int(self.hold_steps):
            raise ValueError(f"ReachTask.hold_steps is {self.hold_steps}; give a whole number")
        if not self.inner < self.outer <= 1.0:
            raise ValueError(
                f"ReachTask.inner is {self.inner}, outer is {self.outer}; inner must be below outer"
            )

    def begin_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return goal_polar, goal_position

    def reward_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        joints = len(scene.robot.joints)
        efforts, rates = effort_term(joints), rate_term(joints)
        return (*self.distance_terms(), efforts, self.settling_term, rates, end_term)

    def distance_terms(self) -> tuple[Callable[..., Any], ...]:
        """The first terms of the reward, which fall with the distance."""
        return terms_of_distance(self.weights)

    @property
    def settling_term(self) -> Callable[..., Any]:
        """It gives ``settle_term``."""
        return settle_term

    def success_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        """They give ``hold_new``, ``touched_new`` and ``is_success``."""
        return hold_counter, success

    def functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        arm = scene.robot
        return (
            *super().functions(scene), tip_speed, *self.success_functions(scene), observed_rates(arm),
            *observed_travel(arm), observed_tip, observed_goal,
        )  # fmt: skip

    def reward_note(self) -> str:
        return (
            "The sum of the terms; `tolerance(x, margin)` is 1 / (1 + (x / margin)^2), and "
            "`saturation(x, scale)` is x / (x + scale). A step pays 0 to 1. A fault that ends the "
            "episode cancels what was `paid` before, so that nothing is gained by ending early."
        )

    def success_note(self) -> str:
        percent = f"{100 * self.goal_tolerance:g} %"
        return (
            f'`info["is_success"]` is hold success, at every step: the tip was within {percent} of the\n'
            f"full reach of the goal and slower than {self.hold_speed:g} reaches per second for the last "
            f"{self.hold_steps} steps.\n"
            '`info["touch_success"]` says whether the goal was ever touched.'
        )

    def start_note(self) -> str:
        return (
            f"The goal is uniform over the area of the annulus from {self.inner:g} to\n{self.outer:g} of the "
            "full reach."
        )

    def observation(self, scene: Scene) -> dict[str, str]:
        return {**posture_and_tip(scene.robot), **GOAL}
