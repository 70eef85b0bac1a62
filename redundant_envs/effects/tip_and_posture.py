import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from redundant_envs.effects.hooks import Arm, Hook
from redundant_envs.effects.inner_control import Wanted, of_joints
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_joint, one, positive, strengths
from redundant_envs.effects.tip_velocity import TipVelocity, gram, scaled_jacobian, towards
from redundant_envs.language.algebra import entries, numbered, sqrt


def across(a: Sequence[Any], b: Sequence[Any], x: Sequence[Any]) -> list[Any]:
    """The row perpendicular to a, b and x, as long as x without its parts along a and b is, times the area
    between a and b: *(a ^ b) x of four joints, and a x b of three, which needs no x."""

    def area(i: int, j: int) -> Any:
        return a[i - 1] * b[j - 1] - a[j - 1] * b[i - 1]

    if len(a) == 3:
        return [area(2, 3), area(3, 1), area(1, 2)]
    d12, d13, d14, d23, d24, d34 = (area(i, j) for i, j in ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)))
    x1, x2, x3, x4 = x
    return [
        d34 * x2 - d24 * x3 + d23 * x4,
        d14 * x3 - d34 * x1 - d13 * x4,
        d24 * x1 - d14 * x2 + d12 * x4,
        d13 * x2 - d23 * x1 - d12 * x3,
    ]


def usual_direction(arm: Arm) -> tuple[float, ...]:
    """x of a mode that ``action=`` adds: the first slider, or of revolute joints a row that alternates, which
    the tip's rows, smooth along the arm, hardly have. In 5 % of random poses P x is shorter than 0.34 of
    4R."""
    n, sliders = len(arm.joints), arm.sliders()
    if sliders:
        return tuple(float(k == sliders[0]) for k in range(n))
    row = [math.cos(math.pi * (k + 0.5) * (n - 1) / n) for k in range(n)]
    return tuple(round(x / math.hypot(*row), 6) for x in row)


@functools.lru_cache(maxsize=64)
def rates_for_both(arm: Any) -> Callable[..., Any]:
    n = len(arm.joints)

    def rates(damping, *values):
        commands, direction = values[:n], values[n : -3 * n]
        speeds, jacobian = values[-3 * n : -2 * n], values[-2 * n :]
        a, b = scaled_jacobian(arm, jacobian, speeds)
        matrix = gram(a, b, damping)
        last = commands[-1] * sqrt(matrix[-1])
        posture = [last * x for x in across(a, b, direction)]
        if n == 4:
            posture = [p + commands[2] * x for p, x in zip(posture, direction, strict=True)]
        shares = towards(a, b, matrix, commands[:2], posture)
        return [s * share for s, share in zip(speeds, shares, strict=True)]

    return rates


@dataclass(frozen=True)
class TipAndPosture(TipVelocity):
    """Actions are the velocity of the tip along x and y, in units of ``tip_speeds``, and velocities in the
    null space of its Jacobian, in units of ``posture``: of an arm of four joints, or of three.

    The rates of the joints are those of :class:`TipVelocity`, nearest to those of a posture instead of to
    none, so the tip comes first. In units of their speeds, with the rows a, b of the Jacobian A, the basis of
    the posture is of four joints the ``direction`` x without its part that moves the tip, P x, and across
    that in the null space *(a ^ b) x / |a ^ b|; of three it is a x b / |a ^ b|. Both rows are as long as P x,
    perpendicular to each other and to a and b, always turn the same way, and are smooth in the pose; near a
    singular one |a ^ b| is sqrt(det(A A^T + damping^2)). They vanish together where x moves the tip alone: in
    single poses, of an arm RPRP in none if x is its first slider.

    Parameters
    ----------
    posture : float
        Length of the rates of the posture, as shares of the speeds; positive.
    direction : float or sequence of one for each joint, optional
        x, as shares of the speeds; of an arm of four joints only.
    """

    posture: float = field(metadata=one(positive))
    direction: float | Numbers | None = field(default=None, metadata=each_joint(strengths))

    example = Example(
        {
            "gain": 25.0, "limits": (20.0, 12.0, 8.0, 4.0), "speeds": 3.0, "tip_speeds": 1.0, "damping": 0.1,
            "posture": 1.0, "direction": (0.5, -0.5, 0.5, -0.5),
        }, curve=Curve("tip", "time", 0.4))  # fmt: skip

    @classmethod
    def defaults(cls, scene: Any) -> dict[str, Any]:
        arm = scene.robot
        direction = usual_direction(arm) if len(arm.joints) == 4 else None
        return {**super().defaults(scene), "posture": 1.0, "direction": direction}

    def shared_commands(self, arm: Arm) -> tuple[str, ...]:
        return "m/s", "m/s", *[""] * (len(arm.joints) - 2)

    def wanted(self, arm: Arm) -> Wanted:
        n = len(arm.joints)
        numbers = (*(of_joints("direction", n) if n == 4 else ()), *of_joints("speeds", n))
        takes = ("damping", *numbered("command{}", n), *(name for name, _ in numbers), *entries("J", 2, n))
        return Wanted(rates_for_both(cast(Any, type(arm))), takes, numbers)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        n = len(arm.joints)
        if n not in (3, 4):
            raise ValueError(
                f"TipAndPosture is for an arm of three or four joints; {arm.kind} has {n}: give TipVelocity"
            )
        if (self.direction is None) == (n == 4):
            raise ValueError(
                f"TipAndPosture.direction is {self.direction}; give it to an arm of four joints alone"
            )
        return self.links(arm)

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return "tip_speeds[0]", "tip_speeds[1]", *["posture"] * (len(arm.joints) - 2)
