"""Random states of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scene import Scene
from redundant_envs.tasks.limits import hard_stops, narrowed

Array = NDArray[Any]
BEYOND = 0.5
"""Distance of poses beyond the travel, in units of it: springs at its ends act only there."""
WIDE = 5.0
"""Factor on unlimited angles in every second pose, so that they turn more than once."""
FREE = (0.0, 0.2)
"""Positions of unlimited sliders, m; of those with a stop on one side, the nearest inside it."""
FAR = 1.0
"""Largest distance of unlimited sliders from 0, to either side, in units of the sum of all lengths."""


def random_states(scene: Scene, count: int, seed: int, beyond: float = 0.0) -> tuple[Array, Array, Array]:
    """Coordinates, velocities and efforts, (count, joints) each.

    Angles uniform all around, travel uniform, rates normal: 2 rad/s, 0.5 m/s. One slider in four
    is at rest at an end of its travel. Efforts are uniform within the scene's limits; without limits, within
    the largest efforts that hold the weights in these states.
    ``beyond`` widens the travel to both sides, in units of itself.
    """
    arm: Any = scene.robot
    rng = np.random.default_rng(seed)
    prismatic, shape = np.array(arm.prismatic), (count, len(arm.joints))
    joints, values = rng.uniform(-np.pi, np.pi, shape), scene.parameters()
    ranges = dict.fromkeys(arm.sliders(), FREE)
    ranges |= {k: (values[low], values[high]) for k, (low, high) in scene.travel().items()}
    for k, lower, upper in hard_stops(scene):
        ranges[k] = narrowed(*ranges[k], values[lower], values[upper])
    for k, (low, high) in ranges.items():
        margin = beyond * (high - low)
        joints[:, k] = rng.uniform(low - margin, high + margin, count)
    rates = rng.normal(0.0, 1.0, shape) * np.where(prismatic, 0.5, 2.0)
    for k in {*arm.sliders()} & scene.travel().keys():
        at_end = rng.random(count) < 0.25
        ends = np.where(rng.random(count) < 0.5, *ranges[k])
        joints[at_end, k], rates[at_end, k] = ends[at_end], 0.0
    inverse = np.linalg.inv(arm.motor_map)
    limits = np.array([values[name] for name in scene.action_units()])
    if not limits.size:
        limits = np.abs(scene.loaded_robot.gravity_forces(joints @ inverse) @ inverse.T).max(axis=0)
    return joints @ inverse, rates @ inverse, rng.uniform(-1.0, 1.0, shape) * limits


def random_poses(scene: Scene, count: int, seed: int) -> tuple[Array, Array]:
    """Coordinates and velocities, (count, joints) each, in all regions that an arm can reach: also beyond its
    travel, after several turns, and with unlimited sliders on either side of 0. Poses in which the positions
    of point masses are undefined are left out."""
    arm: Any = scene.robot
    q, qd, _ = random_states(scene, count, seed, BEYOND)
    joints, rng = q @ arm.motor_map, np.random.default_rng(seed + 3)
    for k in range(len(arm.joints)):
        if k in scene.travel():
            continue
        if arm.prismatic[k]:
            joints[:, k] = FAR * (sum(arm.lengths) or 1.0) * rng.uniform(-1.0, 1.0, count)
        else:
            joints[::2, k] *= WIDE
    q = joints @ np.linalg.inv(arm.motor_map)
    there = np.isfinite(arm.points(q)).all(axis=(1, 2))
    return (q[there], qd[there]) if there.any() else (q, qd)
