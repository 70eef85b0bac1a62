import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from redundant_envs.effects.hooks import Arm, Hook
from redundant_envs.effects.inner_control import InnerControl, Wanted, of_joints, sum_of, usual_speeds
from redundant_envs.effects.numbers import Curve, Example, Numbers, each_axis, each_joint, one, positive
from redundant_envs.language.algebra import entries, sqrt
from redundant_envs.robots.derived import coordinate_rates

TIP_SPEED = 1.0
"""m/s along an axis of a mode that ``action=`` adds: most poses of the reach scenes allow it within the
speeds of the joints."""
DAMPING = 0.1
"""m/s, of such a mode. In random poses the smaller singular value of the Jacobian, in m/s per share of a
speed, is below 0.3 in 1 % with the arm 4R, where the tip is 10 % slower, and above 0.98 in all of RPRP."""


def scaled_jacobian(arm: Any, jacobian: Sequence[Any], speeds: Sequence[Any]) -> list[list[Any]]:
    """Both rows of A: the velocity of the tip per share of the speed of each joint, m/s."""
    n, T = len(arm.joints), coordinate_rates(arm)
    rows = [
        [sum_of(zip(T[:, k].tolist(), row, strict=True)) for k in range(n)]
        for row in (jacobian[:n], jacobian[n:])
    ]
    return [[x * speed for x, speed in zip(row, speeds, strict=True)] for row in rows]


def gram(a: Sequence[Any], b: Sequence[Any], damping: Any) -> tuple[Any, Any, Any, Any]:
    """A A^T + damping^2, its entries 11, 12 and 22, and 1 over its determinant, positive in every pose."""
    least = damping * damping
    aa, ab, bb = (sum_of(zip(x, y, strict=True)) for x, y in ((a, a), (a, b), (b, b)))
    aa, bb = aa + least, bb + least
    return aa, ab, bb, 1.0 / (aa * bb - ab * ab)


def towards(
    a: Sequence[Any], b: Sequence[Any], matrix: Sequence[Any], velocity: Sequence[Any],
    posture: Sequence[Any] | None,
) -> list[Any]:  # fmt: skip
    """Shares of the speeds of the joints that give the tip a velocity, nearest to those of a posture:
    p + A^T (A A^T + damping^2)^-1 (v - A p), bent to less than 1 in length."""
    aa, ab, bb, inverse = matrix
    v, w = velocity
    if posture is not None:
        v, w = v - sum_of(zip(a, posture, strict=True)), w - sum_of(zip(b, posture, strict=True))
    y, z = inverse * (bb * v - ab * w), inverse * (aa * w - ab * v)
    shares = [p * y + q * z for p, q in zip(a, b, strict=True)]
    if posture is not None:
        shares = [s + p for s, p in zip(shares, posture, strict=True)]
    square = sum_of(zip(shares, shares, strict=True))
    flat = 1.0 + 2.0 * square  # bend(|s|, 1) / |s|
    factor = flat / sqrt(flat * flat + 4.0 * square * square * square)
    return [factor * s for s in shares]


@functools.lru_cache(maxsize=64)
def rates_for_tip(arm: Any) -> Callable[..., Any]:
    n = len(arm.joints)

    def rates(damping, v, w, *values):
        speeds = values[:n]
        a, b = scaled_jacobian(arm, values[n:], speeds)
        shares = towards(a, b, gram(a, b, damping), (v, w), None)
        return [s * share for s, share in zip(speeds, shares, strict=True)]

    return rates


@dataclass(frozen=True)
class TipVelocity(InnerControl):
    """Actions are the velocity of the tip along x and y, in units of ``tip_speeds``.

    The rates of the joints are the least ones, in units of their speeds, that give the tip its velocity:
    A^T (A A^T + damping^2)^-1 v with the Jacobian A, m/s per share of a speed. Their length as a row of
    shares is bent to less than 1, so no joint is wanted to be faster than its speed. Near a singular pose,
    where a singular value of A is not far above ``damping``, the tip is slower along its direction, and in
    the pose itself it is not moved along it at all. Nothing controls the posture: it drifts.

    Parameters
    ----------
    speeds : float or sequence of one for each joint
        Largest rates, rad/s (revolute) or m/s (prismatic), positive: how the joints share the
        motion, and the most of it.
    tip_speeds : float or (float, float)
        Speeds of the tip along x and y that an action of 1 commands, m/s, positive.
    damping : float
        Damping of the least squares, m/s, positive.
    """

    speeds: float | Numbers = field(metadata=each_joint(positive, "rad/s", "m/s"))
    tip_speeds: float | Numbers = field(metadata=each_axis(positive, "m/s"))
    damping: float = field(metadata=one(positive, "m/s"))

    example = Example(
        {"gain": 25.0, "limits": (20.0, 12.0, 8.0, 4.0), "speeds": 3.0, "tip_speeds": 1.0, "damping": 0.1},
        curve=Curve("tip", "time", 0.4),
    )

    @classmethod
    def defaults(cls, scene: Any) -> dict[str, Any]:
        return {"speeds": usual_speeds(scene.robot), "tip_speeds": (TIP_SPEED,) * 2, "damping": DAMPING}

    def shared_commands(self, arm: Arm) -> tuple[str, ...]:
        return "m/s", "m/s"

    def wanted(self, arm: Arm) -> Wanted:
        n = len(arm.joints)
        speeds = of_joints("speeds", n)
        takes = ("damping", "command1", "command2", *(name for name, _ in speeds), *entries("J", 2, n))
        return Wanted(rates_for_tip(cast(Any, type(arm))), takes, speeds)

    def takes(self, arm: Arm, joint: int) -> str:
        return "m/s"

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        if len(arm.joints) < 2:
            raise ValueError(f"TipVelocity is for an arm of two joints or more; {arm.kind} has one")
        return self.links(arm)

    def action_units(self, arm: Arm) -> tuple[str, ...]:
        return "tip_speeds[0]", "tip_speeds[1]"
