"""All poses of an arm with its tip at a goal, as a function of parameters and a sheet.

A pose is built from the base outwards. Each step chooses the distance of the arm's next point from the goal,
between the least and the largest distance that the rest of the arm can still close; the law of cosines gives
the angle, to either side. So every choice yields a pose, and every pose has a choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.robots.arm import Arm

Array = NDArray[np.float64]

SLACK = 1e-9
"""A goal that is out of reach by at most this distance counts as reached, m: that is rounding."""


def num_sheets(arm: Arm) -> int:
    """Number of sheets: each turn except that of the last link may go to either side."""
    return 2 ** (_links(arm) - 1)


def _links(arm: Arm) -> int:
    """Links of an arm whose links all have fixed lengths, or which has two links that both extend."""
    if not any(arm.prismatic):
        return len(arm.joints)
    if arm.prismatic == (False, True) * 2 and arm.num_lengths == 2:
        return 2
    raise ValueError(
        f"the poses of {arm.kind} at a goal are not known; they are for arms of revolute joints, and of two "
        "links that both extend"
    )


def goal_poses(
    arm: Arm,
    travel: Mapping[int, tuple[float, float]],
    goals: Array,
    psi: Array,
    sheet: NDArray[np.int64],
) -> Array:
    """Poses (..., joints) with the tip at goals, NaN where these are out of reach; the shapes broadcast.

    Parameters
    ----------
    arm, travel
        An arm of revolute joints, or of two links that both extend; the ends of its sliders [m].
    goals : (..., 2) m
    psi : (..., joints - 2)
        Parameters from 0 to pi. At 0 a slider is at the lower end of the range that the goal allows, at pi
        at the upper end; if that is an end of its travel, exactly. For fixed links they choose distances.
    sheet : (...)
        0 to :func:`num_sheets` - 1: to which side each turn goes, one bit each.
    """
    shape = np.broadcast_shapes(goals.shape[:-1], psi.shape[:-1], sheet.shape)
    sides = [1.0 - 2.0 * ((sheet >> k) & 1) for k in range(_links(arm) - 1)]
    build = _two_extending_links if any(arm.prismatic) else _fixed_links
    columns, reached = build(arm.lengths, travel, goals, psi, sides)
    q = np.stack([np.broadcast_to(c, shape) for c in columns], axis=-1)
    return np.where(np.broadcast_to(reached, shape)[..., None], q, np.nan)


def _fixed_links(
    lengths: Any, travel: Any, goals: Array, psi: Array, sides: list[Any]
) -> tuple[list[Any], Any]:
    to_goal_x, to_goal_y = goals[..., 0], goals[..., 1]
    distance = np.hypot(to_goal_x, to_goal_y)
    reached = (distance <= sum(lengths) + SLACK) & (distance >= _least_reach(lengths) - SLACK)
    angles: list[Any] = []
    for k in range(len(lengths) - 1):
        rest = lengths[k + 1 :]
        low = np.maximum(_least_reach(rest), abs(distance - lengths[k]))
        high = np.minimum(sum(rest), distance + lengths[k])
        # The last link has one length: low and high are the same there.
        free = psi[..., k] if k < len(lengths) - 2 else np.zeros(())
        turn = _turn(distance, lengths[k], _between(low, high, free), free)
        angles.append(np.arctan2(to_goal_y, to_goal_x) + sides[k] * turn)
        to_goal_x = to_goal_x - lengths[k] * np.cos(angles[k])
        to_goal_y = to_goal_y - lengths[k] * np.sin(angles[k])
        distance = np.hypot(to_goal_x, to_goal_y)
    return [*angles, np.arctan2(to_goal_y, to_goal_x)], reached


def _two_extending_links(
    lengths: Any, travel: Any, goals: Array, psi: Array, sides: list[Any]
) -> tuple[list[Any], Any]:
    l1, l2 = lengths
    (low1, high1), (low2, high2) = travel[1], travel[3]
    distance = np.hypot(goals[..., 0], goals[..., 1])
    # Two links a and b close a triangle with the distance if no side is longer than the others together.
    least = np.maximum(low1, np.maximum(distance - l2 - high2, l2 + low2 - distance) - l1)
    most = np.minimum(high1, distance + l2 + high2 - l1)
    reached = least <= most + SLACK
    r1 = np.clip(_between(least, most, psi[..., 0]), low1, high1)
    a = l1 + r1
    least = np.maximum(low2, abs(distance - a) - l2)
    most = np.minimum(high2, distance + a - l2)
    r2 = np.clip(_between(least, most, psi[..., 1]), low2, high2)
    turn = _turn(distance, a, l2 + r2, psi[..., 1])
    theta1 = np.arctan2(goals[..., 1], goals[..., 0]) + sides[0] * turn
    theta2 = np.arctan2(goals[..., 1] - a * np.sin(theta1), goals[..., 0] - a * np.cos(theta1))
    return [theta1, r1, theta2, r2], reached


def _between(low: Any, high: Any, psi: Any) -> Any:
    """From low at psi = 0 to high at pi, both exact; angles are smooth in psi where an arm is straight."""
    share = 0.5 - 0.5 * np.cos(psi)
    return (1.0 - share) * low + share * high


def _turn(distance: Any, length: Any, rest: Any, psi: Any) -> Any:
    """Angle between a link and the line to the goal, 0 to pi, such that the rest closes the triangle.

    With its base at the goal a link may point anywhere: then it is psi.
    """
    product = 2.0 * distance * length
    squares = distance**2 + length**2 - rest**2
    cosine = np.divide(squares, product, out=np.zeros_like(squares * product), where=product > 0.0)
    return np.where(product > 0.0, np.arccos(np.clip(cosine, -1.0, 1.0)), psi)


def _least_reach(lengths: Any) -> float:
    """Smallest distance of the tip of a chain of links from its base, m."""
    return float(max(0.0, 2.0 * max(lengths) - sum(lengths)))
