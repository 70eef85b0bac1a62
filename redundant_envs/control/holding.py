"""Which goals an arm can hold at rest: the least motor load among all poses with the tip at a goal.

An arm of four joints has two more than a goal needs, so its poses at a goal form a surface; one of two joints
has two poses. The search covers the surface by a grid, in which the stops of the sliders are exact, and goes
down from the best points of the grid by a pattern search.

Only static balance counts here. The hold success of an episode requires less: a tip that is slow for a
fifth of a second need not be at rest. So an arm may hold a few more goals than this computation finds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import EffortLimits
from redundant_envs.effects.hooks import Actuation, Force, Point
from redundant_envs.language.algebra import numbered
from redundant_envs.model.energy import at_joints, scene_quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.parameters import not_negative
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.values import shown
from redundant_envs.tasks.base import hard_stops

Array = NDArray[np.float64]
Travel = dict[int, tuple[float, float]]
Sheet = NDArray[np.int64]
Load = Callable[[Array, Sheet, Array], Array]
"""Largest effort / limit (...), of x, sheets and goals (..., 2). x (..., parameters + 2) has the parameters
psi of a pose, and where the tip is near the goal, in units of the tolerance."""
SLACK = 1e-9  # a goal that is out of reach by at most this distance counts as reached, m: that is rounding


def static_efforts(scene: Scene, q: ArrayLike) -> Array:
    """Joint efforts t at rest [N m, N], (..., joints), without the help of stops: B (t + f) = G(q) with the
    forces f of the other effects. ValueError unless efforts act at joints, or for another shape of q."""
    arm = scene.robot
    place = np.asarray(q, dtype=np.float64)
    joints = len(arm.joints)
    if place.shape[-1:] != (joints,):
        raise ValueError(f"q has shape {place.shape}; the last axis must have {joints} entries")
    if scene.actuation != "joint":
        raise ValueError(f"scene.actuation is {scene.actuation!r}; efforts are those of joints: use 'joint'")
    x = scene_quantities(scene, place)
    shape = place.shape[:-1]  # without gravity a force is one number
    gravity = np.stack([np.broadcast_to(G, shape) for G in x.each(numbered("G{}", joints))], axis=-1)
    efforts: Array = gravity @ np.linalg.inv(arm.motor_map).T
    for a in scene.attached.of(Force):
        efforts -= at_joints(scene, a, "function", x)
    return efforts


def motor_efforts(scene: Scene, q: ArrayLike) -> Array:
    """The smallest motor efforts at rest, (..., joints): a slider at or beyond a stop leans on it where that
    helps. A lower stop pushes its slider outwards, an upper one inwards; neither pulls."""
    efforts = static_efforts(scene, q)
    joints = np.asarray(q, dtype=np.float64) @ scene.robot.motor_map
    for k, (low, high) in stops(scene).items():
        share = efforts[..., k]
        share = np.where(joints[..., k] <= low, np.minimum(share, 0.0), share)
        efforts[..., k] = np.where(joints[..., k] >= high, np.maximum(share, 0.0), share)
    return efforts


def stops(scene: Scene) -> Travel:
    """Hard ends of the travel, joint -> lower and upper [m]; infinite where there is none."""
    values = scene.parameters()
    return {joint: (values[lower], values[upper]) for joint, lower, upper in hard_stops(scene)}


def slider_travel(scene: Scene) -> Travel:
    """The stops of every slider; ValueError where the travel has an end without a stop."""
    travel = stops(scene)
    for k, length in zip(scene.robot.sliders(), scene.robot.lengths, strict=False):
        low, high = travel.get(k, (-np.inf, np.inf))
        if not (-length <= low and high < np.inf):
            raise ValueError(
                f"PrismaticStop leaves {scene.robot.joints[k]!r} {low} to {high} m; give ends, >= {-length}"
            )
    return travel


def effort_limits(scene: Scene) -> Array:
    """Effort limits of the joints, (joints,), N m and N. ValueError without any, or with another actuation or
    a spring on a revolute joint, whose force depends on how often the joint has turned."""
    for a in scene.attached.of(Actuation, Force):
        if isinstance(a.hook, Force):
            turns = not isinstance(a.hook.joint, Point) and not scene.robot.prismatic[a.hook.joint]
            known = a.hook.potential is None or not turns
        else:
            known = isinstance(a.effect, EffortLimits)
        if not known:
            raise ValueError(
                f"effects[{scene.effects.index(a.effect)}] is {shown(a.effect)}; the load at rest is known "
                "with gravity, friction, effort limits, stops, and springs on sliders: leave this effect out"
            )
    limits = next((e.limits for e in scene.effects if isinstance(e, EffortLimits)), ())
    max_efforts = np.atleast_1d(limits)
    if not max_efforts.size or max_efforts.min() <= 0.0:
        raise ValueError(f"EffortLimits.limits is {limits or None}; give positive numbers")
    return max_efforts


MOST_PARAMETERS = 2  # of the poses at a goal; with one more a grid takes 25 times as long
GRID = 25
"""Points of the grid along each parameter. With 49 the loads of 2000 goals of the reach scenes change by
at most 1.4e-3, and one alone by more than 1e-3."""
CANDIDATES = 12  # best local minima of the grid to descend from: a narrow valley looks like several
ROUNDS, DIRECTIONS = 120, 12  # of the pattern search: a step shrinks from a cell of the grid to 1e-5 of it
WIDER, NARROWER = 2.0, 0.8  # factors of the step after a round that found a better point, and after another
RING = 8  # points on the circle around a goal with a tolerance that get a grid, beside the goal itself
CHUNK = 100_000  # poses of a batch: its arrays stay below 100 MB


def holding_load(scene: Scene, goals: ArrayLike, tolerance: float = 0.0) -> Array:
    """Least load, (n,), of :func:`holding_poses`: with limits times f, goals of at most f can be held."""
    return holding_poses(scene, goals, tolerance)[1]


def holding_poses(scene: Scene, goals: ArrayLike, tolerance: float = 0.0) -> tuple[Array, Array]:
    """The pose of least load at each goal.

    Parameters
    ----------
    scene : Scene
        With EffortLimits, and for RPRP a PrismaticStop with both ends of both sliders.
    goals : (n, 2) m
    tolerance : float
        m. At 0 the tip is exactly at the goal; otherwise it is anywhere within this distance of it.

    Returns
    -------
    q : (n, joints)
        NaN where the goal is out of reach.
    load : (n,)
        Largest effort / limit of a joint in that pose, 1; inf where the goal is out of reach. It is an upper
        bound of the least, since it belongs to a pose.

    Raises
    ------
    ValueError
        If the scene has effects whose part at rest is not known, or another argument is not as above.
    """
    joints = len(scene.robot.joints)
    parameters = joints - 2
    if not 0 <= parameters <= MOST_PARAMETERS:
        raise ValueError(f"{scene.robot.kind} has {joints} joints; give an arm of 2 to {MOST_PARAMETERS + 2}")
    limits, travel = effort_limits(scene), slider_travel(scene)
    points = np.asarray(goals, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"goals has the shape {points.shape}; give (n, 2), x and y of each in metres")
    if not np.isfinite(points).all():
        raise ValueError("goals has entries that are not finite; give metres")
    margin: Any = not_negative("tolerance", tolerance)

    def pose(x: Array, sheet: Sheet, near: Array) -> Array:
        return goal_poses(scene.robot, travel, near + margin * x[..., -2:], x[..., :-2], sheet)

    def load(x: Array, sheet: Sheet, near: Array) -> Array:
        loads: Array = (np.abs(motor_efforts(scene, pose(x, sheet, near))) / limits).max(axis=-1)
        return np.where(np.isnan(loads), np.inf, loads)

    sheets, ring = num_sheets(scene.robot), RING if margin > 0.0 else 0
    size = max(1, CHUNK // max(sheets * GRID**parameters * (1 + ring), CANDIDATES * DIRECTIONS))
    q, best = np.full((len(points), joints), np.nan), np.full(len(points), np.inf)
    for start in range(0, len(points), size):
        part = slice(start, start + size)
        x, sheet, loads = _candidates(load, points[part], sheets, ring, parameters)
        x, loads = _descended(load, points[part], x, sheet, loads, ring)
        least = np.arange(len(x)), loads.argmin(axis=-1)
        q[part], best[part] = pose(x[least], sheet[least], points[part]), loads[least]
    return q, best


def _candidates(
    load: Load, goals: Array, sheets: int, ring: int, parameters: int
) -> tuple[Array, Sheet, Array]:
    """Local minima of the grid at each goal: x (n, m, parameters + 2), sheets and loads (n, m)."""
    psi = np.linspace(0.0, np.pi, GRID)
    turn = 2.0 * np.pi * np.arange(ring) / RING
    near = np.vstack([np.zeros(2), np.stack([np.cos(turn), np.sin(turn)], axis=-1)])
    along, ones = tuple(range(-parameters, 0)), (1,) * parameters  # axes of the grid
    shape = (len(near), sheets, *[GRID] * parameters)
    x = np.empty((*shape, parameters + 2))
    for k, values in enumerate(np.meshgrid(*[psi] * parameters, indexing="ij")):
        x[..., k] = values
    x[..., -2:] = near.reshape(-1, 1, *ones, 2)
    sheet = np.broadcast_to(np.arange(sheets).reshape(-1, *ones), shape)
    loads = load(x, sheet, goals.reshape(-1, 1, 1, *ones, 2))
    edges = [(0, 0)] * (loads.ndim - parameters) + [(1, 1)] * parameters
    around = sliding_window_view(np.pad(loads, edges, constant_values=np.inf), (3,) * parameters, along)
    minima = np.where(loads <= around.min(axis=along), loads, np.inf).reshape(len(goals), -1)
    chosen = np.argpartition(minima, min(CANDIDATES, minima.shape[1] - 1), axis=-1)[:, :CANDIDATES]
    x, sheet = x.reshape(-1, parameters + 2)[chosen], sheet.reshape(-1)[chosen]
    return x, sheet, np.take_along_axis(minima, chosen, axis=-1)


def _descended(
    load: Load, goals: Array, x: Array, sheet: Sheet, best: Array, ring: int
) -> tuple[Array, Array]:
    """Pattern search from candidates x (n, m, parameters + 2) with loads (n, m): random directions find
    creases."""
    if not ring and x.shape[-1] == 2:
        return x, best  # nothing is free
    generator, cell = np.random.default_rng(0), np.pi / (GRID - 1)
    step = np.full(best.shape, cell)
    for _ in range(ROUNDS):
        way = generator.normal(size=(DIRECTIONS, x.shape[-1]))
        if not ring:
            way[:, -2:] = 0.0
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        trial = x[:, :, None] + step[:, :, None, None] * way
        trial[..., :-2] = np.clip(trial[..., :-2], 0.0, np.pi)  # the ends of a travel are reached exactly
        trial[..., -2:] /= np.maximum(np.linalg.norm(trial[..., -2:], axis=-1, keepdims=True), 1.0)
        loads = load(trial, sheet[:, :, None], goals[:, None, None])
        least = loads.argmin(axis=-1)[..., None]
        min_loads = np.take_along_axis(loads, least, axis=-1)[..., 0]
        better = min_loads < best
        x = np.where(better[..., None], np.take_along_axis(trial, least[..., None], axis=2)[:, :, 0], x)
        best = np.where(better, min_loads, best)
        step = np.minimum(step * np.where(better, WIDER, NARROWER), cell)
    return x, best


def num_sheets(arm: Arm) -> int:
    """Number of sheets: each turn except that of the last link may go to either side. ValueError unless all
    links have fixed lengths, or there are two that both extend."""
    if not any(arm.prismatic):
        return 2 ** (len(arm.joints) - 1)
    if arm.prismatic == (False, True) * 2 and arm.num_lengths == 2:
        return 2
    raise ValueError(f"the poses of {arm.kind} at a goal are not known; give 4R or RPRP")


def goal_poses(arm: Arm, travel: Travel, goals: Array, psi: Array, sheet: Sheet) -> Array:
    """Poses (..., joints) with the tip at goals (..., 2) [m], NaN where these are out of reach.

    psi (..., joints - 2) is from 0 to pi: at 0 a slider is at the lower end of the range the goal allows, and
    at pi at the upper end; if that is an end of its travel, m, exactly. In fixed links it chooses distances.
    Bits of the sheet (...), below :func:`num_sheets`, say to which side each turn goes; all shapes broadcast.

    A pose is built from the base outwards. Each step chooses the distance of the arm's next point from the
    goal that the rest of the arm can still close; the law of cosines gives the angle, to either side. So
    every choice yields a pose, and every pose has a choice.
    """
    shape = np.broadcast_shapes(goals.shape[:-1], psi.shape[:-1], sheet.shape)
    sides = [1.0 - 2.0 * ((sheet >> k) & 1) for k in range(num_sheets(arm).bit_length() - 1)]
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
    theta1 = np.arctan2(goals[..., 1], goals[..., 0]) + sides[0] * _turn(distance, a, l2 + r2, psi[..., 1])
    theta2 = np.arctan2(goals[..., 1] - a * np.sin(theta1), goals[..., 0] - a * np.cos(theta1))
    return [theta1, r1, theta2, r2], reached


def _between(low: Any, high: Any, psi: Any) -> Any:
    """From low at psi = 0 to high at pi, both exact; angles are smooth in psi where an arm is straight."""
    share = 0.5 - 0.5 * np.cos(psi)
    return (1.0 - share) * low + share * high


def _turn(distance: Any, length: Any, rest: Any, psi: Any) -> Any:
    """Angle from a link to the line to the goal, 0 to pi, that closes the triangle; psi at the goal."""
    product = 2.0 * distance * length
    squares = distance**2 + length**2 - rest**2
    cosine = np.divide(squares, product, out=np.zeros_like(squares * product), where=product > 0.0)
    return np.where(product > 0.0, np.arccos(np.clip(cosine, -1.0, 1.0)), psi)


def _least_reach(lengths: Any) -> float:
    """Smallest distance of the tip of a chain of links from its base, m."""
    return float(max(0.0, 2.0 * max(lengths) - sum(lengths)))
