"""Random states of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scene import Scene


def random_states(
    scene: Scene, count: int, seed: int, beyond: float = 0.0
) -> tuple[NDArray[np.float64], ...]:
    """Coordinates, velocities and efforts, (count, joints) each.

    Angles uniform all around, travel uniform, rates normal: 2 rad/s, 0.5 m/s. One slider in four
    stands still at an end of its travel. Efforts are uniform within the scene's limits, or where it has none
    within the largest that hold the weights in these states.
    ``beyond`` widens the travel to both sides, in units of itself.
    """
    arm: Any = scene.robot
    rng = np.random.default_rng(seed)
    prismatic, shape = np.array(arm.prismatic), (count, len(arm.joints))
    joints = rng.uniform(-np.pi, np.pi, shape)
    joints[:, prismatic] = rng.uniform(0.0, 0.2, (count, int(prismatic.sum())))
    values = scene.parameters()
    for joint, (low, high) in scene.travel().items():
        margin = beyond * (values[high] - values[low])
        joints[:, joint] = rng.uniform(values[low] - margin, values[high] + margin, count)
    rates = rng.normal(0.0, 1.0, shape) * np.where(prismatic, 0.5, 2.0)
    for joint, (low, high) in scene.travel().items():
        if prismatic[joint]:
            at_end = rng.random(count) < 0.25
            ends = np.where(rng.random(count) < 0.5, values[low], values[high])
            joints[at_end, joint], rates[at_end, joint] = ends[at_end], 0.0
    inverse = np.linalg.inv(arm.motor_map)
    limits = np.array([values[name] for name in scene.action_units()])
    if not limits.size:
        limits = np.abs(scene.loaded_robot.gravity_forces(joints @ inverse) @ inverse.T).max(axis=0)
    return joints @ inverse, rates @ inverse, rng.uniform(-1.0, 1.0, shape) * limits
