"""Efforts of an arm at rest: the loads of gravity and springs on the motors, and the share of the stops."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.algebra import numbered
from redundant_envs.effects import EffortLimits
from redundant_envs.effects.hooks import Actuation, Force, Point
from redundant_envs.model.energy import at_joints, scene_quantities
from redundant_envs.scene import Scene
from redundant_envs.tasks.base import hard_stops
from redundant_envs.values import shown

Array = NDArray[np.float64]
Travel = dict[int, tuple[float, float]]


def static_efforts(scene: Scene, q: ArrayLike) -> Array:
    """Joint efforts t, (..., joints), that balance gravity and springs at rest, without the help of stops.

    In N m and N; B (t + f) = G(q), where f are the forces of the other effects on the joints at rest.
    ValueError unless the scene's efforts act at joints, or for another shape of q, (..., joints).
    """
    arm = scene.robot
    place = np.asarray(q, dtype=np.float64)
    joints = len(arm.joints)
    if place.shape[-1:] != (joints,):
        raise ValueError(f"q has shape {place.shape}; the last axis must have {joints} entries")
    if scene.actuation != "joint":
        raise ValueError(f"scene.actuation is {scene.actuation!r}; efforts are those of joints: use 'joint'")
    x = scene_quantities(scene, place)
    gravity = np.stack(np.broadcast_arrays(*x.each(numbered("G{}", joints))), axis=-1)
    efforts: Array = gravity @ np.linalg.inv(arm.motor_map).T
    for a in scene.attached.of(Force):
        efforts -= at_joints(scene, a, "function", x)
    return efforts


def motor_efforts(scene: Scene, q: ArrayLike) -> Array:
    """The smallest motor efforts at rest, (..., joints): a slider at a stop leans on it where that helps.

    A lower stop pushes its slider outwards, an upper one inwards; neither pulls. A slider is at a stop if its
    position in ``q`` is equal to it, or beyond it.
    """
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
    lengths = iter(scene.robot.lengths)
    for k in scene.robot.sliders():
        low, high = travel.get(k, (-np.inf, np.inf))
        least = -next(lengths)
        if not (least <= low and high < np.inf):
            raise ValueError(
                f"PrismaticStop leaves {scene.robot.joints[k]!r} a travel of {low} to {high} m; give "
                f"both ends, the lower at least {least} m (a link cannot have a negative length)"
            )
    return travel


def effort_limits(scene: Scene) -> Array:
    """Effort limits of the joints, (joints,), N m and N.

    ValueError if the scene has none, or an effect whose part at rest is not known: another actuation, or a
    spring on a revolute joint, whose force depends on how often the joint has turned.
    """
    for a in scene.attached:
        if isinstance(a.hook, Force):
            turns = not isinstance(a.hook.joint, Point) and not scene.robot.prismatic[a.hook.joint]
            known = a.hook.potential is None or not turns
        else:
            known = not isinstance(a.hook, Actuation) or isinstance(a.effect, EffortLimits)
        if not known:
            raise ValueError(
                f"effects[{scene.effects.index(a.effect)}] is {shown(a.effect)}; the load at rest is known "
                "with gravity, friction, effort limits, stops, and springs on sliders: leave this effect out"
            )
    limits = next((e.limits for e in scene.effects if isinstance(e, EffortLimits)), ())
    given = np.atleast_1d(limits)
    if not given.size or given.min() <= 0.0:
        raise ValueError(
            f"EffortLimits.limits is {limits or None}; loads are shares of them: give positive numbers"
        )
    return given
