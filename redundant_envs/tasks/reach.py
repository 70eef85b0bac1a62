"""Reach a goal with the tip and hold it there: goal, start, observation, reward and success."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.algebra import gives_of, physics, saturation, sqrt, squash, tolerance, where
from redundant_envs.robots.parameters import number
from redundant_envs.scene import Scene

# ---- goal and start, from uniform draws u1.. in (0, 1) -------------------------------------------


@physics(gives="phi1 phi2 phi3 phi4")
def start_joints(
    u1, u2, u3, u4, start_low1, start_low2, start_low3, start_low4,
    start_high1, start_high2, start_high3, start_high4,
):  # fmt: skip
    return (
        start_low1 + u1 * (start_high1 - start_low1),
        start_low2 + u2 * (start_high2 - start_low2),
        start_low3 + u3 * (start_high3 - start_low3),
        start_low4 + u4 * (start_high4 - start_low4),
    )


@physics(gives="goal_radius goal_angle")
def goal_polar(u5, u6, reach, inner, outer):
    """Uniform over the area of the annulus from inner to outer times the full reach."""
    return reach * sqrt(inner * inner + u5 * (outer * outer - inner * inner)), 6.283185307179586 * u6


@physics(gives="goal_x goal_y")
def goal_position(goal_radius, goal_s, goal_c):
    return goal_radius * goal_c, goal_radius * goal_s


@physics(gives="reach")
def reach_four_r(l1, l2, l3, l4):
    return l1 + l2 + l3 + l4


@physics(gives="reach")
def reach_rprp(l1, l2, high2, high4):
    return l1 + high2 + l2 + high4


# ---- measures ------------------------------------------------------------------------------------


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
def success(hold_new, hold_steps):
    return where(hold_new >= hold_steps, 1.0, 0.0)


# ---- reward: named terms, each from 0 to its weight; the weights sum to 1 ------------------------


@physics(gives="far_term")
def far_term(distance, reach):
    """0.25 tolerance(distance, 0.5 reach)"""
    return 0.25 * tolerance(distance, 0.5 * reach)


@physics(gives="near_term")
def near_term(distance, reach):
    """0.25 tolerance(distance, 0.1 reach)"""
    return 0.25 * tolerance(distance, 0.1 * reach)


@physics(gives="precise_term")
def precise_term(distance, reach, goal_tolerance):
    """0.36 tolerance(distance, goal_tolerance reach)"""
    return 0.36 * tolerance(distance, goal_tolerance * reach)


@physics(gives="effort_term")
def effort_term(action1, action2, action3, action4):
    """0.01 (4 - |action|^2)"""
    return 0.01 * (4.0 - action1**2 - action2**2 - action3**2 - action4**2)


@physics(gives="settle_term")
def settle_term(distance, speed, reach):
    """0.08 (1 - saturation(speed, 1.6 reach) tolerance(distance, 0.1 reach))"""
    return 0.08 * (1.0 - saturation(speed, 1.6 * reach) * tolerance(distance, 0.1 * reach))


@physics(gives="rate_term")
def rate_term(phid1, phid2, phid3, phid4):
    """0.02 (1 - saturation(sum of |joint rates|, 40))"""
    return 0.02 * (1.0 - saturation(abs(phid1) + abs(phid2) + abs(phid3) + abs(phid4), 40.0))


@physics(gives="end_term")
def end_term(ended, paid):
    """-(what the episode paid) if a fault ends it, else 0

    So such an episode returns 0, and no episode returns less.
    """
    return where(ended > 0.0, -paid, 0.0)


REWARD_TERMS: tuple[Callable[..., Any], ...] = (
    far_term, near_term, precise_term, effort_term, settle_term, rate_term, end_term,
)  # fmt: skip


@physics(gives="goal_reward")
def goal_reward(distance, reach, goal_tolerance):
    """1 at the goal, 0 elsewhere: a function of the two goals alone, as HER needs."""
    return where(distance <= goal_tolerance * reach, 1.0, 0.0)


@physics(gives="reached_term")
def reached_term(goal_reward):
    """1 if distance <= goal_tolerance reach, else 0"""
    return goal_reward


# ---- observation: bounded by construction --------------------------------------------------------


@physics(gives="rate1_obs rate2_obs rate3_obs rate4_obs")
def observed_rates(phid1, phid2, phid3, phid4, rate_scale):
    return (
        squash(phid1, rate_scale),
        squash(phid2, rate_scale),
        squash(phid3, rate_scale),
        squash(phid4, rate_scale),
    )


@physics(gives="travel2_obs travel4_obs")
def observed_travel(phi2, phi4, low2, low4, high2, high4):
    return (
        squash(2.0 * phi2 - low2 - high2, high2 - low2),
        squash(2.0 * phi4 - low4 - high4, high4 - low4),
    )


@physics(gives="tip_x_obs tip_y_obs tip_vx_obs tip_vy_obs")
def observed_tip(tip_x, tip_y, tip_vx, tip_vy, reach):
    return (
        squash(tip_x, reach),
        squash(tip_y, reach),
        squash(tip_vx, 0.5 * reach),
        squash(tip_vy, 0.5 * reach),
    )


@physics(gives="goal_x_obs goal_y_obs error_x_obs error_y_obs")
def observed_goal(goal_x, goal_y, error_x, error_y, reach):
    return (
        squash(goal_x, reach),
        squash(goal_y, reach),
        squash(error_x, 0.05 * reach),
        squash(error_y, 0.05 * reach),
    )


POSTURE = {
    "FourR": {
        "s1": "sine of joint angle 1", "c1": "cosine of joint angle 1",
        "s21": "sine of joint angle 2", "c21": "cosine of joint angle 2",
        "s32": "sine of joint angle 3", "c32": "cosine of joint angle 3",
        "s43": "sine of joint angle 4", "c43": "cosine of joint angle 4",
    },
    "RPRP": {
        "s1": "sine of theta1", "c1": "cosine of theta1",
        "s12": "sine of theta1 - theta2", "c12": "cosine of theta1 - theta2",
        "travel2_obs": "squash(r1 from mid-travel / half travel)",
        "travel4_obs": "squash(r2 from mid-travel / half travel)",
    },
}  # fmt: skip

COMMON = {
    "rate1_obs": "squash(joint rate 1 / rate_scale)",
    "rate2_obs": "squash(joint rate 2 / rate_scale)",
    "rate3_obs": "squash(joint rate 3 / rate_scale)",
    "rate4_obs": "squash(joint rate 4 / rate_scale)",
    "tip_x_obs": "squash(tip x / reach)",
    "tip_y_obs": "squash(tip y / reach)",
    "tip_vx_obs": "squash(tip velocity x / (0.5 reach per s))",
    "tip_vy_obs": "squash(tip velocity y / (0.5 reach per s))",
}

GOAL = {
    "goal_x_obs": "squash(goal x / reach)",
    "goal_y_obs": "squash(goal y / reach)",
    "error_x_obs": "squash((goal x - tip x) / (0.05 reach))",
    "error_y_obs": "squash((goal y - tip y) / (0.05 reach))",
}


RANGES = {
    "goal_tolerance": (1e-9, 2.0),  # the tip is never farther from a goal than two reaches
    "hold_speed": (1e-9, 1e9),
    "hold_steps": (1, 1e9),
    "start_angle": (0.0, 1e6),  # sines are exact to the last places up to here
    "rate_scale": (1e-9, 1e9),
}
"""Allowed numbers of the task: their squares neither overflow nor vanish beside those of a motion."""


@dataclass(frozen=True)
class ReachTask:
    """Bring the tip to a random goal and hold it there.

    Parameters
    ----------
    goal_tolerance : float
        Largest distance from the goal that counts as there, in units of the full reach.
    hold_speed : float
        Largest tip speed that counts as held, full reaches per second.
    hold_steps : int
        Control steps in a row for hold success.
    inner, outer : float
        Radii of the annulus of goals, in units of the full reach.
    start_angle : float
        Start angles of the revolute joints are uniform in +- this, inside their limits, rad.
    rate_scale : float
        Joint rate observed as 0.707, rad/s or m/s.
    speed_bound : float
        Generalized velocity beyond which a lane ends (in goal environments: is flagged), rad/s or
        m/s: at 50 rad/s a control interval of 20 ms is a whole radian.
    """

    goal_tolerance: float = 0.02
    hold_speed: float = 0.1
    hold_steps: int = 10
    inner: float = 0.1
    outer: float = 0.95
    start_angle: float = 2.0
    rate_scale: float = 4.0
    speed_bound: float = 50.0

    draws = 6
    memory = ("goal_x", "goal_y", "hold", "touched")
    renewed = {"hold": "hold_new", "touched": "touched_new"}
    """Memory that each step renews, and from which quantity."""
    measures = ("is_success", "touched_new", "distance", "manipulability")
    results = ("reward", "terminated", "truncated", "is_success", "touched_new")
    """What is known only after a step, and kept until the next one."""
    angles = {"goal_angle": ("goal_s", "goal_c")}
    begin_functions = (start_joints, goal_polar, goal_position)
    goal_reward = staticmethod(goal_reward)
    reward_functions = REWARD_TERMS
    speed_bound_ends = True
    """Whether passing the speed bound ends an episode, or is only reported."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = number(f"ReachTask.{name}", getattr(self, name))
            if value <= 0.0:
                raise ValueError(f"ReachTask.{name} is {value}; it must be positive")
            low, high = RANGES.get(name, (0.0, math.inf))
            if not low <= value <= high:
                raise ValueError(f"ReachTask.{name} is {value}; it must lie in {low:g} to {high:g}")
        if self.hold_steps != int(self.hold_steps):
            raise ValueError(f"ReachTask.hold_steps is {self.hold_steps}; give a whole number")
        if not self.inner < self.outer <= 1.0:
            raise ValueError(
                f"ReachTask.inner is {self.inner}, outer is {self.outer}; "
                "inner must be below outer, and outer at most 1"
            )

    def functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        """The task's quantities for the arm of a scene."""
        full_reach = reach_rprp if scene.robot.kind == "RPRP" else reach_four_r
        return (
            full_reach, goal_error, tip_speed, hold_counter, success, *self.reward_functions,
            observed_rates, observed_travel, observed_tip, observed_goal, goal_reward,
        )  # fmt: skip

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, with what they mean."""
        return {**POSTURE[scene.robot.kind], **COMMON, **GOAL}

    def reward_terms(self) -> tuple[str, ...]:
        """Names of the reward terms; their sum is the reward."""
        return tuple(name for f in self.reward_functions for name in gives_of(f))

    def parameters(self) -> dict[str, float]:
        """Numbers of the task, per environment."""
        return {
            "goal_tolerance": self.goal_tolerance,
            "hold_speed": self.hold_speed,
            "hold_steps": float(self.hold_steps),
            "inner": self.inner,
            "outer": self.outer,
            "start_angle": self.start_angle,
            "rate_scale": self.rate_scale,
            "speed_bound": self.speed_bound,
        }

    def aliases(self, scene: Scene) -> dict[str, str]:
        """low<k>, high<k> of the prismatic joints: the parameters that limit their travel."""
        travel = scene.travel()
        names: dict[str, str] = {}
        for k in range(4):
            if scene.robot.prismatic[k]:
                if k not in travel:
                    raise ValueError(
                        f"the reach task needs limited travel of {scene.robot.joints[k]!r}; "
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


@dataclass(frozen=True)
class GoalReachTask(ReachTask):
    """The task with its goal beside the observation, and the reward of the two goals alone.

    A reward of 1 or 0 cannot take back what an episode paid, and an arm that whirls may touch its
    goal by luck. So an arm beyond the speed bound is flagged and goes on, and efforts cannot end
    an episode early.
    """

    reward_functions = (reached_term,)
    speed_bound_ends = False

    def observation(self, scene: Scene) -> dict[str, str]:
        """Observed quantities in order, with what they mean: none depends on the goal."""
        return {k: v for k, v in super().observation(scene).items() if k not in GOAL}
